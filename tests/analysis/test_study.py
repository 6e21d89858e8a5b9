"""Study from scene to summary: published operating point, energy balances, counts of evaluations."""

import csv
import json
import math
import pickle
import subprocess
import sys
from pathlib import Path
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
from compact.scene.loader import LAW_NAMES, SceneError, load_scene
from compact.scene.schema import RankBy

SCENES = Path(__file__).parents[2] / "compact" / "data" / "scenes"
PUBLISHED_COEFFICIENT = (3562 - 0.008 * (2 * 9740 - 10000)) / (2 * 9740)  # C: 3562 N without the guides' friction


STEP = {"drive.turn": "step"}  # of closed forms


def scene(name="loveikin-2015", **changes):
    return load_scene(SCENES / f"{name}.toml", **changes)


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


def test_laws_of_the_scene_are_those_of_the_table():
    assert tuple(LAWS) == LAW_NAMES


def test_criteria_of_the_scene_are_those_of_the_drives():
    assert set(get_args(RankBy)) == set(CRITERIA)


def test_mean_force_of_a_cart_without_mass_is_its_resistance():
    light = {"machine.mass": 1e-9, "machine.weight": 1e-8, "unusual": ["machine.mass", "machine.weight"]}
    study = Study(scene(**light, **{"machine.guide_friction": 0.0}, **STEP))
    force = study.stages.resistance.resistance.force
    assert study.stages.drive.runs["cubic"].mean_force == pytest.approx(force, rel=1e-9)
    assert study.stages.drive.runs["gear-sector"].mean_force == math.inf


def test_inertia_changes_the_ranking_of_the_crank_scene():
    slow, fast = (
        Study(scene(name)).stages.drive.rankings["peak_power"] for name in ("loveikin-2015", "loveikin-2015-crank")
    )
    assert slow[0].run.name == "reversal-4-free-acceleration"
    assert fast[0].run.name == "cubic"
    assert [p.run.name for p in slow] != [p.run.name for p in fast]


def test_crank_law_is_driven_through_its_rod_in_a_crank_machine():
    study = Study(scene("loveikin-2015-crank", **{"motion.laws": ["crank", "harmonic"]}))
    assert np.abs(study.stages.drive.runs["crank"].state.rod_tangent).max() == pytest.approx(
        0.25 / math.sqrt(1 - 0.0625), rel=1e-4
    )
    assert not study.stages.drive.runs["harmonic"].state.rod_tangent.any()


