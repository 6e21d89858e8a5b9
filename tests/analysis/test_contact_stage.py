"""Contacts of a scene: published cases, held quantity, resistance map and its reuse, shares after a turn."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from compact import files
from compact.analysis import contact_cases
from compact.analysis.stages import kept_results
from compact.analysis.stages.drives import build_stages
from compact.analysis.stages.resistance import sampled_shares
from compact.analysis.stages.uncertainty import SLEEVE, drive_variants
from compact.analysis.stages.verdict import contact_by_law, scenes_of_laws, spread_of
from compact.analysis.study import Study
from compact.engines import ENGINES
from compact.engines.column.engine import simulate_oedometer
from compact.engines.interface import Case
from compact.engines.spectral import engine as spectral
from compact.files import ResultsError
from compact.machine.drives import EDGE
from compact.material.laws import Viscoelastic
from compact.report import text
from compact.report import writer as report
from compact.report.tables import format_column
from compact.resistance import UNSTEADINESS_LIMIT
from compact.rolling_contact import Layer, Ply, Roller
from compact.scene.loader import load_scene
from compact.turning import StrokeResistance

# contact.md g: R .11 m, h .22 m bonded, E(t) = 10 + 10 exp(-t/tau) MPa, nu .3, depth 3 mm, frictionless, parabola
CASE_G = {
    "mix.overrides.effective_modulus": 10e6,
    "mix.overrides.poisson": 0.3,
    "mix.overrides.instant_over_relaxed": 2.0,
    "mix.overrides.relaxation_time": 0.1,
    "machine.roller_condition": "frictionless",
    "machine.gap_geometry": "parabola",
    "contact.indentation": 0.003,
}


SHALLOW = {"accuracy.engine": "fem", "contact.indentation": 0.003}


def study(**changes):
    return Study(load_scene("small", **changes))


def test_plies_of_a_scene_are_passed_to_the_engine():
    plies = [{"thickness": 0.2, "relative_modulus": 1.0}, {"thickness": 0.02, "relative_modulus": 20.0}]
    case = study(**CASE_G, **{"layer.plies": plies, "accuracy.engine": "spectral"})
    rolled = contact_cases.roll_scene(case.scene, case.stages.contacts.mix, 0.3)
    mix = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 0.1),))
    layer = Layer(0.22, plies=(Ply(thickness=0.2, stiffness=1.0), Ply(thickness=0.02, stiffness=20.0)))
    direct = spectral.roll(layer, Roller(0.11, indentation=0.003), mix, 0.3)
    assert (rolled.load, rolled.resistance) == pytest.approx((direct.load, direct.resistance), rel=1e-4)
    with pytest.raises(
        ValueError, match=r"the engine formula takes no `indentation` 0.003, as the depth of a contact on a half-plane"
    ):
        contact_cases.roll_scene(case.scene, case.stages.contacts.mix, 0.3, "formula")


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("rolling", "torque", "speed"),
    [("driven", 20.0, 0.1), ("driven", 20.0, -0.1), ("free", -20.0, 0.1)],
    ids=["motor", "motor on the return stroke", "bearings"],
)
def test_torque_of_the_scene_acts_on_the_whole_roller(rolling, torque, speed):
    free = study(**SHALLOW)
    turned = study(**SHALLOW, **{"machine.roller_condition": rolling, "machine.roller_torque": torque})
    rolled = contact_cases.roll_scene(turned.scene, turned.stages.contacts.mix, speed)
    pull = np.sign(speed) * torque / 1.164 / 0.11  # T/(L R)
    assert np.trapezoid(rolled.shear_traction, rolled.x) == pytest.approx(-pull, rel=2e-3)
    unloaded = contact_cases.roll_scene(free.scene, free.stages.contacts.mix, speed)
    assert rolled.resistance - unloaded.resistance == pytest.approx(-pull, rel=0.03)  # first order in the slope


def test_table_of_contacts_has_the_resistance_of_engine_and_formula(tmp_path):
    wanted = {"contact.speeds": [0.03, 0.3], "output.items": ["tables"]}
    case = study(**CASE_G, **wanted, **{"accuracy.engine": "spectral"})
    summary = report.write_study(case, tmp_path / "out")
    table = np.genfromtxt(tmp_path / "out" / "contact.csv", delimiter=",", names=True)
    assert table["load_Nm"] == pytest.approx([15386.4, 20455.8], rel=1e-5)
    assert table["resistance_Nm"] == pytest.approx([289.42, 392.89], rel=1e-4)
    assert table["formula_coefficient"] == pytest.approx(
        [case.stages.contacts.engineering.resistance_coefficient] * 2, rel=1e-11
    )
    assert summary["evaluation_counts"]["rolled"] == 2


@pytest.mark.parametrize(
    ("given", "height"), [({}, 0.22), ({"layer.lift_thickness": 0.06}, 0.06)], ids=["whole", "lift"]
)
def test_columns_give_the_height_and_density_of_the_product(given, height):
    case = study(**{"accuracy.engine": "column"}, **given)
    rolled = contact_cases.roll_scene(case.scene, case.stages.contacts.mix, 0.2)
    assert rolled.exit_height == pytest.approx(height, rel=1e-9 if not given else 1e-6)
    assert rolled.exit_density_ratio == pytest.approx(case.scene.mix.density_ratio, abs=1e-9 if not given else 1e-6)


def test_compaction_material_has_mohr_coulomb_strength_and_the_heckel_slope():
    case = study(**{"mix.overrides.friction_angle": 30.0, "mix.overrides.cohesion": 10e3})
    material = contact_cases.compaction_material(case.scene, case.stages.contacts.mix)
    assert material.critical_slope == pytest.approx(np.sqrt(3) / 2)
    assert material.tensile_strength == pytest.approx(10e3 * np.sqrt(3))
    stiff = replace(material, unloading_modulus=4e9, fed_density_ratio=0.9)  # negligible elastic strain
    pressure = np.array([130e3, 220e3])
    loosening = -np.log(1 - simulate_oedometer(stiff, pressure).density_ratio)
    assert np.diff(loosening) / np.diff(pressure) == pytest.approx(case.stages.contacts.mix.heckel_slope, rel=1e-3)


@pytest.mark.parametrize("name", ["column", "spectral", pytest.param("fem", marks=pytest.mark.slow)])
@pytest.mark.parametrize("ratio", [1.5, 5.0])
def test_every_contact_of_a_scene_has_an_error_estimate(name, ratio):
    case = study(**{"accuracy.engine": name, "layer.lift_thickness": 0.06, "mix.overrides.instant_over_relaxed": ratio})
    errors = contact_cases.roll_scene(case.scene, case.stages.contacts.mix, 0.033).error
    assert all(0 < error <= case.scene.accuracy.tolerance for error in errors)


# ---- Quantity held constant over speed, formulas for one contact, guide friction and return stroke


PLAIN = {"machine.roller_condition": "frictionless", "machine.gap_geometry": "circle", "accuracy.engine": "spectral"}
LIFT = {"accuracy.engine": "compaction", "layer.lift_thickness": 0.06, "mix.overrides.heckel_slope": 1.65e-5}


def values(study, name):
    return np.array([getattr(contact, name) for contact in study.stages.contacts.records])


# quantity held constant over speed


def test_height_is_held_at_every_speed_by_default():
    case = study(**PLAIN)
    depths, pressures = values(case, "indentation"), values(case, "peak_pressure")
    mean = [contact.speed for contact in case.stages.contacts.records].index(case.scene.mean_speed)
    assert case.stages.contacts.held.name == "height"
    assert depths == pytest.approx(case.stages.contacts.held.value, rel=1e-9)
    assert pressures[mean] == pytest.approx(case.stages.contacts.mix.required_pressure, rel=1e-6)
    assert np.all(np.diff(pressures) > 0)  # a stiffer layer at higher speed presses harder at the same height


@pytest.mark.parametrize(
    ("held", "name"), [("load", "load"), ("peak_pressure", "peak_pressure"), ("height", "indentation")]
)
def test_quantity_named_in_the_scene_is_held(held, name):
    case = study(**PLAIN, **{"contact.held": held})
    kept = values(case, name)
    assert kept == pytest.approx(kept[0], rel=1e-6)
    others = {"load", "peak_pressure", "indentation"} - {name}
    assert all(np.ptp(values(case, other)) > 0.02 * values(case, other)[0] for other in others)


@pytest.mark.parametrize(
    ("given", "name"), [({"contact.load": 9740.0}, "load"), ({"contact.peak_pressure": 1.5e5}, "peak_pressure")]
)
def test_prescribed_load_or_pressure_is_held_unless_the_scene_prescribes_height(given, name):
    case, at_height = study(**PLAIN, **given), study(**PLAIN, **given, **{"contact.held": "height"})
    (target,) = given.values()
    target /= case.scene.machine.roller_length if name == "load" else 1.0
    assert values(case, name) == pytest.approx(target, rel=1e-6)
    assert (case.stages.contacts.held.name, at_height.stages.contacts.held.name) == (name, "height")
    assert np.ptp(values(at_height, "indentation")) < 1e-9
    at_mean = [c for c in at_height.stages.contacts.records if c.speed == at_height.scene.mean_speed]
    assert getattr(at_mean[0], name) == pytest.approx(target, rel=1e-6)


def test_columns_hold_the_height_that_gives_the_density_at_the_mean_speed():
    case = study(**{"accuracy.engine": "column"})
    assert np.ptp(values(case, "indentation")) == 0
    densities = dict(zip(values(case, "speed"), values(case, "exit_density_ratio"), strict=True))
    assert densities[case.scene.mean_speed] == pytest.approx(0.98, abs=1e-9)
    assert values(case, "load")[-1] > 1.02 * values(case, "load")[0]  # rate effect at constant height


@pytest.mark.parametrize(
    "engine", ["column", "spectral", *(pytest.param(name, marks=pytest.mark.slow) for name in ("fem", "compaction"))]
)
def test_stated_height_is_that_of_every_contact_map_and_added_mass(engine, tmp_path):
    """Contacts, resistance map and added mass are those of rollers that prescribe the stated height themselves."""
    changes = {
        "column": {}, "spectral": PLAIN, "fem": {"accuracy.tolerance": 0.05},
        "compaction": LIFT | {"accuracy.tolerance": 0.02},
    }[engine]  # fmt: skip
    case = study(**changes | {"accuracy.engine": engine, "motion.laws": ["cubic"], "output.items": []})
    summary = report.write_study(case, tmp_path / "out")
    depth = summary["held"]["indentation"]["value"]
    assert f"{format_column([depth], 'm', 3)[0]} deep" in text.say("held", case)
    depths = np.array([contact["indentation"]["value"] for contact in summary["contacts"]])
    assert depths == pytest.approx(depth, rel=1e-9)

    speed, tolerance = 0.63 * case.stages.resistance.largest_speed, case.scene.accuracy.tolerance
    found = contact_cases.case_of(case.scene, case.stages.contacts.mix, case.scene.mean_speed)
    roller = replace(found.roller, indentation=depth, load=None, peak_pressure=None)
    own = Case(layer=found.layer, roller=roller, material=found.material, speed=speed, tolerance=tolerance)
    rolled = case.stages.contacts.engine.contact(own)
    length = case.scene.machine.rollers * case.scene.machine.roller_length
    tolerance = 2 * case.scene.accuracy.tolerance
    assert case.stages.resistance.resistance(speed) == pytest.approx(length * rolled.resistance, rel=tolerance)
    expected = case.stages.contacts.engine.expand(
        replace(own, speed=float(case.stages.resistance.resistance.speeds[-1]), tolerance=None)
    )
    if expected is not None:
        assert case.stages.resistance.resistance.added_masses[-1] == pytest.approx(
            length * expected.added_mass, rel=tolerance
        )
    if case.stages.contacts.engine.name == "compaction":
        assert len(case.stages.resistance.map.contacts) == 2


# one contact by formula


@pytest.mark.parametrize("prescribed", [{}, {"contact.load": 9740.0}, {"contact.peak_pressure": 1.5e5}])
def test_contact_by_formula_equals_the_engineering_summary(prescribed):
    case = study(**prescribed)
    (rolled,) = case.stages.contacts.passes_at(case.scene.mean_speed)
    length, formulas = case.scene.machine.roller_length, case.stages.contacts.engineering
    assert rolled.load * length == pytest.approx(formulas.roller_force, rel=1e-12)
    assert rolled.resistance * length == pytest.approx(formulas.roller_resistance, rel=1e-12)
    assert rolled.contact_length == pytest.approx(formulas.contact_length, rel=1e-12)
    if "contact.load" in prescribed:
        assert formulas.roller_force == pytest.approx(9740, rel=1e-12)
    if "contact.peak_pressure" in prescribed:
        assert rolled.peak_pressure == formulas.pressure == 1.5e5


# guide friction and return stroke


def test_drive_uses_the_guide_friction_of_the_scene_and_not_eq_1_9():
    case = study()
    net_force = 2 * case.stages.contacts.roller_load - case.scene.machine.weight
    assert float(case.stages.resistance.steady.guide_friction[0]) == pytest.approx(0.008 * net_force, rel=1e-9)
    run = case.stages.drive.runs["cubic"]
    assert float(case.stages.resistance.steady.drive_force[0]) == pytest.approx(run.steady_force, rel=1e-12)
    rollers = 2 * case.stages.contacts.engineering.roller_resistance
    assert case.stages.contacts.engineering.cart_resistance - rollers == pytest.approx(
        case.stages.contacts.engineering.guide_coefficient * net_force
    )
    assert "guide_friction 0.008" in text.say("guides", case)


def test_return_stroke_over_compacted_mix_halves_the_work_of_compaction():
    columns = {"accuracy.engine": "column", "mix.overrides.rate_sensitivity": 0.0, "drive.turn": "step"}
    fresh, compacted = study(**columns), study(**columns, **{"layer.return_stroke": "compacted"})
    load, _ = fresh.stages.contacts.second_pass
    stroke, friction, weight = 0.4, 0.008, fresh.scene.machine.weight
    there = abs(2 * fresh.stages.contacts.roller_load - weight)
    back = abs(2 * load * fresh.stages.contacts.roller_load - weight)
    mix = (
        float(fresh.stages.resistance.resistance(0.1, 0.0)) * stroke
    )  # without rate effect the resistance is independent of speed
    assert fresh.stages.drive.runs["cubic"].energy == pytest.approx(2 * mix + 2 * friction * there * stroke, rel=1e-6)
    energy = compacted.stages.drive.runs["cubic"].energy
    assert energy == pytest.approx(mix + friction * (there + back) * stroke, rel=1e-3)  # guide reactions of one sign


# ---- Resistance map of a scene: added mass, unsteady share, and reuse of stored contacts by the next run


ROLLED = PLAIN | {"motion.laws": ["cubic", "reversal-3"], "output.items": ["tables"]}


def of_scene(directory=None, **changes):
    return Study(load_scene("small", **ROLLED | changes), directory=directory)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Result directory of a run."""
    directory = tmp_path_factory.mktemp("kept") / "out"
    report.write_study(of_scene(), directory)
    return directory


