"""Arguments out of range of steady rolling and of strokes: changes to a case and the words of the refusal."""

from dataclasses import replace

import numpy as np
import pytest
from mixes import LIFT, MIX, free_roller
from mixes import LIFT_MIX as ON_LIFT

from compact.engines.compaction.engine import roll
from compact.engines.compaction.layer_state import fresh_layer
from compact.engines.compaction.reciprocating import simulate_reciprocating
from compact.motion.profile import law
from compact.rolling_contact import Layer, LowerLift, Ply, Roller

LIFTED = Layer(LIFT.height, lower_lift=LowerLift(thickness=0.06, density_ratio=0.98))
LOOSE = Layer(LIFT.height, lower_lift=LowerLift(thickness=0.06, density_ratio=0.9))
PLIES = Layer(0.1, plies=(Ply(thickness=0.05, stiffness=1.0), Ply(thickness=0.05, stiffness=2.0)))
STROKE = {"speed": None, "motion": law("quintic", 0.1, 1.0)}
DEPTH = {"indentation": 0.002, "friction": 0.3}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"speed": 0.0}, "`speed` must not be 0, got 0"),
        ({"strain": "log"}, "no strain 'log'"),
        ({"roller": Roller(0.11, indentation=0.02)}, "than 0.006 m, got 0.02 m: it would press mix fed at 0.94"),
        ({"roller": Roller(0.001, indentation=0.002, profile="circle")}, "than 0.001 m, got 0.002 m: the axle"),
        (
            {"roller": Roller(0.11, indentation=0.08), "layer": Layer(0.1, base="slip")},
            "than 0.07 m, got 0.08 m: mix on a frict",
        ),
        ({"layer": PLIES}, "`plies` are for linear layers, got 2"),
        ({"exit_density_ratio": 1.0}, "`exit_density_ratio` must lie between that of the fed mix 0.94 and 1, got 1.0"),
        ({"material": "mix"}, "`material` must be Compaction, got str; use the engine fem"),
        *(({"max_contact_angle": angle}, "`max_contact_angle` must be") for angle in (0.0, 2.0, np.nan)),
        ({"roller": Roller(0.11, rolling="driven", **DEPTH)}, "`torque` must be given for a 'driven' roller, got None"),
        ({"roller": free_roller(friction=0.0), "torque": 3.0}, "`torque` needs .* got 3.0 for 'free' with 0.0"),
        ({"roller": free_roller(rolling="sliding"), "torque": 3.0}, "`torque` needs .* for 'sliding' with 0.35"),
        ({"layer": LOOSE, "material": ON_LIFT}, "`density_ratio` must be above 0.93576 and below 1, got 0.9"),
        (
            {"layer": LIFTED, "material": ON_LIFT, "fed_layer": fresh_layer(ON_LIFT, np.array([LIFT.height]))},
            "`fed_layer` on a `lower_lift` must have a state `lower` of it, got None",
        ),
        (STROKE | {"roller": Roller(0.11, load=5e3)}, "`indentation` must be given .*, got its load"),
        (STROKE | {"layer": Layer(0.1, base="slip")}, "`base` must be 'bonded', got 'slip'"),
        (STROKE | {"layer": LIFTED, "material": ON_LIFT}, "a `lower_lift` is for steady rolling, got one"),
        (STROKE | {"edge_distance": 0.01}, "`edge_distance` must be at least the contact length 0.02098 m .*"),
        (STROKE | {"edge_distance": 0.1, "lift_thickness": 0.02}, "and `lift_thickness` 0, got 0.1 m and 0.02 m"),
    ],
)
def test_arguments_out_of_range_are_refused(layer, roller, changes, message):
    arguments = {"layer": layer, "roller": roller, "material": MIX, "speed": 0.2} | changes
    compute = roll
    if arguments["speed"] is None:
        compute = simulate_reciprocating
        del arguments["speed"]
    with pytest.raises(ValueError, match=message):
        compute(**arguments)


def test_start_of_another_case_is_refused(coarse, roller, mix):
    with pytest.raises(ValueError, match="`start` must have the same `base`, `lower_lift` and `fed_layer`"):
        roll(Layer(0.1, base="slip"), roller, mix, 0.2, start=coarse)
    with pytest.raises(ValueError, match="`start` must have the same `layer`, `fed_layer` and `indentation`"):
        simulate_reciprocating(coarse.layer, Roller(0.11, indentation=0.003), mix, STROKE["motion"], start=coarse)
    backwards = replace(coarse, speed=-0.2)
    with pytest.raises(ValueError, match=r"`start` must roll along \+x and the `motion` begin along \+x, got -0.2 m/s"):
        simulate_reciprocating(coarse.layer, roller, mix, STROKE["motion"], start=backwards)
