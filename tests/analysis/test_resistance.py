"""The resistance map: closed forms, order, what it tells of itself, shape of data, files, what is kept, refusals."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compact.analysis import contact_stage, kept_results
from compact.analysis.study import Study
from compact.engines.spectral import engine as spectral
from compact.files import ResultsError
from compact.material.laws import Viscoelastic
from compact.report import writer as report
from compact.resistance import MAX_SAMPLES, UNSTEADINESS_LIMIT, ResistanceMap, load_resistance_map, sample_resistance
from compact.rolling_contact import Layer, Roller
from compact.scene.loader import load_scene


def relaxing(speed):
    """Of a layer that relaxes: rises with the speed, then falls."""
    return 800 * speed / (0.04 + speed**2), None


def mapped(resistance=relaxing, slowest=0.01, fastest=1.0, tolerance=1e-3, known=()):
    return sample_resistance(resistance, slowest, fastest, tolerance, known)


def true_error(resistance_map, resistance=relaxing, slowest=1e-5):
    speed = np.geomspace(slowest, resistance_map.speeds[-1], 2001)
    force = np.array([resistance(v)[0] for v in speed])
    return np.abs(resistance_map(speed) - force).max() / np.abs(force).max()


# (a) closed forms


@pytest.mark.parametrize("exponent", [0.0, 0.02, 1.0])
def test_power_law_is_kept_below_the_slowest_sample(exponent):
    law = mapped(lambda speed: (300 * speed**exponent, None), tolerance=1e-5)
    speed = np.array([1e-9, 1e-4, 0.01, 0.3, 1.0])
    assert law(speed) == pytest.approx(300 * speed**exponent, rel=1e-3)
    assert law(1e-9) == pytest.approx(300 * 1e-9**exponent, rel=2e-3)
    assert law.exponent == pytest.approx(exponent, abs=2e-5)


def test_resistance_without_speed_takes_five_samples_and_holds_at_rest():
    asked = []
    dry = mapped(lambda speed: (asked.append(speed) or 300.0, 0.01))
    assert len(asked) == len(dry.speeds) == 5
    assert (dry.error, dry.engine_error) == (0.0, 0.01)
    assert dry(np.array([-1.0, 0.0, 1e-15])).tolist() == [-300.0, 0.0, 300.0]


# contact.md e: the SLS Winkler foundation, kr = R = b = tau = 1, m = 1: v, F, M; the first two between table values
WINKLER = np.array([
    [0.03, 0.01868985, -0.551640], [0.1, 0.05309453, -0.323041], [0.3, 0.10107269, 0.004042],
    [0.5, 0.11235094, 0.051034], [1.0, 0.10445711, 0.030866], [3.0, 0.06130111, 0.003842],
])  # fmt: skip


def foundation():
    speeds, forces, masses = WINKLER.T
    return ResistanceMap(speeds, forces, 0.0, added_masses=masses, relaxation_time=1.0)


@pytest.mark.parametrize(
    ("velocity", "acceleration", "force", "most"),
    [(1.0, -0.03, 0.10355338, 3e-4), (1.0, 0.03, 0.10540707, 3e-4), (0.1, -0.03, 0.06090090, 0.08)],
)
def test_constant_acceleration_on_a_winkler_foundation(velocity, acceleration, force, most):
    """Within the limit to second order; beyond it closer than without M."""
    law = foundation()
    assert law(velocity, acceleration) == pytest.approx(force, rel=most)
    assert abs(law(velocity, acceleration) - force) < abs(law(velocity) - force) * (0.7 if most > 0.01 else 0.1)


def test_resistance_is_odd_in_velocity_and_acceleration_together():
    law, draw = foundation(), np.random.default_rng(2)
    velocity, acceleration = draw.uniform(-3, 3, 500), draw.uniform(-1, 1, 500)
    assert np.array_equal(law(-velocity, -acceleration), -law(velocity, acceleration))


def test_acceleration_counts_up_to_its_limit_and_no_further():
    law, velocity = foundation(), np.geomspace(1e-3, 3, 50)
    within = law(velocity, 0.5 * UNSTEADINESS_LIMIT * velocity) - law(velocity)
    at_limit = law(velocity, UNSTEADINESS_LIMIT * velocity) - law(velocity)
    assert at_limit == pytest.approx(2 * within, rel=1e-9, abs=1e-15)
    assert np.array_equal(law(velocity, 50.0 * velocity), law(velocity, UNSTEADINESS_LIMIT * velocity))
    assert law(0.0, 5.0) == 0
    assert abs(law(1e-9, 5.0)) < 1e-8
    assert law.is_unsteady(velocity, UNSTEADINESS_LIMIT * velocity * (1 + 1e-9)).all()
    assert not law.is_unsteady(velocity, UNSTEADINESS_LIMIT * velocity * (1 - 1e-9)).any()
    assert law.unsteadiness([0.0, 0.0, -2.0], [0.0, 1.0, -1.0]).tolist() == [0.0, np.inf, 0.5]


def test_mix_that_forgets_at_once_has_a_mass_without_limit():
    law = replace(foundation(), relaxation_time=0.0)
    assert law(0.1, 7.0) == pytest.approx(0.05309453 - 7 * 0.323041, rel=1e-12)
    assert not law.is_unsteady(1e-9, 1e9)


# (b) order, and what the map tells of itself


def test_error_falls_with_the_fourth_power_of_the_distance_between_samples():
    errors = []
    for count in (17, 33, 65):
        speeds = np.geomspace(1e-3, 1.0, count)
        errors.append(true_error(ResistanceMap(speeds, np.array([relaxing(v)[0] for v in speeds]), 0.0), slowest=1e-3))
    assert np.log2(np.array(errors[:-1]) / errors[1:]).min() > 3.5


@pytest.mark.parametrize("tolerance", [0.05, 0.01, 1e-3, 1e-4])
def test_tolerance_is_met_and_the_error_told_is_no_less_than_the_true_one(tolerance):
    law = mapped(tolerance=tolerance)
    assert true_error(law) <= law.error <= tolerance


def test_map_of_the_spectral_engine_tells_its_error():
    layer, roller, mix = Layer(0.22), Roller(0.11, 0.003), Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),))

    def resistance(speed):
        rolled = spectral.roll(layer, roller, mix, speed)
        return rolled.resistance, rolled.error[1]

    law = mapped(resistance, tolerance=0.01)
    speed = np.geomspace(1e-4, 1, 15)
    force = np.array([resistance(v)[0] for v in speed])
    assert np.abs(law(speed) - force).max() < law.error * force.max()
    assert law.engine_error < 1e-3


# (c) the shape of the data


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0, 1e4), min_size=4, max_size=12))
def test_map_is_monotone_where_the_samples_are(rises):
    speeds = np.geomspace(0.01, 1, len(rises))
    law = ResistanceMap(speeds, 1.0 + np.cumsum(rises), 0.0)
    force = law(np.geomspace(0.01, 1, 3001))
    assert np.diff(force).min() >= -1e-9 * force.max()


def test_resistance_is_odd_and_takes_arrays_of_any_shape():
    law, velocity = mapped(), np.linspace(-1, 1, 24).reshape(2, 3, 4)
    assert np.array_equal(law(-velocity, 0.0), -law(velocity, 0.0))
    assert law(velocity, np.zeros((5, 1, 1, 1))).shape == (5, 2, 3, 4)
    assert law(0.3) == law(np.array([0.3]))[0]
    assert law(np.array([])).shape == (0,)


def test_force_that_helps_at_low_speed_changes_its_sign_in_between():
    law = mapped(lambda speed: (300 * np.log(speed / 0.1), None))
    assert law(0.1) == pytest.approx(0, abs=1.0)
    assert law(0.02) < 0 < law(0.5)


# (d) cost


def test_known_samples_are_not_computed_again():
    known, asked = [(v, *relaxing(v)) for v in np.geomspace(1e-4, 1, 60).tolist()], []
    mapped(lambda speed: asked.append(speed) or relaxing(speed), known=known)
    assert asked in ([], [1.0])  # the last of a geomspace may miss 1 by rounding


# (e) files


def test_map_is_read_as_it_was_written(tmp_path):
    law = mapped(lambda speed: (*relaxing(speed)[:1], 0.013))
    law = replace(law, added_masses=np.cos(law.speeds), relaxation_time=0.3)
    law.save(tmp_path / "map.nc", "abc")
    read = load_resistance_map(tmp_path / "map.nc", "abc")
    assert np.array_equal([law.speeds, law.forces, law.added_masses], [read.speeds, read.forces, read.added_masses])
    assert (read.error, read.engine_error, read.relaxation_time) == (law.error, law.engine_error, 0.3)
    assert [path.name for path in tmp_path.iterdir()] == ["map.nc"]


def test_error_that_is_not_known_stays_unknown_in_the_file(tmp_path):
    mapped().save(tmp_path / "map.nc")
    read = load_resistance_map(tmp_path / "map.nc")
    assert (read.engine_error, read.added_masses) == (None, None)


def test_map_under_another_key_is_refused(tmp_path):
    mapped().save(tmp_path / "map.nc", "abc")
    with pytest.raises(
        ValueError, match=r"map\.nc: computed with key abc by compact .*, required def and .*; compute it again"
    ):
        load_resistance_map(tmp_path / "map.nc", "def")


def test_file_that_is_no_map_is_refused(tmp_path):
    (tmp_path / "map.nc").write_bytes(b"CDF")
    with pytest.raises(ValueError, match=r"map\.nc: no resistance map"):
        load_resistance_map(tmp_path / "map.nc")
    (tmp_path / "map.nc").write_bytes(b"no netCDF")
    with pytest.raises(ValueError, match=r"map\.nc: no resistance map: .* is not a valid NetCDF 3 file; compute it"):
        load_resistance_map(tmp_path / "map.nc")


# (f) of a scene, and what the next run takes over

SMALL = Path(__file__).parents[2] / "studies" / "scenes" / "small.toml"
ROLLED = {
    "accuracy.engine": "spectral",
    "machine.roller_condition": "frictionless",
    "machine.gap_geometry": "circle",
    "motion.laws": ["cubic", "reversal-3"],
    "output.items": ["tables"],
}


def of_scene(directory=None, **changes):
    return Study(load_scene(SMALL, **ROLLED | changes), directory=directory)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Where a run has left its results."""
    directory = tmp_path_factory.mktemp("kept") / "out"
    report.write_study(of_scene(), directory)
    return directory


