"""From a scene to one contact: the published case of two engines through the scene, targets, speeds, refusals."""

from pathlib import Path

import numpy as np
import pytest

from compact import engine, report
from compact.scene import SceneError, load_scene
from compact.study import Study

SMALL = Path(__file__).parent.parent / "studies" / "scenes" / "small.toml"
# contact.md g: R .11 m, h .22 m bonded, E(t) = 10 + 10 exp(-t/tau) MPa, nu .3, depth 3 mm, frictionless, parabola
CASE_G = {
    "mix.overrides.effective_modulus": 10e6,
    "mix.overrides.poisson": 0.3,
    "mix.overrides.instant_over_relaxed": 2.0,
    "mix.overrides.relaxation_time": 0.1,
    "machine.rolling": "frictionless",
    "machine.profile": "parabola",
    "contact.indentation": 0.003,
}


def study(**changes):
    return Study(load_scene(SMALL, **changes))


@pytest.mark.parametrize(("speed", "load", "resistance"), [(0.03, 15386.4, 289.42), (0.3, 20455.8, 392.89)])
def test_scene_reaches_the_published_contact(speed, load, resistance):
    case = study(**CASE_G)
    rolled = engine.roll(case.scene, case.mix, speed, "spectral")
    assert rolled.load == pytest.approx(load, rel=1e-5)
    assert rolled.resistance == pytest.approx(resistance, rel=1e-4)


def test_without_a_target_the_pressure_is_what_the_mix_needs():
    case = study(**{"machine.rolling": "frictionless", "machine.profile": "parabola"})
    rolled = engine.roll(case.scene, case.mix, 0.1, "spectral")
    assert rolled.peak_pressure == pytest.approx(case.mix.required_pressure, rel=1e-6)


def test_finite_elements_reach_the_same_contact():
    case = study(**CASE_G, **{"accuracy.engine": "fem"})
    rolled = engine.roll(case.scene, case.mix, 0.3)
    assert rolled.load == pytest.approx(20455.8, rel=5e-4)
    assert rolled.resistance == pytest.approx(392.89, rel=5e-3)
    assert rolled.work_residual < 5e-3


def test_tolerance_of_the_scene_is_what_the_engine_is_asked_for():
    coarse, fine = (study(**CASE_G, **{"accuracy.engine": "fem", "accuracy.tolerance": t}) for t in (1e-2, 1e-3))
    rough, close = (engine.roll(case.scene, case.mix, 0.3) for case in (coarse, fine))
    assert close.forces.shape[1] > rough.forces.shape[1]  # more nodes on the surface
    assert abs(close.resistance / 392.888 - 1) < 1e-3  # contact.md g, digits of the spectral engine
    assert abs(rough.resistance / 392.888 - 1) < 1e-2


def test_load_of_the_scene_is_that_of_the_whole_roller():
    case = study(**{"contact.load": 9740.0})
    _, roller, _ = engine.inputs(case.scene, case.mix, "formula")
    assert roller.load == pytest.approx(9740 / 1.164, rel=1e-12)


def test_mix_without_a_branch_is_elastic():
    case = study(**{"mix.overrides.instant_over_relaxed": 1.0})
    assert engine.inputs(case.scene, case.mix, "spectral")[2].branches == ()


def test_speeds_are_those_of_the_scene_or_span_the_motion():
    assert engine.speeds(study(**{"contact.speeds": [0.1, 0.2]}).scene) == (0.1, 0.2)
    found = np.array(engine.speeds(study().scene))
    assert len(found) >= 5
    assert (found[0], found[-1]) == pytest.approx((0.4 / 3 / 20, 0.4 / 3 * 2))


def test_formula_scene_rolls_no_layer():
    assert study().rolled == []


def test_run_tabulates_resistance_over_speed_beside_the_formulas(tmp_path):
    case = study(**CASE_G, **{"accuracy.engine": "spectral", "contact.speeds": [0.03, 0.3]})
    summary = report.write(case, tmp_path / "out")
    table = np.genfromtxt(tmp_path / "out" / "contact.csv", delimiter=",", names=True)
    assert table["resistance_Nm"] == pytest.approx([289.42, 392.89], rel=1e-4)
    assert table["formula_coefficient"] == pytest.approx([case.engineering.resistance_coefficient] * 2, rel=1e-11)
    assert summary["stages"]["rolled"] == 2


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"contact.load": 1e4, "contact.indentation": 0.003}, "only one of indentation, load and peak_pressure can be"),
        ({"contact.speeds": [0.2, 0.1]}, r"must be positive and rise one by one, got \[0\.2, 0\.1\]"),
        ({"contact.speeds": []}, r"must be positive and rise one by one, got \[\]"),
        ({"contact.depth": 0.003}, "unknown key"),
        ({"contact.load": -1.0}, "contact.load"),
    ],
    ids=["two targets", "falling speeds", "no speeds", "unknown key", "negative load"],
)
def test_contact_tables_that_cannot_be_are_refused(changes, words):
    with pytest.raises(SceneError, match=words):
        load_scene(SMALL, **changes)


def test_what_the_engine_does_not_cover_is_refused_with_its_words():
    case = study(**{"accuracy.engine": "spectral"})
    with pytest.raises(ValueError, match="needs `profile` 'parabola' or 'circle', got 'deformed'; use fem"):
        engine.roll(case.scene, case.mix, 0.1)
