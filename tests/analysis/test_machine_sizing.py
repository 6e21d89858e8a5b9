"""Motor, guide wheels and bearings of a scene: agreement with the runs, the catalogue file, and the results."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from compact.analysis.machine_models import catalogue
from compact.analysis.study import Study
from compact.report.text import say
from compact.scene.errors import SceneError
from compact.scene.loader import load_scene
from compact.scene.schema import Hydraulics

SCENES = Path(__file__).parents[2] / "compact" / "data" / "scenes"
MOTORS = SCENES / "motors.csv"
STEP = {"drive.turn": "step"}  # for numbers by hand
RULE = STEP | {
    "drive.catalogue": {"file": "motors.csv", "margin": 1.25, "efficiency": 0.9}, "motion.duration": 0.889,
}  # fmt: skip
BEARINGS = {
    "machine.guide_bearing": {"dynamic_rating": 20e3, "kind": "ball", "count": 2},
    "machine.roller_bearing": {"dynamic_rating": 40e3, "kind": "roller", "count": 2},
}


@pytest.fixture
def small(tmp_path):
    """Copy of the small scene next to a catalogue."""
    shutil.copy(SCENES / "small.toml", tmp_path)
    shutil.copy(MOTORS, tmp_path)
    return tmp_path / "small.toml"


def study_of(**changes):
    return Study(load_scene("small", **{"output.items": []} | STEP | changes))


def sizing(**changes):
    return study_of(**changes).machine_sizing


def sentence(found):
    return say("motor", SimpleNamespace(machine_sizing=found))


def test_smallest_motor_of_the_example_holds_for_the_first_law():
    found = sizing(**RULE)
    choice = found.first.choice
    assert found.first_law == "cubic"
    assert choice.chosen.motor.name == "M-3"
    assert choice.next_smaller.motor.name == "M-2.2"
    assert choice.chosen.motor.rated_power > found.first.required_power > choice.next_smaller.motor.rated_power
    words = sentence(found)
    assert "smallest motor by price that holds: M-3" in words
    assert "the next smaller, M-2.2, has" in words


def test_shorter_passes_never_have_a_smaller_motor():
    powers, motors = [], []
    for duration in (3.0, 1.5, 0.889, 0.6):
        found = sizing(**RULE | {"motion.duration": duration}).first
        powers.append(found.required_power)
        motors.append(found.choice.chosen.motor.rated_power)
    assert powers == sorted(powers)
    assert motors == sorted(motors)
    found = sizing(**RULE | {"motion.duration": 0.3})
    assert found.first.choice.chosen is None
    assert "no motor of the catalogue holds; the largest, M-15, has" in sentence(found)


def elastic(**changes):
    spring = {"drive.kind": "elastic", "drive.stiffness": 1e8, "drive.damping": 3e5, "motion.laws": ["cubic"]}
    return sizing(**spring | changes).first


def test_spring_adds_its_oscillation_to_the_torque():
    """Energy of the driven end over a cycle; a velocity jump has a finite torque behind a spring."""
    soft = {"drive.stiffness": 1e6, "drive.damping": 3e3, "motion.duration": 0.889}
    study = study_of(**soft | {"drive.kind": "elastic", "motion.laws": ["cubic"]})
    found = study.machine_sizing.first.requirement
    assert 2 * np.pi * found.mean_torque == pytest.approx(study.stages.drive.runs["cubic"].energy, rel=1e-9)
    assert found.peak_torque * found.speed == pytest.approx(study.stages.drive.runs["cubic"].peak_power, rel=1e-3)
    assert found.peak_torque > 1.02 * sizing(**{"motion.duration": 0.889}).laws["cubic"].requirement.peak_torque
    jump = elastic(**{"motion.laws": ["constant-velocity"]}).requirement
    assert np.isfinite(jump.peak_torque)


def test_drive_without_a_shaft_or_a_torque_has_no_motor():
    numbers = (1e-3, 8e6, 5e-4, 2e-5, 0.62, 870.0, 1e3)
    oil = dict(zip(Hydraulics.model_fields, numbers, strict=True))
    found = sizing(**BEARINGS, **{"drive.kind": "hydraulic", "drive.hydraulics": oil})
    assert (found.first, found.laws, sentence(found), len(found.wheels)) == (None, {}, "", 4)
    assert "roller" in found.lives
    jump = sizing(**RULE, **{"motion.laws": ["cubic", "constant-velocity"]}).laws["constant-velocity"]
    assert (jump.requirement, jump.choice, jump.required_power) == (None, None, np.inf)


def test_life_of_the_roller_bearing_by_hand():
    """Load sqrt(9740^2 + 1743^2)/2 on one of two bearings; 0.8 m on a radius of 0.11 m in 6 s."""
    life = sizing(**BEARINGS).lives["roller"]
    load = np.hypot(9740, 1743.08) / 2
    assert life.equivalent_load == pytest.approx(load, rel=1e-5)
    assert life.million_revolutions == pytest.approx((40e3 / load) ** (10 / 3), rel=1e-4)
    assert life.valid
    assert life.hours == pytest.approx((40e3 / load) ** (10 / 3) * 1e6 * 2 * np.pi * 0.11 / 0.8 * 6 / 3600, rel=1e-4)


# the catalogue file


def broken(small, text):
    (small.parent / "motors.csv").write_text(text)
    return load_scene(small, **RULE)


HEADER = "name,rated_torque_Nm,peak_torque_Nm,speed_rpm,inertia_kgm2"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name,torque\na,1\n", "lacks the columns rated_torque_Nm, peak_torque_Nm, speed_rpm, inertia_kgm2"),
        (HEADER, "has no motors; give one line each"),
        (f"{HEADER}\na,10,30,1500,0.01\na,20,60,1500,0.01\n", "repeats the name a"),
    ],
)
def test_catalogue_is_validated_before_anything_is_computed(small, text, words):
    (motor,) = catalogue(broken(small, f"# a comment\n{HEADER}\n a , 10, 30,1500,0.01\n"))
    assert (motor.name, motor.price, motor.speed) == ("a", None, pytest.approx(157.0796, abs=1e-4))
    scene = broken(small, text)
    with pytest.raises(SceneError) as error:
        Study(scene)
    assert words in str(error.value)
