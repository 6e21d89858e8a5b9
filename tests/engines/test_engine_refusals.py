"""Refused cases of the engines: one table of what is refused with which words."""

from dataclasses import replace

import pytest
from column_cases import FED_HEIGHT, HEIGHT, MIX, R, circle, mix, rolled
from engine_calls import ROLL

from compact import mesh
from compact.engines.column.column_pass import Column
from compact.engines.column.engine import required_feed, roll_over, simulate_oedometer
from compact.engines.fem.speed_derivative import expand_resistance as expand_by_elements
from compact.engines.formula import roll as roll_by_formula
from compact.material.laws import Elastic, Viscoelastic
from compact.rolling_contact import Layer, LowerLift, Ply, Roller

LINEAR = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 0.05),))
SOFT = Elastic(youngs_modulus=1e6, poisson=0.3)
PLIES = Layer(0.22, plies=(Ply(thickness=0.12, stiffness=1.0), Ply(thickness=0.1, stiffness=2.0)))
ROWS = mesh.graded_mesh(0.22, 0.02, 4)
ON_LIFT = Layer(0.2, lower_lift=LowerLift(thickness=0.1, density_ratio=0.9))
BURIED = mix(fed_density_ratio=0.8044), 1.8, Roller(0.0337, indentation=1e-3, profile="circle")
CLOSING = (  # elastic until its pores close
    mix(fed_density_ratio=0.9656411, unloading_modulus=1.17065e6, critical_slope=0.357036, dry_side="flat"), 0.35,
    circle(1e-3),
)  # fmt: skip
CASE = {  # accepted case of each engine
    "formula": {"layer": Layer(10.0), "roller": Roller(R, load=1e3), "material": SOFT, "speed": 0.2},
    "column": {"layer": Layer(FED_HEIGHT), "roller": circle(), "material": MIX, "speed": 0.2},
    "spectral": {"layer": Layer(0.22), "roller": Roller(R, indentation=0.003), "material": LINEAR, "speed": 0.2},
    "fem": {"layer": Layer(0.22), "roller": Roller(R, indentation=0.003), "material": LINEAR, "speed": 0.2},
}
REFUSED = [
    *((engine, {"speed": 0}, "`speed` must not be 0, got 0: the resistance at rest is set-valued") for engine in CASE),
    *((engine, {"rolling": "stuck"}, "no rolling 'stuck'; choose from frictionless, sliding") for engine in CASE),
    *((engine, {"material": "clay"}, "`material` .*, got ('clay'|str)") for engine in CASE),
    ("formula", {"layer": PLIES}, r"the engine formula takes no `plies` \(Ply.*, as it has one modulus for"),
    ("column", {"layer": Layer(0.22, base="slip")}, "takes no `base` 'slip', as mix on a slipping base moves sideways"),
    ("column", {"material": SOFT}, "needs a `material` Compaction or StateUpdate, got Elastic; use"),
    *(
        ("column", {"friction": 0.3, "rolling": rolling}, f"no `rolling` '{rolling}' with `friction` 0.3, as columns")
        for rolling in ("sliding", "driven")
    ),
    ("column", {"layer": Layer(0.22), "indentation": 0.0132}, "must be less than 0.0132 m, where grains and water"),
    ("column", {"layer": Layer(9.0), "indentation": 0.2}, "less than 0.11 m, where the circle is buried to its"),
    ("column", {"strain": "engineering"}, "no strain 'engineering'; choose from logarithmic, small"),
    ("column", {"exit_density_ratio": 0.93}, "must lie between 0.94, before the pass, and 0.99.*got 0.93"),
    ("spectral", {"profile": "deformed"}, "takes no `profile` 'deformed', as its gap is measured on the undeformed"),
    ("spectral", {"rolling": "free", "friction": 0.3}, "no `rolling` 'free' with `friction` 0.3, as its rollers have"),
    ("spectral", {"layer": ON_LIFT}, "takes no `lower_lift` LowerLift.*, as its layer does not compact"),
    ("fem", {"layer": Layer(0.3), "mesh": ROWS}, "`mesh` must be as high as the layer, 0.3 m, got 0.22 m"),
    ("fem", {"layer": PLIES, "mesh": ROWS}, "a line of nodes at every interface of plies, got none at y = 0.12 m"),
    ("fem", {"rolling": "driven", "friction": 0.2}, "`torque` must be given for a 'driven' roller"),
    ("fem", {"rolling": "sliding", "friction": 0.2, "torque": 3.0}, "`torque` needs a roller that"),
    ("fem", {"rolling": "free", "torque": 3.0}, "got 3.0 for 'free' with 0.0"),
]
TARGETS = ("indentation", "load", "peak_pressure")


def changed(engine, change):
    """The accepted case of an engine with changes of its arguments or of its roller."""
    case = dict(CASE[engine])
    of_roller = {key: value for key, value in change.items() if hasattr(case["roller"], key)}
    cleared = dict.fromkeys(TARGETS) if set(TARGETS) & set(of_roller) else {}
    case["roller"] = replace(case["roller"], **cleared | of_roller)
    return case | {key: value for key, value in change.items() if key not in of_roller}


@pytest.mark.parametrize(("engine", "change", "words"), REFUSED)
def test_case_is_refused(engine, change, words):
    with pytest.raises(ValueError, match=words):
        ROLL[engine](**changed(engine, change))


VALUES = [
    (lambda: required_feed(HEIGHT, 1.0, MIX, 0.2), "must lie between 0.94, before the pass, and 0.99.*got 1"),
    (lambda: required_feed(HEIGHT, 0.98, replace(MIX, rate_sensitivity=0.03), 0.2), "`radius` must be given for a mix"),
    (lambda: simulate_oedometer(MIX, [1e5, 1e7]), "less than the stress that closes all pores, got 10000000.0 Pa"),
    (lambda: roll_over((Column(0.2, 1.0),), circle(1e-3), MIX, 0.2), r"`density_ratio` must be below 1, got \[1.0\]"),
    (lambda: rolled(*BURIED, exit_density_ratio=0.95), "must lie .* where the circle is buried to its axis"),
    (lambda: rolled(*CLOSING, exit_density_ratio=0.971368), r"between 0\.965641, before the pass, and 0.9656"),
    (lambda: Layer(0.2, plies=PLIES.plies), "must add up to the layer height, 0.2 m, got 0.22"),
    (lambda: mesh.graded_mesh(0.22, 0.02, 4, interfaces=(0.2, 0.1)), r"`interfaces` must ascend between 0 and the he"),
    (lambda: expand_by_elements(**changed("fem", {"rolling": "free", "friction": 0.3})), "without stick and slip only"),
]


@pytest.mark.parametrize(("make", "words"), VALUES)
def test_value_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()


@pytest.mark.parametrize("engine", [pytest.param("spectral", marks=pytest.mark.slow), "fem"])
def test_thin_top_ply_under_a_wide_contact_raises(engine):
    plies = Ply(thickness=0.2199, stiffness=1.0), Ply(thickness=1e-4, stiffness=2.0)
    with pytest.raises(RuntimeError, match=r"more than 100 times the thickness of the top ply, 0.0001 m; join that"):
        ROLL[engine](**changed(engine, {"layer": Layer(0.22, plies=plies), "material": SOFT}))


def test_thin_layer_is_beyond_the_formulas():
    message = r"needs `half_width` < 0.5 `height`, got 0.0\d+ m for 0.05 m.*spectral or fem"
    with pytest.warns(UserWarning, match=message):
        roll_by_formula(Layer(0.05), Roller(R, load=4e3), Elastic(youngs_modulus=0.75e6, poisson=0.3), 0.2)
