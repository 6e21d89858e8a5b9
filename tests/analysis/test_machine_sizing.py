"""Motor, guide wheels, bearings and work balance of a scene: agreement with the runs, catalogue, results."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from drive_tables import HYDRAULICS

from compact.analysis.machine_models import catalogue
from compact.analysis.material_tests import LaboratoryProgramme
from compact.analysis.sizing.balances import heckel_work
from compact.analysis.study import Study
from compact.material.laws import Compaction
from compact.report.text import say
from compact.scene.errors import SceneError
from compact.scene.loader import load_scene

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
    found = sizing(**BEARINGS, **{"drive.kind": "hydraulic", "drive.hydraulics": HYDRAULICS})
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


# ---- Balances of work and mix: closed forms, columns as an independent integration, and the published throughput


PRINTED = {"motion.duration": 0.4 / 0.45, "product.mould_speed": 1.1 / 60}  # .45 m/s, 1 to 1.15 m/min


def test_confined_work_is_the_integral_in_closed_form():
    """int ln(c/(1-k))/k2 dk = [-ln(c/(1-k))/k] + int dk/(k (1-k)) by parts, with c = 1 - k0."""
    a, b, c, slope = 0.936, 0.98, 0.28, 14.4e-6

    def primitive(k):
        return -np.log(c / (1 - k)) / k + np.log(k / (1 - k))

    assert heckel_work(a, b, slope) == pytest.approx(b * (primitive(b) - primitive(a)) / slope, rel=1e-9)


def test_confined_work_is_that_of_the_oedometer_of_stiff_mix():
    material = Compaction(
        unloading_modulus=1e11, poisson=0.3, heckel_slope=14.4e-6, loose_density_ratio=0.72, critical_slope=1.0,
        tensile_strength=14e3, fed_density_ratio=0.936, heckel_test="confined",
    )  # fmt: skip
    test = LaboratoryProgramme(material, 0.98, 183e3).test("oedometer")
    end = int(test.axial_stress.argmax()) + 1
    # of the volume before: dw = s_v d(e_v) V, V = exp(-e_v); over the volume at the end
    work = np.trapezoid(test.axial_stress[:end] * np.exp(-test.axial_strain[:end]), test.axial_strain[:end])
    behind = test.density_ratio[end - 1]
    assert heckel_work(0.936, behind, 14.4e-6) == pytest.approx(work * behind / 0.936, rel=0.01)


def test_pass_of_columns_takes_the_work_of_confined_compression():
    """Columns without a rate: the work of the resistance is that of compression, less the elastic recovery."""
    balance = study_of(**{"accuracy.engine": "column", "mix.overrides.rate_sensitivity": 0.0}).work_balance
    assert balance.work_ratio == pytest.approx(1.0, abs=0.02)


def test_rate_raises_the_work_of_a_pass_by_its_factor():
    columns = {"accuracy.engine": "column", "mix.overrides.heckel_slope": 15.228e-6}
    still, rated = (study_of(**columns | {"mix.overrides.rate_sensitivity": m}).work_balance for m in (0.0, 0.02))
    assert rated.pass_work / still.pass_work == pytest.approx(1.1, abs=0.015)


def test_published_throughput_takes_fifty_times_the_work_of_a_pass():
    """3486 N by 0.4 m a stroke are 320 to 370 kJ/m3 of the 15 to 17 mm that the mould advances."""
    balance = study_of(**PRINTED).work_balance
    assert 1e3 * balance.carried_volume == pytest.approx(4.17, abs=0.01)
    assert balance.throughput_work == pytest.approx(3486 * 0.4 / balance.carried_volume, rel=0.001)
    assert 320e3 < balance.throughput_work < 370e3
    assert balance.strokes_on_section == pytest.approx(71.4, abs=0.1)
    assert balance.feed_ratio == pytest.approx(balance.strokes_on_section * 2 * 0.4 / 1.164)
    assert balance.explained_share == pytest.approx(0.05, abs=0.003)
    assert balance.fits is False


def test_speed_of_the_mould_at_which_mix_and_throughput_fit():
    """L/v strokes of T each over the strips n s/B of the product: at v = n s L/(B T) they press it once."""
    speed = 2 * 0.4 * 1.164 / (1.164 * 60.0)
    fits = study_of(**{"product.mould_speed": speed, "motion.duration": 60.0})
    fitting = fits.work_balance
    assert fitting.feed_ratio == pytest.approx(1.0, rel=1e-12)
    assert fitting.fits
    assert say("feed", fits) == "feed: the rollers press what the mould carries away"
    fast = study_of(**{"product.mould_speed": 3 * speed, "motion.duration": 60.0})
    assert fast.work_balance.feed_ratio == pytest.approx(1 / 3, rel=1e-12)
    assert "the rest remains uncompacted" in say("feed", fast)


def test_return_over_compacted_mix_presses_half_the_mix():
    columns = PRINTED | {"accuracy.engine": "column"}
    fresh, compacted = (
        study_of(**columns | {"layer.return_stroke": each}).work_balance for each in ("fresh", "compacted")
    )
    assert compacted.feed_ratio == pytest.approx(fresh.feed_ratio / 2)
    assert compacted.cycle_work < 0.6 * fresh.cycle_work