@pytest.fixture
def left(written, tmp_path):
    """A copy of that directory."""
    copy = tmp_path / "out"
    copy.mkdir()
    for path in (path for path in written.rglob("*") if path.is_file()):
        place = copy / path.relative_to(written)
        place.parent.mkdir(exist_ok=True)
        place.write_bytes(path.read_bytes())
    return copy


def test_mass_of_a_cart_is_that_of_all_its_rollers():
    study = of_scene()
    met, machine = study.resistance, study.scene.machine
    mass, time = contact_stage.added_mass(study.scene, study.mix, float(met.speeds[-1]), study.held)
    assert met.added_masses[-1] == pytest.approx(machine.rollers * machine.roller_length * mass, rel=1e-12)
    assert met.relaxation_time == time == pytest.approx(study.mix.relaxation_time)


def test_share_beyond_first_order_is_told(left):
    """cubic: v = 6 s/T z(1-z), a = 6 s/T^2 (1-2z): |a| tau > 0.1 v where 1-2z > (T/tau)/10 z(1-z)."""
    told = json.loads((left / "summary.json").read_text())["laws"]["cubic"]["unsteady_share"]
    rate = UNSTEADINESS_LIMIT * 3.0 / of_scene().mix.relaxation_time
    first = (2 + rate - np.sqrt(4 + rate**2)) / (2 * rate)  # 1 - 2z = rate z (1 - z)
    assert told == pytest.approx(2 * first, abs=0.02)


