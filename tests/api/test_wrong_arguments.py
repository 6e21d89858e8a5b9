"""Arguments of a wrong kind at the Python interface are refused in words of `compact`, not in those of a library."""

import numpy as np
import pytest

import compact
from compact.analysis.failures import is_refusal

WRONG = ("0,1", b"1", 1 + 2j, object(), 10**400, np.array("x"), None)
OPTIONAL = {("law", "rod_length"), ("Limits", "velocity"), ("cut", "cutter_radius"), ("simulate_motor", "start_speed")}
LAW = compact.law("cubic", 0.4, 3.0)
CART = {
    "mass": 1000.0, "weight": 1e4, "roller_positions": (0.27, -0.27), "roller_reactions": (9740.0, 9740.0),
    "guide_positions": (0.37, -0.37), "pin_position": 0.65, "pin_height": 0.1, "roller_radius": 0.11,
    "guide_wheel_diameter": 0.046, "guide_friction": 0.008,
}  # fmt: skip
KLOSS = {"breakdown_torque": 40.0, "breakdown_slip": 0.15, "synchronous_speed": 157.0}
TIMES = np.linspace(0, 1, 21)
SMOOTH = 0.4 * (3 * TIMES**2 - 2 * TIMES**3)
HALF_SPACE = {"radius": 0.1, "youngs_modulus": 2e7, "poisson": 0.3}
CALLS = {  # function, and valid numbers of its arguments
    "law": (
        lambda **given: compact.law("crank", **given),
        {"stroke": 0.4, "duration": 3.0, "run_up": 0.2, "run_down": 0.2, "rod_length": 0.8, "energy_weight": 0.5},
    ),
    "hertz": (compact.hertz, {**HALF_SPACE, "half_width": 0.01}),
    "pressure_exponent": (compact.pressure_exponent, {"poisson": 0.3, "friction": 0.3}),
    "Cart": (compact.Cart, CART),
    "ElasticDrive": (compact.ElasticDrive, {"stiffness": 1e6, "damping": 1e3, "backlash": 1e-4}),
    "Kloss": (compact.Kloss, KLOSS),
    "Crank": (compact.Crank, {"radius": 0.2, "rod_length": 0.8}),
    "prior": (compact.prior, {"moisture": 0.1, "density_ratio": 0.98}),
    "Layer": (compact.Layer, {"height": 0.2}),
    "Roller": (compact.Roller, {"radius": 0.1, "friction": 0.1}),
    "Limits": (compact.Limits, {"velocity": 1.0, "run_up": 0.3, "run_down": 0.3, "steady_tolerance": 0.1}),
    "dry_resistance": (compact.dry_resistance, {"force": 100.0}),
    "resistance": (compact.dry_resistance(100.0), {"velocity": 0.1, "acceleration": 0.1}),
    "from_table": (compact.from_table, {"time": TIMES, "position": SMOOTH}),
    "derivative": (LAW.derivative, {"time": 0.1, "order": 1}),
    "cut": (
        lambda **given: compact.cut(compact.Cam(LAW.cycle(), 0.9, compact.RollerFollower(0.03)), **given),
        {"cutter_radius": 0.01, "tolerance": 1e-3},
    ),
    "optimise": (
        lambda **given: compact.optimise("peak_force", resistance=compact.dry_resistance(100.0), **given),
        {"stroke": 0.4, "duration": 3.0, "mass": 1e3},
    ),
}  # fmt: skip


@pytest.mark.sampled(10)
@pytest.mark.parametrize(("name", "key"), [(name, key) for name, (_, valid) in CALLS.items() for key in valid])
def test_a_numeric_argument_takes_numbers_only(name, key):
    call, valid = CALLS[name]
    for wrong in WRONG:
        if wrong is None and (name, key) in OPTIONAL:
            continue
        with pytest.raises(ValueError, match=r"`\w+`|order") as refused:
            call(**valid | {key: wrong})
        assert is_refusal(refused.value), repr(refused.value)


@pytest.fixture(scope="module")
def scene():
    return compact.load_scene("compact/data/scenes/small.toml")


REFUSED = {  # call, and the beginning of the refusal
    'scene.roll(["0,1"])': "`speeds` must be real numbers below 1.8e308, got",
    "scene.roll([])": "`speeds` must hold at least one speed",
    "scene.roll(0.2, engine='column').fields": "no engine with fields 'column'; choose from fem, compaction",
    "scene.rank(resistance=lambda v, a: 3e3 + 0 * v + 0 * a)": ".*oppose",
    "scene.rank(laws={'far': lambda time: 0.4 - 0.4 * np.cos(np.pi * time / 3)})": "the law 'far' has the stroke 0.8",
    "scene.rank(laws={'cubic': np.sin})": "the scene has a law 'cubic' already",
    "scene.rank(laws={'jumps': lambda time: 0.4 * time / 3.0})": "the law 'jumps' deviates from its fit by .* at rest",
    "compact.read_fields('b.vtu')": "b.vtu: not a mesh that meshio reads",
    "scene.rank(resistance=100.0)": "`resistance` must be a function of velocity",
    'scene.sweep({"mix.moisture": []})': "--vary mix.moisture: takes one or more numbers",
    'scene.sweep(["mix.moisture"])': "`vary` must be values by key path, got",
    'scene.sweep({"mix.moisture": [0.1]}, workers="2")': "--workers must be at least 1, got '2'",
    'scene.roll(0.1, engine="column", material=1)': "`material` must be a StateUpdate, got 1",
    "compact.read_fields(1)": "`path` must be the path of a file, got 1",
    "compact.law([], 0.4, 1.0)": r"no motion law '\[\]'; choose from",
    "compact.simulate(1, compact.Rigid(), LAW, 1.0)": "`cart` must be a Cart, got 1",
    'compact.simulate(compact.Cart(**CART), "rigid", LAW, compact.dry_resistance(1.0))': "`drive` must be a drive",
    "compact.optimise(1, 0.4, 3.0, 1e3, compact.dry_resistance(1.0))": "`objective` must be the name of an objective",
}


@pytest.mark.parametrize("call", REFUSED)
def test_a_wrong_argument_is_refused(call, scene):
    with pytest.raises(ValueError, match=f"^{REFUSED[call]}") as refused:
        eval(call, globals(), {"scene": scene})
    assert is_refusal(refused.value)
