"""Lower lift below the fed one: columns in series, the rigid base as limit, chain of passes, balances, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from mixes import LIFT, THIN, free_roller
from mixes import LIFT_MIX as MIX

from compact.analysis.contact_cases import Pass, density, passes
from compact.engines.column import engine as column
from compact.engines.compaction.engine import roll
from compact.engines.compaction.layer_state import compacted_lift, fresh_layer
from compact.engines.compaction.roller_frame import RollerFrame, rolling_mesh, transfer_state
from compact.material.cap_plasticity import compacted_state
from compact.rolling_contact import Layer, LowerLift, Roller

ROLLER = free_roller()
CIRCLE = replace(ROLLER, profile="circle")
LOWER = LowerLift(thickness=0.06, density_ratio=0.98)
ON_LIFT = replace(LIFT, lower_lift=LOWER)
HEIGHT = 0.1147


@pytest.fixture(scope="module")
def on_lift():
    """Published lift on a compacted lift, on 4 increments."""
    return roll(ON_LIFT, ROLLER, MIX, 0.13, increments=4)


@pytest.fixture(scope="module")
def on_base():
    """Published lift on the rigid base, on 4 increments."""
    return roll(LIFT, ROLLER, MIX, 0.13, increments=4)


# state of the lower lift before the pass


@pytest.mark.parametrize("ratio", [0.95, 0.98])
def test_residual_stress_is_that_of_a_column_after_its_pass(ratio):
    feed = column.required_feed(0.06, ratio, MIX, 0.13)
    rolled = column.roll(Layer(feed.height), replace(CIRCLE, indentation=feed.indentation), MIX, 0.13)
    point, expected = compacted_state(MIX, ratio), rolled.exit.layer[0]
    assert point.density_ratio[0] == pytest.approx(ratio, abs=1e-12)
    assert -point.stress[0, [0, 2]] == pytest.approx(expected.lateral_stress, rel=1e-4)
    assert point.max_density_ratio[0] == pytest.approx(expected.max_density_ratio, abs=1e-9)


# columns in series


def test_column_on_an_elastic_lower_lift_settles_by_its_oedometric_strain():
    """Columns share the vertical stress: resistance and exit density are those of the rigid base."""
    feeds = [column.required_feed(0.06, 0.98, MIX, 0.13, lower_lift=lower) for lower in (None, LOWER)]
    rigid, lifted = (
        column.roll(Layer(feed.height, lower_lift=lower), replace(CIRCLE, indentation=feed.indentation), MIX, 0.13)
        for feed, lower in zip(feeds, (None, LOWER), strict=True)
    )
    modulus = 120e6 * 0.7 / (1.3 * 0.4)
    settlement = 0.06 * (1 - np.exp(-rigid.peak_pressure / modulus))
    assert feeds[1].height == feeds[0].height
    assert feeds[1].indentation - feeds[0].indentation == pytest.approx(settlement, rel=1e-6)
    assert lifted.peak_pressure == pytest.approx(rigid.peak_pressure, rel=1e-8)
    assert lifted.exit_density_ratio == pytest.approx(0.98, abs=1e-10)
    assert lifted.exit_height == pytest.approx(0.06, rel=1e-9)
    assert lifted.resistance == pytest.approx(rigid.resistance, rel=1e-8)
    assert lifted.load > 1.04 * rigid.load  # a longer contact, in front and behind
    assert (lifted.lower_height, lifted.lower_density_ratio) == pytest.approx((0.06, 0.98), rel=1e-12)


@pytest.mark.parametrize("ratio", [0.98, 0.95], ids=["elastic", "yielding"])
def test_thin_layers_tend_to_columns_in_series(ratio):
    """Contact length ten times both heights together, small strain; 32 elements have P .1 %, F .07 % above columns."""
    layer = Layer(HEIGHT, lower_lift=LowerLift(thickness=HEIGHT, density_ratio=ratio))
    roller = Roller((20 * HEIGHT) ** 2 / (2 * 0.036 * HEIGHT), indentation=0.036 * HEIGHT)
    columns = column.roll(layer, roller, THIN, 0.2, strain="small")
    rolled = roll(layer, roller, THIN, 0.2, strain="small", increments=12)
    assert rolled.load == pytest.approx(columns.load, rel=3e-3)
    assert rolled.resistance == pytest.approx(1.0007 * columns.resistance, rel=rolled.error[1])
    assert rolled.error[1] < 6e-3
    assert rolled.exit_density_ratio == pytest.approx(columns.exit_density_ratio, abs=2e-4)
    assert rolled.lower_density_ratio == pytest.approx(columns.lower_density_ratio, abs=2e-4)
    assert rolled.lower_height == pytest.approx(columns.lower_height, rel=2e-4)


# limits of the published lift


@pytest.mark.slow
def test_difference_from_the_rigid_base_is_inverse_to_the_modulus():
    """The lower lift stays elastic, so that it tends to the rigid base; the resistance does so faster by its wave."""
    changes, options = [], {"increments": 7, "steady_tolerance": 5e-4}
    for modulus in (120e6, 360e6):
        mix = replace(MIX, unloading_modulus=modulus)
        rigid, lifted = (roll(layer, ROLLER, mix, 0.13, **options) for layer in (LIFT, ON_LIFT))
        changes.append([lifted.load / rigid.load - 1, lifted.resistance / rigid.resistance - 1])
    soft, stiff = changes
    assert soft[0] == pytest.approx(3 * stiff[0], abs=3 * 2 * 1e-3)  # by the distances of two contacts from steady
    assert 2.5 < soft[1] / stiff[1] < 5
    assert changes[1] == pytest.approx([0, 0], abs=1.2e-2)


@pytest.mark.slow
def test_mass_of_both_lifts_and_work_balance(on_lift):
    assert on_lift.mass_residual < 3e-4
    assert on_lift.work_residual < 0.02


# chain of passes


@pytest.mark.slow
def test_exit_of_a_first_pass_as_lower_lift_equals_its_description(on_base):
    """The density of the first pass varies over the height; its mean determines load and resistance within .2 %."""
    fed = replace(fresh_layer(MIX, np.array([LIFT.height])), lower=on_base.exit)
    described = LowerLift(thickness=on_base.exit_height, density_ratio=on_base.exit_density_ratio)
    chained = roll(LIFT, ROLLER, MIX, 0.13, increments=4, fed_layer=fed)
    rolled = roll(replace(LIFT, lower_lift=described), ROLLER, MIX, 0.13, increments=4)
    assert chained.load == pytest.approx(rolled.load, rel=2e-3)
    assert chained.resistance == pytest.approx(rolled.resistance, rel=2e-3)
    assert chained.exit.lower.density_ratio == pytest.approx(on_base.exit_density_ratio, abs=1e-4)


def test_second_pass_by_columns_at_the_same_height_has_no_resistance():
    done = passes(ON_LIFT, CIRCLE, MIX, 0.13, (Pass(), Pass(forward=False)))
    assert abs(done[1].resistance) < 1e-9 * done[0].resistance
    assert done[1].peak_pressure == pytest.approx(done[0].peak_pressure, rel=1e-8)
    assert done[1].lower_height == pytest.approx(done[0].lower_height, rel=1e-9)
    rows = density(done[1])
    assert rows[:, 2] == pytest.approx([done[0].lower_density_ratio, done[0].exit_density_ratio])
    assert rows[-1, 1] == pytest.approx(done[0].lower_height + done[0].exit_height)


@pytest.mark.slow
def test_second_pass_by_finite_elements_carries_both_lifts():
    first, second = passes(ON_LIFT, ROLLER, MIX, 0.13, (Pass(), Pass(forward=False)), engine="compaction", increments=4)
    lowest = LIFT.height + LOWER.thickness - first.indentation
    assert second.exit.lower.height + second.exit_height - second.elastic_recovery == pytest.approx(lowest, rel=1e-9)
    # 0.309, 0.313 and 0.308 of the load, -62.0, -62.3 and -61.8 N/m on 4, 7 and 10 elements
    assert second.load / first.load == pytest.approx(0.310, abs=0.005)
    assert second.resistance == pytest.approx(-62.0, rel=0.02)
    assert len(density(second)) == len(second.exit.heights) + len(second.exit.lower.heights)


# scenes, records and refusals


def test_transfer_between_meshes_keeps_the_jump_of_density_at_the_interface():
    lower = compacted_lift(LOWER, MIX)
    old, new = (
        RollerFrame(rolling_mesh(0.06, 0.02, step, 0.06), MIX, "bonded", 0.02, lower=lower) for step in (0.01, 0.004)
    )
    ratios = new.to_rows(transfer_state(old.initial_state(), old, new).points.density_ratio)
    assert ratios[: new.lower_rows] == pytest.approx(0.98, rel=1e-12)
    assert ratios[new.lower_rows :] == pytest.approx(MIX.fed_density_ratio, rel=1e-12)
    assert new.row_heights[: new.lower_rows].sum() == pytest.approx(0.06, rel=1e-12)


@pytest.mark.slow
def test_exit_density_refers_to_the_fed_lift(on_lift):
    rolled = roll(ON_LIFT, ROLLER, MIX, 0.13, increments=4, exit_density_ratio=0.98, start=on_lift)
    assert rolled.exit_density_ratio == pytest.approx(0.98, rel=1e-3)
    assert rolled.indentation > on_lift.indentation


@pytest.mark.slow
def test_neighbour_on_a_lower_lift_equals_a_solution_from_scratch(on_lift):
    layer = replace(ON_LIFT, height=1.03 * LIFT.height)
    deeper = replace(ROLLER, indentation=0.00312)
    found = [roll(layer, deeper, MIX, 0.13, increments=4, start=start) for start in (on_lift, None)]
    assert found[0].load == pytest.approx(found[1].load, rel=3e-3)
    assert found[0].resistance == pytest.approx(found[1].resistance, rel=3e-3)


@pytest.mark.slow
def test_thinner_lower_lifts_tend_to_the_rigid_base():
    lower = (replace(LOWER, thickness=thickness) for thickness in (0.002, LOWER.thickness, 0.12))
    layers = [LIFT, *(replace(LIFT, lower_lift=each) for each in lower)]
    options = {"increments": 4, "steady_tolerance": 2e-4}  # the first loss is as small as the usual tolerance
    on_base, *lifts = (roll(layer, ROLLER, MIX, 0.13, **options) for layer in layers)
    losses = [1 - rolled.resistance / on_base.resistance for rolled in lifts]
    assert 0 < losses[0] < 2e-3
    assert losses[0] < losses[1] < losses[2] < 2 * losses[1]
