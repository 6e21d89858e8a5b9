"""Forming process of other machines by columns: hard cases, ten random machines, a plate with three rollers."""

from pathlib import Path

import pytest

from compact.analysis.process import ProcessStudy
from compact.scene.loader import load_scene

SCENE = Path(__file__).parents[2] / "compact" / "data" / "scenes" / "process.toml"

FEW = {"process.layers": 1, "machine.roller_length": 0.4}

AT_REST = {"process.mould_speed": 0.0}


def test_one_stroke_for_a_density_is_refused_with_a_remedy():
    study = ProcessStudy(load_scene(SCENE, **FEW | AT_REST | {"process.strokes": 1}))
    with pytest.raises(
        ValueError, match=r"in 1 strokes .* more strokes on a section are needed: a slower mould, a faster"
    ):
        study.history  # noqa: B018
