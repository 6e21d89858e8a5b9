"""Robust laws: simulation of a pool of drives, slopes of its histories, gain over the published laws."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from machine_cases import CART, dry, free, published_law
from published import CART_OF_C
from sampling import sampled

from compact.analysis.robust.drive_pool import DrivePool, from_the_middle, pass_table, travel_table
from compact.analysis.robust.law import INNER, Effort, PlantRange, between, robust_law
from compact.analysis.robust.program import LawSpace
from compact.analysis.stages.robust_range import plant_range
from compact.analysis.study import Study
from compact.machine.elastic_drive import ElasticDrive, simulate_elastic
from compact.motion.limits import Limits, violations
from compact.report.text import sentences
from compact.report.writer import study_summary
from compact.scene.loader import load_scene
from compact.turning import StrokeResistance, table_share, wave_shares

STROKE, DURATION = 0.4, 0.889  # [m], [s]
DEPTH, WAVE, RELEASE = 2.1e-3, 2.54e-3, 0.2e-3  # [m], of the published lift
PUBLISHED = ("cubic", "quintic", "cycloidal", "harmonic")


def along_stroke(edge=0.110, scale=1.0, length=0.026, wave=WAVE):
    """Resistance of 3486 N that rebuilds after a turn."""
    contact = length, DEPTH, wave, RELEASE, edge
    force, load = wave_shares(*contact)
    return StrokeResistance(lambda v, a: scale * dry(v, a), force, force, load, load)


def unequal(near, far):
    """Resistance whose fresh mix is met at different distances from both ends."""
    ends = along_stroke(near), along_stroke(far)
    force, load = zip(*((each.forward, each.forward_load) for each in ends), strict=True)
    return StrokeResistance(dry, *force, *load)


def rebuilt(release):
    share = table_share((0.0, 0.05), (0.1, 1.0), release=release)
    return StrokeResistance(dry, share, share, share, share)


def pool_peaks(cart, resistance, law, stiffness, ratio):
    """Peak force [N] and power [W] of one drive."""
    table = travel_table(cart, resistance, STROKE, law.peaks().velocity)
    pool = DrivePool.of(cart.mass, np.array([[stiffness, ratio]]), (table,))
    even = pass_table(law)
    found = pool.simulate(even)
    assert found.passes[0] > 0
    return found.peaks[0], np.abs(found.powers(even)).max()


@pytest.mark.parametrize(
    "cart",
    [
        CART,
        replace(CART_OF_C, guide_friction=0.1),
        replace(CART_OF_C, guide_friction=0.1, roller_positions=(0.3, -0.1)),
    ],
    ids=["rails without friction", "guides", "rollers out of the middle"],
)
@pytest.mark.parametrize(
    "resistance",
    [dry, rebuilt(0.0), rebuilt(1e-3), along_stroke(), along_stroke(0.0), along_stroke(0.180), unequal(0.026, 0.180)],
    ids=["step", "table", "table with release", "closed", "open", "midway", "open and midway"],
)
@pytest.mark.parametrize(("name", "stiffness", "ratio"), [("cycloidal", 1e6, 0.05), ("parabolic", 1e7, 0.1)])
def test_pool_agrees_with_the_elastic_drive(cart, resistance, name, stiffness, ratio):
    law = published_law(name, DURATION)
    drive = ElasticDrive(stiffness, 2 * ratio * np.sqrt(stiffness * cart.mass))
    run = simulate_elastic(cart, drive, law, resistance)
    force, power = pool_peaks(cart, resistance, law, stiffness, ratio)
    assert force == pytest.approx(run.peak_force, rel=1e-3)
    assert power == pytest.approx(run.peak_power, rel=2e-3)


SPRINGS_OF_A_POOL = np.array([(k, ratio) for k in (3e5, 1e6, 1e7) for ratio in (0.02, 0.1)])


def histories(resistance, name="cubic"):
    """Forces [N] of some springs under a law, shape (springs, sides, n + 1)."""
    law = published_law(name, DURATION)
    pool = DrivePool.of(CART.mass, SPRINGS_OF_A_POOL, (travel_table(CART, resistance, STROKE, law.peaks().velocity),))
    return pool.simulate(pass_table(law)).forces.reshape(len(SPRINGS_OF_A_POOL), pool.sides, -1)


def test_mirror_of_the_stroke_mirrors_the_histories():
    one, other = histories(unequal(0.090, 0.130)), histories(unequal(0.130, 0.090))
    assert one.shape[1] == 2
    assert np.abs(one - other[:, ::-1]).max() < 1e-4 * np.abs(one).max()  # of different passes, each closed to 3e-6
    assert np.abs(one[:, 0] - one[:, 1]).max() > 0.02 * np.abs(one).max()


@pytest.mark.parametrize("ratio", [0.02, 0.2, 1.5])
def test_response_is_the_drive_force_of_a_cart_without_resistance(ratio):
    space = LawSpace(Limits(jerk=200.0), STROKE, DURATION, 1000.0)
    table = travel_table(replace(CART, mass=1000.0), free, STROKE, 1.0)
    found = DrivePool.of(1000.0, np.array([[1e6, ratio]]), (table,)).simulate(space.table(space.start))
    linear = space.response(1e6, 2 * ratio * np.sqrt(1e9)) @ space.start
    assert np.abs(found.forces[0] - linear).max() < 1e-3 * np.abs(linear).max()


def test_stiff_drives_without_mix_need_twice_the_mean_acceleration(monkeypatch):
    monkeypatch.setattr("compact.analysis.robust.law.FRESH_DRIVES", 50)
    plants = PlantRange((1e9, 2e9), (0.1, 0.2), (free,))
    cart = replace(CART, mass=1000.0)
    found = robust_law(cart, plants, STROKE, DURATION, Limits(), effort=Effort((2, 2), 3, 2, PUBLISHED[:2]))
    least = 4 * 1000.0 * STROKE / DURATION**2
    assert least <= found.worst.peak < 1.1 * least  # of a law whose acceleration is continuous
    assert found.worst.peak < found.published_worst.peak


def test_program_bounds_the_law_from_below():
    space = LawSpace(Limits(jerk=200.0), STROKE, DURATION, 1000.0)
    responses = [space.response(k, 2 * 0.05 * np.sqrt(k * 1000.0)) for k in (5e5, 2e6)]
    histories = np.array([response @ space.start for response in responses])
    step = space.minimise(space.start, histories, responses, set())
    moved = [response @ (space.start + step.change) for response in responses]
    assert np.abs(moved).max() == pytest.approx(step.value, rel=1e-6)
    assert step.value < np.abs(histories).max()
    assert 0 <= step.gap + 1e-9 < 1e-6


@pytest.mark.parametrize("objective", sampled(["robust_peak_force", "robust_peak_power"], ["robust_peak_force"]))
def test_robust_law_halves_the_worst_peak_of_a_narrow_range(objective, monkeypatch):
    monkeypatch.setattr("compact.analysis.robust.law.FRESH_DRIVES", 50)
    plants = PlantRange((8e5, 2e6), (0.05, 0.1), (along_stroke(),))
    limits = Limits(acceleration=8.0, jerk=200.0)
    effort = Effort((4, 2), 5, 1, PUBLISHED[:2])
    found = robust_law(CART, plants, STROKE, DURATION, limits, objective=objective, effort=effort)
    assert violations(limits, found.motion) == {}
    assert found.gains
    assert found.ratio < 0.6
    assert found.gap < 1e-6
    assert found.published in PUBLISHED
    assert found.worst.peak >= found.mean
    drive = ElasticDrive(
        found.worst.stiffness, 2 * found.worst.damping_ratio * np.sqrt(found.worst.stiffness * CART.mass)
    )
    run = simulate_elastic(CART, drive, found.motion, along_stroke())
    peak = run.peak_force if objective == "robust_peak_force" else run.peak_power
    assert peak == pytest.approx(found.worst.peak, rel=2e-3)


SCENE = Path(__file__).parents[2] / "compact" / "data" / "scenes" / "loveikin-2015-engines.toml"
FORMULA = {
    "accuracy.engine": "formula", "compare": None, "output.items": [], "motion.other_durations": None,
    "motion.laws": ["parabolic", "quintic"],
    "motion.optimise": {"objectives": ["robust_peak_force"], "smoothness": 2, "jerk": 200.0},
}  # fmt: skip


def test_robust_law_of_a_scene_spans_what_is_known_of_its_drive(monkeypatch):
    monkeypatch.setattr(Effort.__init__, "__defaults__", ((2, 2), 2, 0, ("quintic",)))
    monkeypatch.setattr("compact.analysis.robust.law.FRESH_ROUNDS", 0)
    study = Study(load_scene("loveikin-2015-engines", **FORMULA, **{"drive.turn": "build-up"}))
    stages = study.stages
    assert list(stages.laws.cycles) == ["parabolic", "quintic", "robust-peak-force"]
    found = stages.laws.robust["robust-peak-force"]
    assert found.plants.stiffness == pytest.approx((1e6 / 3, 3e6))
    assert found.plants.damping_ratio == pytest.approx((0.02, 0.2))
    distances = [each.forward.distance for each in found.plants.resistances]
    assert len(distances) == 3
    assert distances == sorted(distances)
    assert stages.drive.runs["robust-peak-force"].peak_force < found.worst.peak
    sentence = sentences("robust", study)[-1]
    assert sentence.startswith(f"robust-peak-force: at most {found.worst.peak / 1e3:.2f} kN over elastic drives of")
    assert "3.3e+05 to 3e+06 N/m, damping ratios of 0.02 to 0.2 and 3 resistances" in sentence
    assert "best published law over the same: quintic" in sentence
    stored = study_summary(study, [])["robust_laws"]["robust-peak-force"]
    assert (stored["worst"]["peak"]["value"], stored["best_published"]["law"]) == (found.worst.peak, "quintic")
    assert stored["worst"]["own_tracks"]["value"] == [found.worst_resistance.forward.distance] * 2
    assert stored["worst"]["force_at_mean_speed"]["value"] == pytest.approx(3486, rel=1e-3)
    assert stored["best_published"]["peak"]["value"] == found.published_worst.peak


@pytest.mark.parametrize(
    ("line", "places"),
    [
        ("0.110  # m; measured ± 5 mm", {(0.105, 0.105), (0.110, 0.110), (0.115, 0.115)}),
        (
            "[0.100, 0.150]  # m; measured ± 5 mm",
            {(0.095, 0.145), (0.095, 0.155), (0.1, 0.15), (0.105, 0.145), (0.105, 0.155)},
        ),
        (
            "[0.100, 0.150]  # m; given ± 10 %",
            {(0.09, 0.135), (0.09, 0.165), (0.1, 0.15), (0.11, 0.135), (0.11, 0.165)},
        ),
    ],
    ids=["both ends", "each end in mm", "each end in percent"],
)
def test_each_end_has_its_distance_to_fresh_mix_with_its_spread(tmp_path, line, places):
    words = re.sub(r"(?m)^sleeve_distance = .*$", f"sleeve_distance = {line}", SCENE.read_text("utf-8"))
    (tmp_path / "scene.toml").write_text(words, "utf-8")
    study = Study(load_scene(tmp_path / "scene.toml", **FORMULA, **{"drive.turn": "build-up"}))
    stage = study.stages.resistance
    steady = [stage.motion_resistance.resistance]
    found = plant_range(study.scene, stage, steady)
    ends = sorted((each.forward.distance, each.backward.distance) for each in found.resistances)
    contact_length = np.array(sorted(places)) - np.array(ends)
    assert contact_length == pytest.approx(np.full(contact_length.shape, contact_length[0, 0]), rel=1e-9)
    assert len(found.inner) == (INNER if len(ends) > 1 else 0)
    inside = np.array([(each.forward.distance, each.backward.distance) for each in found.inner] or ends)
    assert np.all(inside >= np.min(ends, axis=0))
    assert np.all(inside <= np.max(ends, axis=0))


def test_robust_law_is_left_out_with_a_reason():
    stages = Study(
        load_scene("loveikin-2015-engines", **FORMULA, **{"drive.backlash": 1e-3, "motion.dwell": 0.1})
    ).stages
    with pytest.warns(UserWarning, match="not made: a robust law requires no backlash and no dwell"):
        assert list(stages.laws.cycles) == ["parabolic", "quintic"]


# shares of the worst peak of the best published law, bow wave, and samples of F over 3486 N and D [m]
TARGETS = {
    "open": (0.53, WAVE, [(1.0, 0.026)]),
    "closed": (0.40, WAVE, [(1.0, 0.110)]),
    "midway": (0.34, WAVE, [(1.0, 0.180)]),
    "thin make-up": (0.38, 0.13 * DEPTH, [(1.0, 0.110)]),
    "force 10 %, distance 5 mm": (
        0.75, WAVE, [(0.9, 0.105), (0.9, 0.115), (1.0, 0.110), (1.1, 0.105), (1.1, 0.115)],
    ),
    "force over the spread of the mix": (0.78, WAVE, [(0.64, 0.110), (1.0, 0.110), (1.43, 0.110), (1.86, 0.110)]),
}  # fmt: skip
RAILS = replace(
    CART, mass=1000.0, weight=1600.0, guide_friction=0.05, guide_wheel_diameter=0.0, pin_height=-CART.roller_radius,
    roller_reactions=(0.0, 0.0),
)  # fmt: skip


def judging_drives():
    """Grid of 300 and 200 random drives: k [N/m] and damping ratio [-]."""
    grid = np.array([(k, ratio) for ratio in np.geomspace(0.02, 0.2, 5) for k in np.geomspace(3e5, 1e7, 60)])
    random = np.random.default_rng(2029).uniform(np.log([3e5, 0.02]), np.log([1e7, 0.2]), (200, 2))
    return np.concatenate([grid, np.exp(random)])


def worst_peak(law, resistances):
    """Worst peak [N] of a law over the judging drives with every resistance."""
    tables = tuple(travel_table(RAILS, each, STROKE, 1.0) for each in resistances)
    pool = DrivePool.of(RAILS.mass, judging_drives(), tables, range(len(tables)))
    return pool.simulate(pass_table(law)).peaks.max()


LONG = "force 10 %, distance 5 mm"  # two minutes


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.nightly if name == LONG else pytest.mark.slow) for name in TARGETS]
)
def test_robust_law_of_a_wide_range_of_drives(name):
    """F and D that judge are inside the range, neither samples nor judges of the search."""
    target, wave, samples = TARGETS[name]
    ends, fresh = (min(samples), max(samples)), []
    inner = between(*ends) if len(samples) > 1 else []
    if len(samples) > 1:
        fresh = np.random.default_rng(2029).uniform(*ends, (8, 2))
    samples, inner, fresh = (
        [along_stroke(edge, force, 0.015 if wave < DEPTH / 2 else 0.026, wave) for force, edge in each]
        for each in (samples, inner, fresh)
    )
    plants = PlantRange((3e5, 1e7), (0.02, 0.2), samples, inner)
    found = robust_law(RAILS, plants, STROKE, DURATION, Limits(jerk=200.0))
    worst = worst_peak(found.motion, [*samples, *fresh])
    published = worst_peak(published_law(found.published, DURATION), [*samples, *fresh])
    assert worst <= target * published
    assert worst <= 1.02 * found.worst.peak
    assert found.gap < 1e-6


def test_robust_law_of_unequal_ends_is_that_of_the_mirrored_stroke(monkeypatch):
    """Without fresh drives, of which others would join either search where two peaks are equal but for rounding."""
    monkeypatch.setattr("compact.analysis.robust.law.FRESH_ROUNDS", 0)
    one, other = (
        robust_law(
            CART, PlantRange((8e5, 2e6), (0.05, 0.1), (unequal(*ends),)), STROKE, DURATION, Limits(jerk=200.0),
            effort=Effort((4, 2), 3, 1, PUBLISHED[:2]),
        )
        for ends in ((0.090, 0.130), (0.130, 0.090))
    )  # fmt: skip
    assert one.worst.peak == pytest.approx(other.worst.peak, rel=1e-4)
    assert one.published_worst.peak == pytest.approx(other.published_worst.peak, rel=1e-4)
    assert (one.published, one.gains) == (other.published, True)
    z = np.linspace(0, 1, 41)
    assert np.abs(one.motion.at_phase(z, 0) - other.motion.at_phase(z, 0)).max() < 1e-3 * STROKE


def test_pass_from_the_middle_is_opposite_on_the_return_stroke():
    values = np.arange(5.0)
    assert from_the_middle(values).tolist() == [2.0, 3.0, 4.0, -1.0, -2.0]
