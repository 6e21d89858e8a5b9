"""Rolling contact by finite elements: one entry for linear layers and for mix that stays pressed, by the material.

Elastic and viscoelastic layers are solved by `fem_engine` (steady) and `transient` (any motion), compacting mix by
`compaction` (steady) and `travelling` (any motion).
"""

from compact.engines.fem.engine import FemContactResult
from compact.engines.fem.engine import roll as roll_linear
from compact.files import write_vtu
from compact.material.laws import Compaction
from compact.mesh import DEFAULT_ERROR

__all__ = ["FemContactResult", "fields", "roll", "travel", "write_fields"]


def roll(layer, roller, material, speed, *, torque=None, mesh=None, tolerance=DEFAULT_ERROR, estimate=True):
    """One roller in steady motion over a layer: a `FemContactResult`, of compacting mix a `CompactionContactResult`.

    Parameters
    ----------
    layer : Layer, of any height; of any plies where it is linear
    roller : Roller, every profile and condition `rolling`
    material : Elastic or Viscoelastic, see `fem_engine.roll`; Compaction, see `compaction.roll`
    speed : of the roller along x [m/s], not 0
    torque : on a roller that is free or driven, per unit length, + turning it the way it travels [N]; without it a
        free roller has none
    mesh, tolerance, estimate : of a linear layer, see `fem_engine.roll`; compacting mix makes its own mesh

    >>> from compact.material.laws import Elastic
    >>> from compact.rolling_contact import Layer, Roller
    >>> rolled = roll(Layer(0.22), Roller(0.11, indentation=0.003), Elastic(10e6, 0.3), speed=0.2)
    >>> f"load {rolled.load / 1e3:.2f} kN/m, edge {rolled.leading * 1e3:.2f} mm"
    'load 15.09 kN/m, edge 13.85 mm'
    """
    if isinstance(material, Compaction) and mesh is None:
        from compact.engines.compaction.engine import roll as roll_compacting

        return roll_compacting(layer, roller, material, speed, torque=torque)
    return roll_linear(layer, roller, material, speed, torque=torque, mesh=mesh, tolerance=tolerance, estimate=estimate)


def travel(layer, roller, material, motion, **accuracy):
    """A roller in any motion through v = 0 and back, its states kept by the mix: a `TransientResult`.

    layer, roller, material : as of `roll`, the roller with an `indentation`
    motion : with `position` and `velocity` of time [s], arrays, and `duration` [s]: a `Motion`, a `Cycle` or one's own
    accuracy : what the engine takes, a `torque` too: `transient.travel` for linear layers, `travelling.travel` for mix
        that compacts

    >>> from compact.material.laws import Viscoelastic
    >>> from compact.motion.profile import law
    >>> from compact.rolling_contact import Layer, Roller
    >>> mix = Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),))
    >>> stroke = law("quintic", stroke=0.1, duration=1.0)
    >>> done = travel(Layer(0.22), Roller(0.11, indentation=0.003), mix, stroke, estimate=False)
    >>> f"{done.resistance.max():.0f} N/m at most, {done.resistance[-1]:.0f} N/m as it comes to rest"
    '505 N/m at most, 168 N/m as it comes to rest'
    """
    if isinstance(material, Compaction):
        from compact.engines.compaction.reciprocating import simulate_reciprocating as travel_on
    else:
        from compact.engines.fem.transient import simulate_transient as travel_on
    return travel_on(layer, roller, material, motion, **accuracy)


def fields(rolled):
    """Fields inside the layer under a steady roller, a meshio mesh: `fields.field_mesh`, of compacting mix
    `results.field_mesh`."""
    if isinstance(rolled, FemContactResult):
        from compact.engines.fem.fields import field_mesh as fields_of
    else:
        from compact.engines.compaction.results import field_mesh as fields_of
    return fields_of(rolled)


def write_fields(rolled, path):
    """Write `fields` as VTU, whole or not at all."""
    write_vtu(fields(rolled), path)
