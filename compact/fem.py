"""Rolling contact by finite elements: one entry for linear and for compacting layers, selected by the material.

The engine "fem" solves elastic and viscoelastic layers in steady motion (`engines.fem.engine`); the engine "compaction"
solves compacting layers, in steady motion and in any motion (`engines.compaction`).
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from compact.engines.compaction import COMPACTION
from compact.engines.fem import FEM
from compact.engines.fem.engine import FemContactResult
from compact.engines.fem.engine import roll as roll_linear
from compact.files import write_vtu
from compact.material.laws import Compaction, Elastic
from compact.rolling_contact import Contact, Layer, PrescribedMotion, Roller

if TYPE_CHECKING:
    import meshio

    from compact.engines.compaction.engine import CompactionContactResult
    from compact.engines.compaction.reciprocating import CompactionTransientResult

__all__ = ["FemContactResult", "fields", "roll", "travel", "write_fields"]


def roll(
    layer: Layer,
    roller: Roller,
    material: Elastic | Compaction,
    speed: float,
    *,
    torque: float | None = None,
    **accuracy: Any,
) -> Contact:
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
    **accuracy
        `mesh`, `tolerance` [-] and `estimate` of a linear layer, as of `engines.fem.engine.roll`; `increments`,
        `steady_tolerance`, `start` and others of a compacting one, as of `engines.compaction.engine.roll`.

    Examples
    --------
    >>> from compact.material.laws import Elastic
    >>> from compact.rolling_contact import Layer, Roller
    >>> mix = Elastic(youngs_modulus=10e6, poisson=0.3)
    >>> result = roll(Layer(0.22), Roller(0.11, indentation=0.003), mix, speed=0.2)
    >>> f"load {result.load / 1e3:.2f} kN/m, edge {result.leading * 1e3:.2f} mm"
    'load 15.09 kN/m, edge 13.85 mm'
    """
    if isinstance(material, Compaction):
        from compact.engines.compaction.engine import roll as roll_compacting

        return roll_compacting(layer, roller, material, speed, torque=torque, **accuracy)
    return roll_linear(layer, roller, material, speed, torque=torque, **accuracy)


def travel(
    layer: Layer, roller: Roller, material: Compaction, motion: PrescribedMotion, **accuracy: Any
) -> "CompactionTransientResult":
    """Simulate a roller in any motion over a compacting layer, reversals included.

    Parameters
    ----------
    layer, roller, material
        As of `roll`, with irreversible compaction; the roller has an `indentation`.
    motion : PrescribedMotion
        Motion with `position` and `velocity` over time [s] and `duration` [s]: a `Motion`, a `Cycle` or a user's class.
    **accuracy
        Torque and numerical parameters of `simulate_reciprocating`.

    Raises
    ------
    ValueError
        If the layer does not compact: linear layers have steady motion alone, and the first order of the acceleration
        by `engines.fem.speed_derivative`.
    """
    from compact.engines.compaction.reciprocating import simulate_reciprocating

    return simulate_reciprocating(layer, roller, material, motion, **accuracy)


def fields(result: "FemContactResult | CompactionContactResult") -> "meshio.Mesh":
    """Compute the fields inside the layer under a steady roller, as of `field_mesh` of the engine."""
    return (FEM if isinstance(result, FemContactResult) else COMPACTION).fields(result)


def write_fields(result: "FemContactResult | CompactionContactResult", path: str | Path) -> None:
    """Write the fields inside the layer as VTU."""
    write_vtu(fields(result), path)