@pytest.mark.parametrize(
    ("changes", "known"),
    [
        ({"accuracy.engine": "column"}, True),
        ({"mix.overrides.instant_over_relaxed": 1.0}, True),
        ({"accuracy.engine": "compaction", "contact.indentation": 0.003, "mix.reference_speed": 0.1}, False),
    ],
    ids=["columns", "elastic", "compaction that knows a rate"],
)
def test_mix_without_relaxation_has_no_mass(changes, known):
    study = of_scene(**changes)
    assert contact_stage.added_mass(study.scene, study.mix, 0.1, study.held) == ((0.0, 0.0) if known else None)


def test_next_run_rolls_nothing_and_writes_the_same(left, written):
    study = of_scene(left)
    summary = report.write_study(study, left)
    assert study.counts["kept"] == 1
    assert not {"rolled", "resistance", "added mass"} & set(study.counts)
    assert summary["drive_resistance"]["kept"]
    for path in written.rglob("*.csv"):
        assert path.read_bytes() == (left / path.relative_to(written)).read_bytes()
    assert json.loads((written / "summary.json").read_text())["contacts"] == summary["contacts"]


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
def test_map_is_kept_for_all_that_it_does_not_depend_on(written, changes, reused):
    assert (of_scene(written, **changes).kept is not None) == reused


