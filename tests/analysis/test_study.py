"""Study from scene to summary: published operating point, energy balances, counts of evaluations."""

import json
from typing import get_args

import numpy as np
import pytest

from compact.analysis.engineering_summary import coverage
from compact.analysis.study import Study
from compact.drive import CRITERIA
from compact.motion import optimal_motion
from compact.motion.profile import LAWS
from compact.report import text
from compact.report import writer as report
from compact.scene.loader import LAW_NAMES, load_scene
from compact.scene.schema import RankBy

PUBLISHED_COEFFICIENT = (3562 - 0.008 * (2 * 9740 - 10000)) / (2 * 9740)  # C: 3562 N without the guides' friction


STEP = {"drive.turn": "step"}  # of closed forms


def scene(name="loveikin-2015", **changes):
    return load_scene(name, **changes)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Study, summary and directory of the small scene with all outputs."""
    directory = tmp_path_factory.mktemp("run") / "small"
    study = Study(scene("small", **{"output.items": ["tables", "cams", "reactions", "crank"]}))
    report.write_study(study, directory)
    return study, json.loads((directory / "summary.json").read_text()), directory


def test_published_scene_has_the_published_forces():
    study = Study(scene())
    assert study.stages.contacts.engineering.roller_force == pytest.approx(9740, rel=1e-6)
    assert study.stages.contacts.engineering.resistance_coefficient == pytest.approx(PUBLISHED_COEFFICIENT, rel=1e-5)
    assert study.stages.resistance.steady_law.force + 0.008 * (2 * 9740 - 10000) == pytest.approx(3562, rel=1e-5)


def test_prior_modulus_gives_the_uncalibrated_force():
    study = Study(scene(**{"mix.overrides.effective_modulus": None}))
    roller_force = study.stages.contacts.engineering.roller_force
    assert roller_force == pytest.approx(17720.764176, rel=1e-9)  # theory: regression point


@pytest.mark.sampled(6)
@pytest.mark.parametrize("name", [name for name in LAWS if name not in ("constant-velocity", "gear-sector")])
def test_energy_of_a_cycle_is_the_work_of_resistance_and_friction(name):
    study = Study(scene(**{"motion.laws": [name]}, **STEP))
    forces = study.stages.resistance.resistance.force + 0.008 * (
        2 * study.stages.contacts.engineering.roller_force - 10000
    )
    assert study.stages.drive.runs[name].energy == pytest.approx(2 * 0.4 * forces, rel=1e-9)


def test_laws_and_criteria_of_the_scene_are_those_of_the_table_and_the_drives():
    assert tuple(LAWS) == LAW_NAMES
    assert set(get_args(RankBy)) == set(CRITERIA)


def test_inertia_changes_the_ranking_of_the_crank_scene():
    slow, fast = (
        Study(scene(name)).stages.drive.rankings["peak_power"] for name in ("loveikin-2015", "loveikin-2015-crank")
    )
    assert slow[0].run.name == "reversal-4-free-acceleration"
    assert fast[0].run.name == "cubic"
    assert [p.run.name for p in slow] != [p.run.name for p in fast]


def test_spread_of_the_force_follows_the_square_of_the_pressure():
    force = Study(scene()).stages.contacts.numbers["roller_force"]
    assert (force.low / force.value, force.high / force.value) == pytest.approx((1.5**-2, 1.5**2), rel=1e-12)


def test_angle_of_a_stepper_in_the_roller_follows_the_travel(written):
    study, _, directory = written
    rows = np.genfromtxt(directory / "cams" / "reversal-3-stepper.csv", delimiter=",", names=True)
    assert rows["angle_rad"].max() * study.scene.machine.roller_radius == pytest.approx(0.4, rel=1e-9)
    speed = 1.2 * 0.4 / 3.0 / 0.11  # D 3.2: 6/5 of the mean speed, B eq (46)
    assert np.abs(rows["angular_velocity_rads"]).max() == pytest.approx(speed, rel=1e-9)
    run, rollers = study.stages.drive.runs["reversal-3"], study.scene.machine.rollers
    assert rollers * np.trapezoid(rows["power_W"], rows["time_s"]) == pytest.approx(run.energy, rel=5e-3)
    assert rollers * np.abs(rows["torque_Nm"]).max() == pytest.approx(run.peak_force * 0.11, rel=1e-2)
    assert np.abs(rows["traction"]).max() == pytest.approx(
        run.peak_force / rollers / study.stages.contacts.roller_load, rel=1e-2
    )


@pytest.mark.slow
def test_two_runs_write_the_same_bytes(written, tmp_path):
    study, _, directory = written
    report.write_study(Study(study.scene), tmp_path / "again")
    for path in directory.rglob("*.csv"):
        assert path.read_bytes() == (tmp_path / "again" / path.relative_to(directory)).read_bytes()


OPTIMISE = {"objectives": ["peak_force", "peak_power"], "smoothness": 1, "steady_tolerance": 0.0, "acceleration": 0.6}


UNBOUNDED = {"objectives": ["peak_force"], "smoothness": 1}
COLUMN = {
    "accuracy.engine": "column", "motion.laws": ["reversal-4"], "machine.roller_condition": "frictionless",
    "mix.overrides.rate_sensitivity": 0.0,  # a resistance that grows with the speed bounds it below the given one
}  # fmt: skip
SPECTRAL = COLUMN | {
    "accuracy.engine": "spectral", "accuracy.tolerance": 0.05, "machine.gap_geometry": "circle",
    "contact.speeds": [0.05, 0.3], "contact.peak_pressure": 203e3,
}  # fmt: skip


@pytest.mark.parametrize(
    "layer", [pytest.param(COLUMN, id="column"), pytest.param(SPECTRAL, id="spectral", marks=pytest.mark.slow)]
)
def test_resistance_map_extends_to_the_speed_of_the_optimal_law(layer):
    study = Study(scene(**layer, **{"motion.optimise": UNBOUNDED}))
    given = study.stages.resistance.largest_speed
    there = study.stages.laws.cycles["least-peak-force"].forward
    assert given < there.peaks().velocity < 0.999 * study.stages.laws.limits.velocity
    assert (
        study.stages.laws.limits.velocity
        == study.stages.resistance.largest_speed
        == pytest.approx(study.stages.resistance.map.speeds[-1])
    )
    assert study.stages.drive.runs["least-peak-force"].peak_force == pytest.approx(there.value, rel=1e-3)


def test_optimisation_without_convergence_omits_its_law_alone(monkeypatch):
    def optimise(objective, *task, **how):
        if objective == "peak_power":
            raise RuntimeError("no stationary law after 60 steps")
        return optimal_motion.optimise(objective, *task, **how)

    monkeypatch.setattr("compact.analysis.stages.laws.optimise", optimise)
    study = Study(scene(**{"motion.laws": ["cubic"], "motion.optimise": OPTIMISE}))
    with pytest.warns(UserWarning, match="least-peak-power is not made: no stationary law after 60 steps"):
        assert list(study.stages.laws.cycles) == ["cubic", "least-peak-force"]
    assert study.stages.laws.not_made == {"least-peak-power": "no stationary law after 60 steps"}
    with pytest.raises(RuntimeError, match="no cam: least-peak-power is not made: no stationary law"):
        study.stages.laws.cam("least-peak-power", "roller")


# text


def test_a_sufficient_remedy_for_too_few_rollers_is_stated():
    study = Study(scene())
    assert study.stages.contacts.engineering.rollers_needed == 3
    said = coverage(study.scene, study.stages.contacts.engineering)
    assert said.startswith(
        "eq 1.2: the product, 1.164 m wide, needs 3 rollers, the scene has 2; set machine.rollers to 3"
    )
    mended = Study(scene(**{"machine.rollers": 3, "machine.roller_positions": [0.3, 0.0, -0.3]}))
    assert mended.stages.contacts.engineering.rollers_needed == mended.scene.machine.rollers
    assert coverage(mended.scene, mended.stages.contacts.engineering) == ""
    small = scene("small", **{"output.items": [], "motion.laws": ["cubic"]})
    assert said in " ".join(text.study_digest(Study(small)).split())


@pytest.mark.parametrize("laws", [["constant-velocity"], ["crank", "gear-sector"]])
def test_resistance_map_covers_the_speeds_of_an_elastic_drive_after_a_velocity_jump(laws):
    spring = {"drive.kind": "elastic", "drive.stiffness": 1e6, "drive.damping": 3e3}
    study = Study(scene(**spring, **{"accuracy.engine": "column", "layer.lift_thickness": 0.06, "motion.laws": laws}))
    run = study.stages.drive.runs[laws[-1]]
    assert np.abs(run.state.velocity).max() < study.stages.resistance.map.speeds[-1]
    assert study.stages.resistance.largest_speed >= 4 * 0.4 / 3
