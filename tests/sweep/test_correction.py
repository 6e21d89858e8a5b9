"""Sweeps of columns corrected by finite elements at chosen points: designs, surfaces, errors, resumption, refusals."""

from functools import partial

import numpy as np
import pytest
import sweeps
import xarray

from compact.analysis.worker_pool import ProcessExecutor
from compact.report import sweep as sweep_report
from compact.scene.loader import load_scene
from compact.sweep import corrected
from compact.sweep import run as sweep
from compact.sweep.corrected import choose_points, connected_parts, fit_surface, inside_ellipsoid, inside_hull

THIN = {"accuracy.engine": "compaction", "layer.lift_thickness": 0.06, "contact.indentation": 0.002}
SCENE = load_scene("loveikin-2015", **THIN)
GRID = ("mix.moisture=0.08:0.12:6", "mix.density_ratio=0.95:0.98:6")
PLACES = np.array([(x, y) for x in np.linspace(0, 1, 6) for y in np.linspace(0, 1, 6)])


def swept(directory, scene=SCENE, varied=GRID, executor=None, **options):
    return sweeps.swept(directory, scene, varied, executor, **options)


# (a) chosen points


def test_chosen_points_include_the_corners_and_fill_the_square():
    chosen = choose_points(PLACES, 18)
    assert len(set(chosen)) == 18
    assert {(0, 0), (0, 1), (1, 0), (1, 1)} <= {tuple(place) for place in PLACES[chosen]}
    gaps = [min(np.hypot(*(place - PLACES[i])) for i in chosen) for place in PLACES]
    assert max(gaps) < 0.3
    assert choose_points(PLACES, 100, chosen)[:1] != chosen[:1]
    assert len(choose_points(PLACES, 100, chosen)) == 18


# (b) surfaces


@pytest.mark.parametrize(
    "function",
    [
        lambda x, y: 0.2 + 0.1 * x - 0.3 * y,
        lambda x, y: 0.2 + 0.1 * x - 0.3 * y * x + y**2,
        lambda x, y: np.exp(-4 * np.hypot(x - 0.3, y - 0.3)),
    ],
)
def test_error_of_a_surface_covers_all_points(function):
    chosen = choose_points(PLACES, 18)
    rounding = 1e-3 * np.random.default_rng(2015).standard_normal(36)
    values = function(*PLACES.T) + rounding
    surface = fit_surface(PLACES[chosen], values[chosen, None])
    assert np.abs(surface.values(PLACES)[:, 0] - values).max() < 3 * surface.errors[0]


@pytest.mark.parametrize(("count", "exact"), [(11, False), (12, True)])
def test_a_quadratic_function_is_exact_from_twice_its_coefficients_on(count, exact):
    values = 0.2 + PLACES[:, 0] - 0.5 * PLACES[:, 1] ** 2 + 0.3 * PLACES[:, 0] * PLACES[:, 1]
    chosen = choose_points(PLACES, count)
    surface = fit_surface(PLACES[chosen], values[chosen, None])
    assert (surface.errors[0] < 1e-9) == exact
    assert (np.abs(surface.values(PLACES)[:, 0] - values).max() < 1e-9) == exact


def test_no_surface_through_few_points_or_those_of_a_line():
    assert fit_surface(PLACES[[0, 5, 30, 35]], np.ones(4)) is None
    assert fit_surface(PLACES[:6], np.ones(6)) is None


def test_hull_excludes_a_corner_without_a_solution():
    solved = PLACES[PLACES.sum(axis=1) <= 1.2]
    assert (inside_hull(PLACES, solved) == (PLACES.sum(axis=1) <= 1.2 + 1e-9)).all()
    assert inside_hull(np.array([[0.5], [1.1]]), np.array([[0.0], [1.0]])).tolist() == [True, False]
    assert inside_ellipsoid(PLACES, PLACES[[0, 5, 30, 35]]).all()
    assert not inside_ellipsoid(PLACES, solved)[-1]


# (c) sweeps by substitutes of the engines


def columns_at(scene):
    """Results of a substitute for columns."""
    load = 1e4 * scene.mix.moisture * (scene.mix.overrides.heckel_slope or 1.0)
    resistance = 0.1 * load * scene.mix.density_ratio
    return {
        "load": load, "resistance": resistance, "resistance_coefficient": resistance / load,
        "power": 0.1 * resistance, "peak_pressure": 1e5, "load_error": 0.0, "resistance_error": 0.0,
    }  # fmt: skip


def factors_at(scene):
    """Ratio of two dimensions to columns, of load and resistance."""
    return np.exp(2 * scene.mix.moisture), np.exp(0.1 + 30 * (scene.mix.density_ratio - 0.96) ** 2)