@pytest.fixture
def left(written, tmp_path):
    """Copy of that directory."""
    return shutil.copytree(written, tmp_path / "out", copy_function=shutil.copyfile)


def test_unsteady_share_of_a_law_has_its_closed_form(left):
    """cubic: v = 6 s/T z(1-z), a = 6 s/T^2 (1-2z): |a| tau > 0.1 v where 1-2z > (T/tau)/10 z(1-z)."""
    share = json.loads((left / "summary.json").read_text())["laws"]["cubic"]["unsteady_share"]
    rate = UNSTEADINESS_LIMIT * 3.0 / of_scene().stages.contacts.mix.relaxation_time
    first = (2 + rate - np.sqrt(4 + rate**2)) / (2 * rate)  # 1 - 2z = rate z (1 - z)
    assert share == pytest.approx(2 * first, abs=0.02)


@pytest.mark.parametrize(
    "changes",
    [
        {"accuracy.engine": "column"},
        {"mix.overrides.instant_over_relaxed": 1.0},
        {"accuracy.engine": "compaction", "contact.indentation": 0.003},
    ],
    ids=["columns", "elastic", "compaction"],
)
def test_mix_without_relaxation_has_no_added_mass(changes):
    assert of_scene(**changes).stages.contacts.added_mass(0.1) == (0.0, 0.0)


