"""Sweeps: results independent of the executor, resumption, failed points, bands, maps and the command."""

import gc
import json
import os
import signal
from functools import partial
from itertools import product
from multiprocessing import active_children
from pathlib import Path

import numpy as np
import pytest
import xarray
from interrupts import of_unix
from sweeps import COLUMNS, FORMULA, swept

from compact import files
from compact.analysis.stages import ensemble
from compact.analysis.stages.ensemble import Change, compute
from compact.analysis.study import Study
from compact.analysis.worker_pool import DaskExecutor, ProcessExecutor, run_tasks
from compact.files import ResultsError
from compact.material.mix import prior
from compact.report import sweep as sweep_report
from compact.scene.loader import load_scene, parse_scene
from compact.scene.new_scene import starter_scene
from compact.sweep import run as sweep
from compact.sweep import sobol_indices

GRID = ("mix.moisture=0.08:0.12:4", "mix.density_ratio=0.94:0.98:3")
PAIR = ("mix.moisture=0.1,0.11",)


def test_the_load_of_the_starter_falls_with_water_as_that_of_the_prior(tmp_path):
    fitted = load_scene("loveikin-2015-engines").with_engine("column")
    fitted = fitted.replaced(**{"motion.duration": 3.0, "motion.other_durations": ()})  # of the fit
    starter = parse_scene(starter_scene()).replaced(**{"output.items": [], "accuracy.engine": "column"})
    loads = {}
    for name, scene in (("fitted", fitted), ("prior", starter)):
        table, _ = swept(tmp_path / name, scene, ["mix.moisture=0.08:0.12:5", "mix.density_ratio=0.95:0.98:2"])
        loads[name] = table["load"].sel(density_ratio=0.98).values
        assert (np.diff(table["load"].values, axis=0) < 0).all()
        assert (np.diff(table["load"].values, axis=1) > 0).all()
    ratios = {name: values / values[2] for name, values in loads.items()}
    assert ratios["fitted"] == pytest.approx(ratios["prior"], rel=0.05)
    assert loads["fitted"][2] == pytest.approx(9740, rel=1e-3)
    slopes = [prior(moisture, 0.98).heckel_slope for moisture in np.linspace(0.08, 0.12, 5)]
    assert ratios["prior"] == pytest.approx(slopes[2] / np.array(slopes), rel=0.05)
    remarks = set(swept(tmp_path / "again", fitted, ["mix.moisture=0.09,0.10"])[0]["replaced"].values)
    assert sum("scaled by the prior: effective_modulus, heckel_slope" in remark for remark in remarks) == 1


@pytest.fixture
def small_tasks(monkeypatch):
    """Three points per task, so that several tasks can be interrupted."""
    monkeypatch.setattr(sweep.ENGINES["column"], "points_per_task", 3)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return swept(tmp_path_factory.mktemp("whole"), COLUMNS, GRID)[0]


@pytest.fixture(scope="module")
def cluster():
    """Scheduler with one worker, in processes of their own."""
    from distributed import LocalCluster

    options = {"threads_per_worker": 1, "processes": True, "dashboard_address": ":0", "host": "127.0.0.1"}
    with LocalCluster(n_workers=1, **options) as scheduler:
        yield scheduler.scheduler_address


# (a) points


def test_points_are_those_of_single_studies(whole, tmp_path):
    there = COLUMNS.replaced(**{"mix.moisture": 0.12, "mix.density_ratio": 0.96})
    rolled = Study(there).stages.contacts.roll(0.4 / 3)[0]
    point = whole.sel(moisture=0.12, density_ratio=0.96)
    assert float(point["load"]) == 1.164 * rolled.load
    assert float(point.resistance) == 2 * 1.164 * rolled.resistance
    assert float(point.power) == pytest.approx(float(point.resistance) * 0.4 / 3)
    assert float(point.exit_density_ratio) == pytest.approx(0.96, abs=1e-9)
    assert (whole.reason == "").all()
    free = FORMULA.replaced(**{"machine.roller_condition": "free"})
    published, _ = swept(tmp_path, free, ["mix.moisture=0.1"])
    assert float(published["load"][0]) == pytest.approx(9740, rel=1e-6)
    assert float(published.resistance_coefficient[0]) == pytest.approx(0.178961, rel=1e-5)


