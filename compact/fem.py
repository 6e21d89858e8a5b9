"""Rolling contact by finite elements: one entry for linear and for compacting layers, selected by the material.

The engine "fem" solves elastic and viscoelastic layers, in steady motion (`engines.fem.engine`) and in any motion
(`engines.fem.transient`); the engine "compaction" solves compacting layers (`engines.compaction`).
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from compact.engines.fem.engine import FemContactResult
from compact.engines.fem.engine import roll as roll_linear
from compact.files import write_vtu
from compact.material.laws import Compaction, Elastic
from compact.mesh import DEFAULT_ERROR, RowMesh
from compact.rolling_contact import ContactResult, Layer, PrescribedMotion, Roller, TransientResult

if TYPE_CHECKING:
    import meshio

    from compact.engines.compaction.results import CompactionContactResult

__all__ = ["FemContactResult", "fields", "roll", "travel", "write_fields"]


def roll(
    layer: Layer,
    roller: Roller,
    material: Elastic | Compaction,
    speed: float,
    *,
    torque: float | None = None,
    mesh: RowMesh | None = None,
    tolerance: float = DEFAULT_ERROR,
    estimate: bool = True,
) -> ContactResult:
    """Solve the steady rolling contact of one roller with a layer.

    Parameters
    ----------
    layer : Layer
        Layer; plies are allowed for linear materials.
    roller : Roller
        Roller with any profile and rolling condition.
    material : Elastic, Viscoelastic or Compaction
        Material law, which selects the engine.
    speed : float
        Speed of the roller along x [m/s], not 0.
    torque : float, optional
        Torque on a free or driven roller per unit length, positive in the sense of rolling [N]; a free roller has none
        by default.
    mesh, tolerance, estimate
        Mesh, relative error [-] and error estimate of a linear layer, as of `engines.fem.engine.roll`.

    Examples
    --------
    >>> from compact.material.laws import Elastic
    >>> from compact.rolling_contact import Layer, Roller
    >>> result = roll(Layer(0.22), Roller(0.11, indentation=0.003), Elastic(10e6, 0.3), speed=0.2)
    >>> f"load {result.load / 1e3:.2f} kN/m, edge {result.leading * 1e3:.2f} mm"
    'load 15.09 kN/m, edge 13.85 mm'
    """
    if isinstance(material, Compaction):
        if mesh is not None:
            raise ValueError(
                f"`mesh` must be None for a compacting layer, which has its own, got one of {mesh.shape} elements"
            )
        from compact.engines.compaction.engine import roll as roll_compacting

        return roll_compacting(layer, roller, material, speed, torque=torque)
    return roll_linear(layer, roller, material, speed, torque=torque, mesh=mesh, tolerance=tolerance, estimate=estimate)


def travel(
    layer: Layer, roller: Roller, material: Elastic | Compaction, motion: PrescribedMotion, **accuracy: Any
) -> TransientResult:
    """Simulate a roller in any motion, reversals included.

    Parameters
    ----------
    layer, roller, material
        As of `roll`; the roller has an `indentation`.
    motion : PrescribedMotion
        Motion with `position` and `velocity` over time [s] and `duration` [s]: a `Motion`, a `Cycle` or a user's class.
    **accuracy
        Torque and numerical parameters of `simulate_transient` for linear layers, `simulate_reciprocating` for
        compacting ones.

    Examples
    --------
    >>> from compact.material.laws import Viscoelastic
    >>> from compact.motion.profile import law
    >>> from compact.rolling_contact import Layer, Roller
    >>> mix = Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),))
    >>> stroke = law("quintic", stroke=0.1, duration=1.0)
    >>> result = travel(Layer(0.22), Roller(0.11, indentation=0.003), mix, stroke, estimate=False)
    >>> f"{result.resistance.max():.0f} N/m at most, {result.resistance[-1]:.0f} N/m as it comes to rest"
    '505 N/m at most, 168 N/m as it comes to rest'
    """
    if isinstance(material, Compaction):
        from compact.engines.compaction.reciprocating import simulate_reciprocating

        return simulate_reciprocating(layer, roller, material, motion, **accuracy)
    from compact.engines.fem.transient import simulate_transient

    return simulate_transient(layer, roller, material, motion, **accuracy)


def fields(result: "FemContactResult | CompactionContactResult") -> "meshio.Mesh":
    """Compute the fields inside the layer under a steady roller, as of `field_mesh` of the engine."""
    if isinstance(result, FemContactResult):
        from compact.engines.fem.fields import field_mesh as linear_fields

        return linear_fields(result)
    from compact.engines.compaction.results import field_mesh as compaction_fields

    return compaction_fields(result)


def write_fields(result: "FemContactResult | CompactionContactResult", path: str | Path) -> None:
    """Write the fields inside the layer as VTU."""
    write_vtu(fields(result), path)
