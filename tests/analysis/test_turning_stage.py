"""Resistance along the stroke of a scene: shares by engine, table, figure, and the spread of the sleeve."""

from types import SimpleNamespace

import numpy as np
import pytest

from compact.analysis.stages.drives import build_stages
from compact.analysis.stages.resistance import sampled_shares
from compact.analysis.stages.uncertainty import SLEEVE, drive_variants
from compact.engines import ENGINES
from compact.machine.drives import EDGE
from compact.scene.loader import load_scene
from compact.turning import StrokeResistance

FORMULA = {"accuracy.engine": "formula", "compare": None, "output.items": [], "motion.other_durations": None}
COLUMN = FORMULA | {
    "accuracy.engine": "column", "mix.overrides.heckel_slope": 15.228e-6, "layer.lift_thickness": 0.22,
    "layer.fed_density_ratio": 0.9343,
}  # fmt: skip
LINEAR = FORMULA | {
    "accuracy.engine": "spectral", "machine.roller_condition": "frictionless", "machine.gap_geometry": "circle",
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
    length, exponent = found.turning[0].args
    depth = contact.indentation
    assert length == pytest.approx(np.sqrt(2 * 0.11 * depth))
    assert contact.peak_pressure * depth / (exponent + 1) == pytest.approx(contact.resistance, rel=1e-12)
    assert 0 < exponent < 1  # mix of 0.934 yields at once, at nearly half of the peak pressure


def test_bow_wave_of_the_contact_delays_the_build_up():
    contact = SimpleNamespace(indentation=2.13e-3, bow_wave=2.54e-3)
    force, load = ENGINES["compaction"].turning(contact, 0.11)
    share, length = force(0.11), np.sqrt(2 * 0.11 * 2.13e-3)
    assert share.distance == pytest.approx(0.11 - length)
    at = share.distance + 0.5 * length
    assert share(at) == pytest.approx(2.13 / (2.13 + 2.54), rel=1e-3)  # 1 - B
    assert load(0.11)(at) == pytest.approx(np.sqrt(2.13 / (2.13 + 2.54)), rel=1e-3)


@pytest.mark.parametrize("changes", [FORMULA | {"drive.turn": "step"}, LINEAR | {"drive.turn": "build-up"}])
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