def test_table_is_labelled_and_identical_when_read_back(tmp_path):
    varied = ["mix.moisture=0.1,0.11", "layer.base=bonded,slip", "mix.overrides.poisson=~2"]
    table, _ = swept(tmp_path, COLUMNS, varied)
    back = sweep.read_sweep(tmp_path / "sweep.nc")
    xarray.testing.assert_identical(back.astype(object), table.astype(object))
    assert back.moisture.attrs["key"] == "mix.moisture"
    assert back["load"].attrs == {"units": "N", "long_name": "normal force on one roller"}
    assert json.loads(back.attrs["scene"])["machine"]["mass"] == 1000
    assert json.loads(back.attrs["versions"])["numpy"] == np.__version__
    assert 'layer.base: the engine "column" takes no "slip"' in back.reason.sel(base="slip").values.ravel()[0]


def test_laws_are_ranked_at_every_point(tmp_path):
    scene = FORMULA.replaced(**{"motion.laws": ["parabolic", "septic"]})
    table, _ = swept(tmp_path, scene, ["mix.moisture=0.09,0.1"], rank=True)
    place = Study(scene).stages.drive.rankings["peak_power"][0]
    assert table.best_law_by_peak_power.values[1] == place.run.name
    assert float(table.peak_power[1]) == place.value
    assert table.peak_power.attrs["units"] == "W"


# (b) results are independent of the executor


@pytest.mark.slow
@pytest.mark.usefixtures("small_tasks")
def test_cluster_gives_the_same_bits(whole, cluster, tmp_path):
    table, many = swept(tmp_path, COLUMNS, GRID, DaskExecutor(cluster))
    assert many.store.computed == 12
    xarray.testing.assert_identical(table, whole)


@of_unix
@pytest.mark.slow
@pytest.mark.usefixtures("small_tasks")
def test_two_processes_give_the_same_bits_though_one_is_killed(whole, tmp_path):
    executor, killed, others = ProcessExecutor(2), [], active_children()

    def kill(points, failed):
        if points and not killed:
            killed.append(next(each.pid for each in active_children() if each not in others))
            os.kill(killed[0], signal.SIGKILL)

    table, _ = swept(tmp_path, COLUMNS, GRID, executor, step=kill)
    assert (len(killed), executor.deaths) == (1, 1)
    xarray.testing.assert_identical(table, whole)


def task(scene, points, versions):
    return scene, partial(sweep.headline, False), versions, ([Change("", keys) for keys in points], ())


# (c) resumption


@pytest.mark.sampled(1)
@pytest.mark.usefixtures("small_tasks")
@pytest.mark.parametrize(
    "damage", [lambda content: content[:-40], lambda content: b"", lambda content: content.replace(b"0.9", b"0.8", 1)]
)
def test_damaged_file_alone_is_recomputed(damage, whole, tmp_path):
    swept(tmp_path, COLUMNS, GRID)
    kept = sorted((tmp_path / "points").iterdir())
    assert len(kept) == 4
    kept[-1].write_bytes(damage(kept[-1].read_bytes()))
    table, many = swept(tmp_path, COLUMNS, GRID, resume=True)
    assert (many.store.computed, many.store.broken) == (3, [kept[-1].name])
    xarray.testing.assert_identical(table, whole)


@pytest.mark.usefixtures("small_tasks")
def test_interrupted_sweep_is_resumed(whole, tmp_path):
    seen = []

    def stop(points, failed):
        seen.append(points)
        if sum(seen) == 6:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        swept(tmp_path, COLUMNS, GRID, step=stop)
    assert not (tmp_path / "sweep.nc").exists()
    table, many = swept(tmp_path, COLUMNS, GRID, resume=True)
    assert many.store.computed == 6
    xarray.testing.assert_identical(table, whole)
    assert swept(tmp_path, COLUMNS, GRID, resume=True)[1].store.computed == 0


