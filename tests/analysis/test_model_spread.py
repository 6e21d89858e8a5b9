"""Spread over the laws of the mix: ratios by columns, laws by which the mix heaps up, and their way to the output."""

from pathlib import Path

import pytest

from compact.analysis.stages.verdict import contact_by_law, scenes_of_laws, spread_of
from compact.analysis.study import Study
from compact.scene.loader import load_scene

SMALL = Path(__file__).parents[2] / "compact" / "data" / "scenes" / "small.toml"


def scene(**changes):
    return load_scene(SMALL, **{"accuracy.engine": "column", "output.items": ["model_spread"]} | changes)


@pytest.mark.slow
def test_ends_of_the_saturation_limit_change_the_resistance_of_a_lift():
    """By finite elements; an independent code has -6 % of it from 0.998 to 0.999."""
    lift = {"layer.lift_thickness": 0.06, "layer.fed_density_ratio": 0.93576, "contact.indentation": 0.003}
    study = Study(scene(**{"accuracy.engine": "compaction"} | lift))
    own, *_, low, high = scenes_of_laws(study.scene, study.stages.contacts.mix)
    rolled = [contact_by_law(study.stages.contacts.held, each) for each in (own, low, high)]
    spread = spread_of(rolled)
    assert [each.saturation_limit for each in spread.variants] == [0.995, 0.999]
    assert spread.variants[1].resistance == pytest.approx(1850 / 1960, abs=0.03)
    assert spread.variants[0].resistance > 1.05