def test_elastic_drive_of_a_scene_is_summarised(tmp_path):
    spring = {"drive.kind": "elastic", "drive.stiffness": 1e6, "drive.damping": 3e3, "motion.laws": ["cubic", "septic"]}
    study = Study(scene(**spring, **{"output.items": ["tables", "reactions"]}, **STEP))
    summary = report.write_study(study, tmp_path / "out")
    forces = study.stages.resistance.resistance.force + 0.008 * (
        2 * study.stages.contacts.engineering.roller_force - 10000
    )
    for name, run in study.stages.drive.runs.items():
        damper = np.sum(run.weights * 3e3 * run.motion.elongation_rate**2)
        slid = np.sum(run.weights * np.abs(run.state.velocity))
        assert run.energy == pytest.approx(
            forces * slid + damper, rel=1e-4
        )  # samples are repeated where intervals join
        assert summary["laws"][name]["dynamic_amplification"] == run.peak_force / run.rigid.peak_force > 1.2
        assert summary["laws"][name]["energy_residual"] < 1e-6
    with (tmp_path / "out" / "dynamic-amplification.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["law"] for row in rows] == ["cubic", "septic"]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("included", [True, False], ids=["first-order", "steady"])
def test_added_mass_acts_on_the_elastic_drive_if_the_scene_includes_it(included):
    given = {
        "drive.kind": "elastic",
        "drive.stiffness": 1e6,
        "drive.damping": 3e3,
        "drive.include_added_mass": included,
        "motion.laws": ["cubic"],
        "accuracy.engine": "spectral",
        "accuracy.tolerance": 0.05,
        "machine.gap_geometry": "circle",
        "machine.roller_condition": "frictionless",
        "mix.overrides.relaxation_time": 0.005,
    }
    study = Study(scene(**given))
    run, resistance = study.stages.drive.runs["cubic"], study.stages.resistance.resistance
    state, slowest = run.state, run.trajectory.cart.knots[0]
    moves = np.abs(state.velocity) > slowest  # as resolved by the integration
    velocity, acceleration = state.velocity[moves], state.acceleration[moves]
    added = resistance(velocity, acceleration) - resistance(velocity)
    assert np.abs(added).max() > 1.0
    assert state.resistance[moves] - resistance(velocity) == pytest.approx(included * added, abs=1e-6)


MOTOR = {
    "curve": "kloss", "torque": 40.0, "speed": 157.0, "breakdown_slip": 0.15,
    "gear_ratio": 75.0, "inertia": 0.0, "flywheel_inertia": 50.0,
}  # fmt: skip


def test_motor_drive_of_a_scene_is_summarised(tmp_path):
    given = {
        "drive.kind": "motor",
        "drive.motor": MOTOR,
        "drive.carts": 2,
        "motion.laws": ["cubic", "crank", "gear-sector"],
    }
    study = Study(scene(**given, **{"output.items": ["tables", "reactions"]}, **STEP))
    summary = report.write_study(study, tmp_path / "out")
    forces = study.stages.resistance.resistance.force + 0.008 * (
        2 * study.stages.contacts.engineering.roller_force - 10000
    )
    along = Study(scene(**given, **{"output.items": []}))  # with a build-up the motor starts too
    assert len(list(along.stages.drive.tables())) == 1
    assert study.stages.drive.runs["cubic"].energy == pytest.approx(0.8 * forces, rel=1e-6)
    assert study.stages.drive.runs["crank"].state.rod_tangent.any()
    run = study.stages.drive.runs["cubic"]
    assert np.all(run.direction * run.state.velocity > -1e-9)
    assert summary["laws"]["gear-sector"]["peak_force"] == math.inf  # no motor follows a jump of velocity
    with (tmp_path / "out" / "motor.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["law"] for row in rows] == ["cubic", "crank"]
    assert float(rows[0]["work_of_a_cycle_J"]) == pytest.approx(2 * 0.8 * forces, rel=1e-6)
    assert summary["laws"]["cubic"]["fluctuation"] == pytest.approx(float(rows[0]["fluctuation"]), rel=1e-9)


HYDRAULICS = {
    "piston_area": 1e-3, "supply_pressure": 8e6, "pump_flow": 5e-4, "valve_area": 2e-5, "discharge_coefficient": 0.62,
    "oil_density": 870.0, "transition_drop": 1e3,
}  # fmt: skip


DRIVES = {
    "rigid": {},
    "elastic": {"drive.stiffness": 1e6, "drive.damping": 3e3},
    "motor": {"drive.motor": MOTOR, "drive.carts": 2},
    "hydraulic": {"drive.hydraulics": HYDRAULICS},
}


@pytest.mark.parametrize("kind", DRIVES)
def test_runs_of_every_drive_can_be_pickled(kind):
    study = Study(scene(**{"drive.kind": kind, "motion.laws": ["cubic", "crank"]}, **DRIVES[kind]))
    there = pickle.loads(pickle.dumps(study.stages.drive.runs))
    for name, run in study.stages.drive.runs.items():
        assert there[name].peak_force == run.peak_force
        assert np.array_equal(there[name].drive_power, run.drive_power)


def test_hydraulic_drive_of_a_scene_is_summarised(tmp_path):
    springs = {"stiffness": 4e3, "preload": 200.0, "length": 0.1}
    given = {"drive.kind": "hydraulic", "drive.hydraulics": HYDRAULICS, "drive.end_springs": springs}
    given |= {"motion.laws": ["cubic"]}
    study = Study(scene("small", **given, **{"output.items": ["tables", "crank"]}))
    summary = report.write_study(study, tmp_path / "out")
    rigid = Study(scene("small", **{"drive.end_springs": springs}))
    bare = Study(scene("small"))
    for name, entry in summary["laws"].items():
        assert entry["peak_force"] == pytest.approx(rigid.stages.drive.runs[name].peak_force, rel=1e-12)
        assert entry["energy"] == pytest.approx(bare.stages.drive.runs[name].energy, rel=1e-9)
        assert entry["energy_residual"] < 1e-6
    assert summary["laws"]["cubic"]["peak_pressure"] < rigid.stages.drive.runs["cubic"].peak_force / 1e-3 + 2e5
    best = study.stages.drive.rankings["peak_force"][0].run.name
    assert f"throttles/{best}.csv" in summary["files"]


def test_spread_of_the_force_follows_the_square_of_the_pressure():
    force = Study(scene()).stages.contacts.numbers["roller_force"]
    assert (force.low / force.value, force.high / force.value) == pytest.approx((1.5**-2, 1.5**2), rel=1e-12)


def test_spread_outside_the_range_of_the_formulas_is_omitted():
    study = Study(scene(**{"mix.overrides.effective_modulus": 0.5e6}))  # sin phi > 1 at the high end
    assert study.stages.contacts.numbers["roller_force"].high is None
    assert study.stages.contacts.numbers["roller_force"].low < study.stages.contacts.engineering.roller_force


def test_run_without_outputs_writes_the_summary_alone(tmp_path):
    study = Study(scene("small", **{"output.items": []}))
    summary = report.write_study(study, tmp_path / "out")
    assert summary["evaluation_counts"] == {"contact": 1, "laws": 3, "runs": 3, "rankings": 1}
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["scene.hash", "summary.json"]


def test_cycle_table_integrates_to_the_energy(written):
    study, _, directory = written
    with (directory / "cycles" / "cubic.csv").open() as stream:
        rows = [{name: float(cell) for name, cell in row.items()} for row in csv.DictReader(stream)]
    time, power = (np.array([row[name] for row in rows]) for name in ("time_s", "drive_power_W"))
    assert np.trapezoid(power, time) == pytest.approx(
        study.stages.drive.runs["cubic"].energy, rel=5e-4
    )  # trapezoidal rule on 129 points


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


def test_optimal_laws_rank_first():
    laws = ["reversal-2", "reversal-3-free-acceleration", "reversal-4-free-acceleration", "combined-4"]
    study = Study(scene(**{"motion.laws": laws, "motion.optimise": OPTIMISE}, **STEP))
    assert study.stages.drive.rankings["peak_force"][0].run.name == "least-peak-force"
    assert study.stages.drive.rankings["peak_power"][0].run.name == "least-peak-power"
    for objective in OPTIMISE["objectives"]:
        optimal = study.stages.laws.cycles[f"least-{objective.replace('_', '-')}"].forward
        assert getattr(study.stages.drive.runs[optimal.name], objective) == pytest.approx(optimal.value, rel=1e-4)
        assert study.stages.laws.limits.velocity is None  # the formulas do not depend on speed
    assert study.counts["laws"] == 6


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


def test_velocity_bound_of_the_scene_holds():
    given = Study(scene(**COLUMN)).stages.resistance.largest_speed
    held = Study(scene(**COLUMN, **{"motion.optimise": UNBOUNDED | {"velocity": given}}))
    assert held.stages.laws.cycles["least-peak-force"].forward.peaks().velocity == pytest.approx(given)
    assert held.stages.resistance.largest_speed == given  # nothing is computed beyond it


@pytest.mark.slow
def test_optimal_law_for_the_spread_of_the_mix_has_little_regret():
    made = OPTIMISE | {"objectives": ["peak_power"], "spread": ["required_pressure"]}
    study = Study(scene(**{"motion.laws": ["reversal-4"], "motion.optimise": made}, **STEP))
    low, high = (
        study.stages.laws.motion_resistances[k].resistance.force / study.stages.resistance.resistance.force
        for k in (1, 2)
    )
    assert low < 1 / 2.2 < 2.2 < high  # the force follows the square of the pressure
    assert 1 < study.stages.laws.cycles["least-peak-power"].forward.value < 1.05


@pytest.mark.slow
def test_cam_for_a_roller_has_the_profile_radius_of_the_scene():
    free, held = (
        Study(
            scene(
                **{
                    "motion.laws": ["cubic"],
                    "motion.optimise": {"objectives": ["peak_power"], "smoothness": 1} | limits,
                }
            )
        )
        for limits in ({}, {"profile_radius": 0.12})
    )
    assert free.stages.laws.cam("least-peak-power", "roller").undercut
    cam = held.stages.laws.cam("least-peak-power", "roller")
    assert not cam.undercut
    assert min(cam.least_radius_of_curvature, cam.least_hollow_radius) == pytest.approx(0.12, rel=1e-4)


def test_cam_of_a_given_law_requires_no_optimal_law():
    study = Study(scene(**{"motion.laws": ["cubic"], "motion.optimise": OPTIMISE}))
    study.stages.laws.cam("cubic", "flat")
    assert study.counts["laws"] == 1


INFEASIBLE = {
    "motion.laws": ["cubic", "reversal-4"], "motion.optimise": OPTIMISE | {"acceleration": 0.1},
    "output.items": ["tables", "report"],
}  # fmt: skip
NOT_MADE = "no law satisfies all limits; relax, the others unchanged: acceleration"


@pytest.mark.slow
def test_infeasible_bounds_omit_the_optimal_law_alone(tmp_path):
    study = Study(scene(**INFEASIBLE))
    with pytest.warns(UserWarning, match=NOT_MADE) as warnings:
        summary = report.write_study(study, tmp_path)
    assert [str(one.message).partition(" ")[0] for one in warnings] == ["least-peak-force", "least-peak-power"]
    bare = report.write_study(Study(scene(**INFEASIBLE | {"motion.optimise": None})), tmp_path / "bare")
    assert summary["files"] == bare["files"]
    assert all((tmp_path / file).exists() for file in summary["files"])
    assert list(summary["laws"]) == list(bare["laws"]) == ["cubic", "reversal-4"]
    assert list(summary["laws_not_made"]) == ["least-peak-force", "least-peak-power"]
    assert bare["laws_not_made"] == {}
    assert summary["laws_not_made"]["least-peak-force"].startswith(NOT_MADE)


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


def test_tabulated_law_is_ranked_with_the_published_laws(tmp_path):
    time = np.linspace(0, 3, 151)
    quintic = 0.4 * np.polyval([6, -15, 10, 0, 0, 0], time / 3)
    rows = "\n".join(f"{t:.6f},{x:.9f}" for t, x in zip(time, quintic, strict=True))
    (tmp_path / "mine.csv").write_text(f"# measured\ntime,travel\n{rows}\n")
    text = (SCENES / "small.toml").read_text().replace("rod_length", 'tables = ["mine.csv"]\nrod_length')
    (tmp_path / "scene.toml").write_text(text)
    study = Study(load_scene(tmp_path / "scene.toml", **{"drive.turn": "step"}))
    assert study.stages.drive.runs["mine"].peak_force == pytest.approx(
        study.stages.contacts.engineering.roller_resistance * 2 + 75.84 + 256.6, rel=1e-3
    )


@pytest.mark.parametrize(
    ("name", "changes", "law", "words"),
    [
        ("loveikin-2015", {}, "least-noise", "no motion law 'least-noise'; choose from cubic"),
        ("small", {"cam": None}, "cubic", r"cam: missing; a cam needs a table \[cam\]"),
    ],
)
def test_cam_without_a_law_or_a_table_is_refused(name, changes, law, words):
    study = Study(scene(name, **{"motion.laws": ["cubic"]}, **changes))
    with pytest.raises(ValueError, match=words):
        study.stages.laws.cam(law, "roller")


def test_broken_table_is_refused_with_its_name(tmp_path):
    (tmp_path / "mine.csv").write_text("0,0\n1,nonsense\n")
    text = (SCENES / "small.toml").read_text().replace("rod_length", 'tables = ["mine.csv"]\nrod_length')
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(SceneError, match=r"mine\.csv: not a table of time \[s\] and position \[m\]"):
        _ = Study(load_scene(tmp_path / "scene.toml")).stages.drive.runs


def test_formula_scene_loads_no_heavy_module(tmp_path):
    script = (
        "import sys; from compact.report import writer as report; from compact.scene.loader import load_scene;"
        "from compact.analysis.study import Study;"
        f"scene = load_scene({str(SCENES / 'small.toml')!r}, **{{'output.items': ['tables']}});"
        f"report.write_study(Study(scene), {str(tmp_path / 'out')!r});"
        "print(sorted({name.split('.')[0] for name in sys.modules}))"
    )
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    assert "scipy" in loaded
    for heavy in ("skfem", "meshio", "pyvista", "numba", "matplotlib", "vtk"):
        assert f"'{heavy}'" not in loaded


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