def test_second_run_reuses_every_contact(left, written):
    study = of_scene(left)
    summary = report.write_study(study, left)
    assert study.counts["kept"] == 1
    assert not {"rolled", "resistance", "added mass"} & set(study.counts)
    assert summary["drive_resistance"]["kept"]
    for path in written.rglob("*.csv"):
        assert path.read_bytes() == (left / path.relative_to(written)).read_bytes()
    assert json.loads((written / "summary.json").read_text())["contacts"] == summary["contacts"]


def test_uncertainty_is_kept_for_the_same_scene_alone(tmp_path, monkeypatch):
    monkeypatch.setattr("compact.analysis.stages.uncertainty.SAMPLES", 64)
    rolled = {
        "accuracy.engine": "column",
        "contact.speeds": [0.05, 0.2],
        "layer.lift_thickness": 0.03,
        "motion.laws": ["quintic"],
    }
    scene = load_scene("small", **rolled, **{"output.items": ["report"]})
    first, again = (Study(scene, directory=tmp_path) for _ in range(2))
    other = Study(scene.replaced(**{"machine.mass": 900.0}), directory=tmp_path)
    assert first.uncertainty is not None
    monkeypatch.setattr("compact.analysis.stages.uncertainty.mix_spread", lambda *_: first.uncertainty.mix)
    list(first.keep(tmp_path, []))
    assert again.uncertainty == first.uncertainty != other.uncertainty
    assert [each.counts["uncertainty"] for each in (first, again, other)] == [1, 0, 1]