@pytest.fixture
def solved(monkeypatch):
    """Substitutes for both engines; the list of contacts in two dimensions and their starts."""
    calls = []

    def headline(rank, scene, change):
        here = (scene.mix.moisture, scene.mix.density_ratio)
        found = columns_at(scene)
        if scene.accuracy.engine == "column":
            return found
        calls.append((here, change.start))
        if scene.mix.moisture > 0.1 and scene.mix.density_ratio > 0.97:
            return {"reason": "the mix heaps up", "contact": change.start}
        load, resistance = factors_at(scene)
        found |= {"load": load * found["load"], "resistance": resistance * found["resistance"]}
        found["resistance_coefficient"] *= resistance / load
        found["power"] *= resistance
        return found | {"load_error": 0.01, "resistance_error": 0.02, "work_residual": 1e-4, "contact": here}

    monkeypatch.setattr(sweep, "headline", headline)
    return calls


def test_columns_are_corrected_where_finite_elements_are_not_computed(solved, tmp_path):
    steps = []
    table, many = swept(tmp_path, step=lambda *step: steps.append(step))
    direct = (table.two_dimensions == "solved").values
    refused = (table.two_dimensions == "refused").values
    inside = (table.two_dimensions == "").values & (table.reason == "").values
    assert direct.sum() == 18  # the refused ones are replaced
    assert sum(points for points, _ in steps) == len(solved) == direct.sum() + refused.sum()
    assert refused.any()
    for index in np.argwhere(inside | direct):
        point = table.isel(moisture=index[0], density_ratio=index[1])
        there = SCENE.replaced(
            **{"mix.moisture": float(point.moisture), "mix.density_ratio": float(point.density_ratio)}
        )
        column, (load, resistance) = columns_at(there), factors_at(there)
        assert float(point["load"]) == pytest.approx(load * column["load"], rel=1e-9)
        error = float(point.resistance_surface_error)
        assert float(point.resistance) == pytest.approx(resistance * column["resistance"], rel=error + 1e-9)
        assert float(point.resistance_error) == pytest.approx(0.02 + error, abs=1e-12)
        assert float(point.resistance_coefficient) == pytest.approx(float(point.resistance) / float(point["load"]))
        assert float(point.power) == pytest.approx(0.1 * float(point.resistance))
        assert float(point.resistance_factor) == pytest.approx(resistance, rel=error + 1e-9)
    assert np.isnan(table.work_residual.values[inside]).all()
    outside = (table.two_dimensions == "").values & ~inside
    assert outside.any()
    assert all("beyond the hull of the 18 points" in reason for reason in table.reason.values[outside])
    assert (table.reason.values[refused] == "the mix heaps up").all()
    digest = sweep_report.sweep_digest(table, {})
    assert f"18 of {len(solved)} chosen points have a result in two dimensions; load 1.17 to 1.27 of columns" in digest
    assert "error of interpolation" in digest
    xarray.testing.assert_identical(sweep.read_sweep(tmp_path / "sweep.nc").astype(object), table.astype(object))
    assert many.store.computed == len(many.store.used) == 36 + len(solved)


# (e) finite elements


@pytest.mark.slow
def test_two_processes_give_the_same_bits_by_finite_elements(monkeypatch, tmp_path):
    monkeypatch.setattr(corrected, "connected_parts", partial(connected_parts, size=3))
    scene, varied = SCENE.replaced(**{"contact.indentation": 0.001}), ["mix.moisture=0.09:0.1:6"]
    one, _ = swept(tmp_path / "one", scene, varied, direct=5)
    two, _ = swept(tmp_path / "two", scene, varied, ProcessExecutor(2), direct=5)
    xarray.testing.assert_identical(one, two)
    assert (one.reason == "").all()
    left = one.where(one.two_dimensions == "", drop=True).isel(moisture=0)
    assert float(left.resistance_surface_error) < 0.02
    exact, _ = swept(tmp_path / "point", scene, [f"mix.moisture={float(left.moisture)}"])
    for name in ("load", "resistance"):
        allowed = float(left[f"{name}_error"])
        assert float(left[name]) == pytest.approx(float(exact[name][0]), rel=allowed)


def test_sweep_is_resumed_after_an_interruption(solved, tmp_path):
    whole, _ = swept(tmp_path / "whole")
    count = len(solved)

    def interrupt(points, _failed):
        if points:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        swept(tmp_path / "out", step=interrupt)
    kept = len(solved) - count
    assert kept == 5  # the first part of the chosen points
    table, many = swept(tmp_path / "out", resume=True)
    assert len(solved) == 2 * count
    assert many.store.computed == count - kept
    xarray.testing.assert_identical(table, whole)
    assert swept(tmp_path / "out", resume=True)[1].store.computed == 0