def test_faster_law_adds_speeds_to_the_map(written):
    before, study = of_scene(written).kept.resistance_map, of_scene(written, **{"motion.laws": ["septic"]})
    met = study.resistance_map
    assert met.speeds[-1] == pytest.approx(2.1875 * 0.4 / 3, rel=1e-9)  # D: 35/16 of the mean
    assert study.counts["resistance"] <= 2
    assert "rolled" not in study.counts
    assert met(before.speeds) == pytest.approx(before.forces, rel=1e-12)


@pytest.mark.parametrize("name", [kept_results.MAP_FILE, kept_results.CONTACTS_FILE])
@pytest.mark.parametrize("content", [b"", b"{}", None], ids=["empty", "other", "gone"])
def test_broken_remains_are_not_taken(left, name, content):
    (left / name).unlink() if content is None else (left / name).write_bytes(content)
    assert of_scene(left).kept is None


def test_other_scene_is_not_written_over_for_the_sake_of_its_map(left):
    with pytest.raises(ResultsError, match="holds results of another scene"):
        report.write_study(of_scene(left, **{"machine.mass": 900.0}), left)


def test_density_of_a_kept_compaction_is_not_made_again(tmp_path):
    first, again = (of_scene(tmp_path / "out", **{"accuracy.engine": "column"}) for _ in range(2))
    report.write_study(first, tmp_path / "out")
    before = (tmp_path / "out" / "density.csv").read_bytes()
    assert {"passes.csv", "density.csv"} < set(report.write_study(again, tmp_path / "out")["files"])
    assert "rolled" not in again.counts
    (tmp_path / "out" / "density.csv").unlink()
    once_more = of_scene(tmp_path / "out", **{"accuracy.engine": "column"})
    report.write_study(once_more, tmp_path / "out")
    assert once_more.counts["rolled"] == 6
    assert (tmp_path / "out" / "density.csv").read_bytes() == before


# (g) refusals


def test_speed_beyond_the_samples_is_refused():
    with pytest.raises(ValueError, match=r"computed up to 1 m/s, got 1\.2 m/s; sample it over the speeds"):
        mapped()(np.array([0.1, -1.2]))


def test_scatter_that_no_samples_resolve_is_told():
    draw = np.random.default_rng(1)
    with pytest.raises(RuntimeError, match=r"have a cross-validation error of 0\.\d+ of the largest force, tolerance 0\.001"):
        mapped(lambda speed: (300 + draw.normal(), None))
    assert MAX_SAMPLES < 100


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tolerance": 0.0}, "`tolerance` must be positive"),
        ({"fastest": np.inf}, "`fastest` must be positive and finite"),
        ({"resistance": lambda speed: (np.nan, None)}, "`resistance` must be finite, got nan"),
    ],
)
def test_refusals(changes, words):
    with pytest.raises(ValueError, match=words):
        mapped(**changes)