@pytest.mark.parametrize(
    ("changes", "reused"),
    [
        ({"motion.laws": ["septic"], "machine.mass": 900.0, "drive.kind": "crank"}, True),
        ({"mix.moisture": 0.11}, False),
        ({"accuracy.tolerance": 0.02}, False),
        ({"machine.roller_radius": 0.105}, False),
        ({"contact.indentation": 0.003}, False),
    ],
    ids=["laws, cart and drive", "moisture", "tolerance", "radius", "depth"],
)
def test_map_is_reused_after_changes_it_does_not_depend_on(written, changes, reused):
    assert (of_scene(written, **changes).stages.contacts.kept is not None) == reused


def test_faster_law_extends_the_map(written):
    before, study = (
        of_scene(written).stages.contacts.kept.resistance_map,
        of_scene(written, **{"motion.laws": ["septic"]}),
    )
    extended = study.stages.resistance.map
    assert extended.speeds[-1] == pytest.approx(2.1875 * 0.4 / 3, rel=1e-9)  # D: 35/16 of the mean
    assert study.counts["resistance"] <= 2
    assert "rolled" not in study.counts
    assert extended(before.speeds) == pytest.approx(before.forces, rel=1e-12)


@pytest.mark.parametrize("name", [kept_results.MAP_FILE, kept_results.CONTACTS_FILE])
def test_flipped_digit_is_told_and_computed_again(left, caplog, name):
    path = left / name
    content = path.read_bytes()
    at = next(place for place in range(len(content) // 2, len(content)) if content[place : place + 1].isdigit())
    path.write_bytes(content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :])  # another digit
    assert of_scene(left).stages.contacts.kept is None
    assert [record.getMessage().endswith("computed again") for record in caplog.records] == [True]


@pytest.mark.parametrize("name", [kept_results.MAP_FILE, kept_results.CONTACTS_FILE])
@pytest.mark.parametrize("content", [b"", b"{}", None], ids=["empty", "other", "gone"])
def test_damaged_files_are_not_reused(left, name, content):
    (left / name).unlink() if content is None else (left / name).write_bytes(content)
    assert of_scene(left).stages.contacts.kept is None


def test_results_of_an_edited_program_are_computed_again(left, caplog, monkeypatch):
    assert of_scene(left).stages.contacts.kept
    other = files.versions() | {"source": "edited"}
    monkeypatch.setattr(files, "versions", lambda: other)
    assert of_scene(left).stages.contacts.kept is None
    assert [record.getMessage() for record in caplog.records] == [
        f"{left / 'contacts.json'}: of another program, table or input; its contacts are computed again"
    ]


def test_results_of_another_scene_are_not_overwritten(left):
    with pytest.raises(ResultsError, match="holds results of another scene"):
        report.write_study(of_scene(left, **{"machine.mass": 900.0}), left)


def test_added_mass_of_a_cart_is_that_of_all_its_rollers():
    case = of_scene()
    resistance, machine = case.stages.resistance.resistance, case.scene.machine
    mass, time = case.stages.contacts.added_mass(float(resistance.speeds[-1]))
    assert resistance.added_masses[-1] == pytest.approx(machine.rollers * machine.roller_length * mass, rel=1e-12)
    assert resistance.relaxation_time == time == pytest.approx(case.stages.contacts.mix.relaxation_time)


# ---- Resistance along the stroke of a scene: shares by engine, table, figure, and the spread of the sleeve


FORMULA = {"accuracy.engine": "formula", "compare": None, "output.items": [], "motion.other_durations": None}
COLUMN = FORMULA | {
    "accuracy.engine": "column", "mix.overrides.heckel_slope": 15.228e-6, "layer.lift_thickness": 0.22,
    "layer.fed_density_ratio": 0.9343,
}  # fmt: skip


def stage(changes=FORMULA, **more):
    return build_stages(load_scene("loveikin-2015-engines", **changes, **more)).resistance


def build_up(changes=FORMULA, **more):
    return stage(changes, **{"drive.turn": "build-up"}, **more)


@pytest.mark.parametrize("changes", [FORMULA, COLUMN], ids=["formula", "column"])
def test_a_contact_without_wave_is_complete_where_the_axle_meets_the_edge(changes):
    found = build_up(changes).resistance
    assert isinstance(found, StrokeResistance)
    assert found.forward([0.0, 0.05, 0.11, 0.3]) == pytest.approx([0.02, 0.02, 1.0, 1.0])
    assert found.forward_load([0.05, 0.11]) == pytest.approx([0.25, 1.0])
    assert found(0.45, 0.0) == found.resistance(0.45, 0.0)  # far from the turn


def test_exponent_of_columns_is_that_of_their_own_force():
    found = build_up(COLUMN)
    speed = found.scene.mean_speed
    contact = min(found.contacts.records, key=lambda each: abs(np.log(each.speed / speed)))
    length, exponent, _ = found.turning.args
    depth = contact.indentation
    assert length == pytest.approx(np.sqrt(2 * 0.11 * depth))
    assert contact.peak_pressure * depth / (exponent + 1) == pytest.approx(contact.resistance, rel=1e-12)
    assert 0 < exponent < 1  # mix of 0.934 yields at once, at nearly half of the peak pressure


def test_bow_wave_of_the_contact_delays_the_build_up():
    contact = SimpleNamespace(indentation=2.13e-3, bow_wave=2.54e-3)
    share, load = ENGINES["compaction"].turning(contact, 0.11, 0.2e-3)(0.11)
    length = np.sqrt(2 * 0.11 * 2.13e-3)
    assert share.distance == pytest.approx(0.11 - length)
    at = share.distance + 0.5 * length
    assert share(at) == pytest.approx(2.13 / (2.13 + 2.54), rel=1e-3)  # 1 - B
    assert load(at) == pytest.approx(np.sqrt(2.13 / (2.13 + 2.54)), rel=1e-3)


@pytest.mark.parametrize("changes", [FORMULA | {"drive.turn": "step"}, FORMULA | PLAIN | {"drive.turn": "build-up"}])
def test_step_and_linear_layers_have_the_bare_resistance(changes):
    found = stage(changes)
    assert found.turning is None
    assert found.resistance == found.steady_law
    assert found.mean_share == 1.0


def test_table_covers_both_sides_and_the_release_of_the_old_force():
    found = build_up()
    rows = sampled_shares(found.resistance, found.cart, found.scene.motion)
    assert [side for side, *_ in rows] == ["forward", "return"]
    for _, travel, force, load in rows:
        assert (travel[0], travel[-1]) == (0.0, 0.4)
        assert force[0] == pytest.approx(-1.0, abs=1e-9)  # nothing jumps at the turn
        assert load[0] == pytest.approx(1.0, abs=1e-9)
        assert np.abs(np.diff(force)).max() < 0.25
    assert build_up().mean_share == pytest.approx(np.mean([np.trapezoid(f, t) / 0.4 for _, t, f, _ in rows]))


# the sleeve as an unknown


def test_assumed_sleeve_varies_from_open_to_midway_with_each_of_the_drive():
    scene = load_scene("loveikin-2015-engines", **FORMULA)
    found = drive_variants(scene, edges=True)
    alone = {each.label: each.keys[SLEEVE] for each in found if each.of == (EDGE,)}
    assert alone["open sleeve"] == pytest.approx((0.0264, 0.0264))
    assert alone["midway sleeve"] == pytest.approx((0.18, 0.18))  # half of 0.54 m less the sleeve
    assert sum(EDGE in each.of for each in found) == 2 + 2 * 6
    assert not any(EDGE in each.of for each in drive_variants(scene))


SMALL = Path(__file__).parents[2] / "compact" / "data" / "scenes" / "small.toml"


@pytest.mark.parametrize("engine", ["column", "compaction"])
@pytest.mark.parametrize("law", ["ellipse", "drucker-prager-cap"])
def test_every_law_of_compaction_has_the_saturation_limit_of_the_scene(law, engine):
    scene = load_scene(SMALL, **{"mix.law": law, "accuracy.engine": engine})
    limits = []
    for changed in (scene, scene.replaced(**{"mix.overrides.saturation_limit": 0.995})):
        case = contact_cases.case_of(changed, contact_cases.scene_mix(changed), 0.1, engine)
        limits.append(case.material.saturation_limit)
    assert limits == [0.998, 0.995]


@pytest.mark.slow
def test_ends_of_the_saturation_limit_change_the_resistance_of_a_lift():
    """By finite elements; an independent code has -6 % of it from 0.998 to 0.999."""
    lift = {"layer.lift_thickness": 0.06, "layer.fed_density_ratio": 0.93576, "contact.indentation": 0.003}
    case = study(**{"accuracy.engine": "compaction", "output.items": ["model_spread"]} | lift)
    own, *_, low, high = scenes_of_laws(case.scene, case.stages.contacts.mix)
    spread = spread_of([contact_by_law(case.stages.contacts.held, each) for each in (own, low, high)])
    assert [each.saturation_limit for each in spread.variants] == [0.995, 0.999]
    assert spread.variants[1].resistance == pytest.approx(1850 / 1960, abs=0.03)
    assert spread.variants[0].resistance > 1.05