def test_new_points_and_those_of_other_versions_are_computed(monkeypatch, tmp_path):
    swept(tmp_path, COLUMNS, PAIR)
    assert swept(tmp_path, COLUMNS, ["mix.moisture=0.1,0.11,0.12"], resume=True)[1].store.computed == 1
    other = files.versions() | {"source": "changed"}
    for module in (files, ensemble):
        monkeypatch.setattr(module, "versions", lambda: other)
    again = swept(tmp_path, COLUMNS, PAIR, resume=True)[1].store
    assert (again.computed, len(again.known.keys() - again.used)) == (2, 3)


def test_existing_points_require_resume_or_force(tmp_path):
    swept(tmp_path, COLUMNS, PAIR)
    with pytest.raises(ResultsError, match="holds 2 points of this scene; --resume uses them, --force"):
        swept(tmp_path, COLUMNS, PAIR)
    with pytest.raises(ResultsError, match="holds results of another scene"):
        swept(tmp_path, FORMULA, PAIR)
    assert swept(tmp_path, COLUMNS, ["mix.moisture=0.1"], force=True)[1].store.computed == 1


def test_points_of_an_edited_scene_file_are_computed_and_those_before_the_edit_are_kept(tmp_path, caplog):
    file = tmp_path / "scene.toml"
    before = starter_scene().replace('engine = "auto"', 'engine = "formula"')
    after = before.replace("duration = 3.0", "duration = 2.5")
    for text, resume, computed in ((before, False, 2), (after, False, 2), (before, True, 0)):
        file.write_text(text)
        assert swept(tmp_path / "out", load_scene(file), PAIR, resume=resume)[1].store.computed == computed
    assert [message.partition(": ")[2] for message in caplog.messages] == [
        "results of the scene before its edit are replaced"
    ] * 2


# (d) points without numbers


def test_failed_point_is_masked_with_its_reason_and_counted(tmp_path):
    scene, steps = COLUMNS.replaced(**{"layer.fed_density_ratio": 0.94}), []
    table, _ = swept(tmp_path, scene, ["mix.density_ratio=0.92:0.98:4"], step=lambda *step: steps.append(step))
    assert np.isnan(table["load"].values).tolist() == [True, True, False, False]
    assert "layer.fed_density_ratio: must be below mix.density_ratio = 0.94, got 0.94" in table.reason.values[1]
    assert (table.reason.values[2:] == "").all()
    assert steps == [(0, 0), (4, 2)]
    digest = sweep_report.sweep_digest(table, {})
    assert "4 points by column, 2 without numbers" in digest
    assert "without numbers: 2 x " in digest


# (e) continuation


def test_each_line_starts_from_scratch_and_continues_from_point_to_point(monkeypatch, tmp_path):
    scene, starts = COLUMNS.replaced(**{"accuracy.engine": "compaction"}), []

    def recorded(rank, there, change):
        starts.append(change.start)
        return {"load": 1.0, "contact": (there.mix.moisture, there.mix.density_ratio)}

    monkeypatch.setattr(sweep, "headline", recorded)
    monkeypatch.setattr(sweep, "LINE", 2)
    swept(tmp_path, scene, [*PAIR, "mix.density_ratio=0.94:0.98:3"], direct="all")
    assert starts == [None, (0.1, 0.94), None, None, (0.11, 0.94), None]
    longer = [*PAIR, "mix.density_ratio=0.94,0.96,0.98,0.99"]
    many = swept(tmp_path, scene, longer, resume=True, direct="all")[1]
    assert many.store.computed == 4  # incomplete lines, from their first point


@pytest.mark.slow
def test_continuation_by_finite_elements_agrees_with_a_start_from_scratch(tmp_path):
    """As any two paths: their searches end within 1e-3 each, and the load is extrapolated from two of them."""
    thin = COLUMNS.replaced(**{
        "accuracy.engine": "compaction", "product.height": 0.096, "machine.roller_radius": 0.11,
        "contact.indentation": 0.002, "layer.fed_density_ratio": 0.94, "machine.gap_geometry": "deformed",
        "mix.overrides.unloading_modulus": 60e6, "mix.overrides.friction_angle": 44.0,
    })  # fmt: skip
    table, _ = swept(tmp_path / "line", thin, ["mix.overrides.heckel_slope=11.4e-6,12e-6"], direct="all")
    cold, _ = swept(tmp_path / "cold", thin, ["mix.overrides.heckel_slope=12e-6"], direct="all")
    assert (table.reason == "").all()
    assert float(table["load"][1]) == pytest.approx(float(cold["load"][0]), rel=3e-3)
    assert float(table.resistance[1]) == pytest.approx(float(cold.resistance[0]), rel=3e-3)


