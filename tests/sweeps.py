"""A scene by columns and the table of a sweep over it."""

from pathlib import Path

from compact.analysis.worker_pool import SerialExecutor
from compact.scene.loader import load_scene
from compact.sweep.corrected import create_sweep
from compact.sweep.design import read_design

SCENES = Path(__file__).parents[1] / "compact" / "data" / "scenes"
PLAIN = {"machine.gap_geometry": "circle", "machine.roller_condition": "frictionless", "layer.fed_density_ratio": 0.9}
FORMULA = load_scene("loveikin-2015", **PLAIN)
COLUMNS = FORMULA.replaced(**{"accuracy.engine": "column"})


def swept(directory, scene, varied, executor=None, resume=False, force=False, step=lambda *_: None, **options):
    """Table and sweep of a scene."""
    many = create_sweep(scene, [read_design(text) for text in varied], **options)
    executor = executor or SerialExecutor()
    return many.run(directory, executor=executor, resume=resume, force=force, step=step), many