# (g) uncertainty


def test_bands_contain_the_calibrated_operating_point(tmp_path):
    slope, fed = 15.228e-6, 0.93430  # fitted by columns to 9740 N and 0.179, see test_studies
    scene = {"accuracy.engine": "column", "layer.fed_density_ratio": fed}
    table, _ = swept(tmp_path, load_scene("loveikin-2015", **scene), ["mix.overrides=~32"])
    for quantity, calibrated in (("load", 9740.0), ("resistance", 2 * 0.179 * 9740), ("resistance_coefficient", 0.179)):
        low, _, high = sweep_report.band(table, quantity)
        assert low < calibrated < high
    low, _, high = sweep_report.band(table, "heckel_slope")
    assert low < slope < high


@pytest.mark.slow
def test_heckel_slope_explains_the_resistance_of_columns(tmp_path):
    table, _ = swept(tmp_path, COLUMNS, ["mix.overrides=~64"], indices=True)
    indices = sobol_indices.of_table(table)
    found = indices["resistance"].copy()
    slope = found.pop("heckel_slope")
    assert slope.rows == 64
    assert slope.first_low > 0.7
    assert max(abs(each.total) for each in found.values()) < 0.05
    sweep_report.write_sweep_report(tmp_path, table, indices)
    assert (tmp_path / "sobol.csv").read_text().count("\n") == 1 + 4 * 7
    assert (tmp_path / "sobol.png").stat().st_size > 10_000


def test_a_map_of_mould_and_stroke_is_the_window_of_the_machine(tmp_path):
    """Slow moulds and quick strokes are possible; beyond, the nip angle draws in too little mix for the density."""
    few = {"accuracy.engine": "process", "process.detail": "columns", "process.layers": 1, "machine.roller_length": 0.2}
    scene = load_scene("process", **few)
    table, _ = swept(tmp_path, scene, ["process.mould_speed=0.015,0.03", "motion.duration=0.6,0.9"])
    assert (table.reason != "").sum() == 1
    assert "nip angle" in str(table.reason.values[1, 1])
    assert table.limit.values[0, 0] == ""
    figure = sweep_report.draw_window(table)
    ax = figure.axes[0]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("strokes a minute [1/min]", "speed of the mould [m/min]")
    (star,) = ax.get_lines()
    assert star.get_xydata()[0] == pytest.approx([67.5, 1.05])
    *_, told = (text.get_text() for text in figure.legends[0].get_texts())
    assert told.startswith("`product_density_ratio` must be at")
    sweep_report.write_sweep_report(tmp_path, table, {})
    assert (tmp_path / "window.png").exists()
    assert not (tmp_path / "maps.png").exists()


# (h) the command


def held(task):
    """Memory [MB] that a worker holds after a task, without the garbage that Python has not collected yet."""
    compute(*task)
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


@pytest.mark.parametrize(
    "engine",
    [pytest.param("column", marks=pytest.mark.slow), pytest.param("spectral", marks=pytest.mark.nightly)],
)
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="no such file states the memory here")
def test_memory_of_a_worker_is_flat_over_a_thousand_points(engine):
    scene, names = FORMULA.replaced(**{"accuracy.engine": engine}), ("mix.moisture", "mix.density_ratio")
    grid = product(np.linspace(0.08, 0.12, 25).tolist(), np.linspace(0.94, 0.98, 40).tolist())
    points, size = [dict(zip(names, values, strict=True)) for values in grid], sweep.ENGINES[engine].points_per_task
    tasks = [task(scene, points[start : start + size], files.versions()) for start in range(0, 1000, size)]
    with ProcessExecutor(1) as executor:
        memory = {number: job.result() for number, job in run_tasks(held, tasks, executor)}
    last = len(memory) - 1  # the first tasks load what all need
    assert memory[last] - memory[last // 2] < 0.5
