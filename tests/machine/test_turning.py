"""Shares of force and load after a turn: closed forms, published examples, continuity, limits, refusals."""

from itertools import pairwise

import mpmath
import numpy as np
import pytest

from compact import turning
from compact.resistance import dry_resistance
from compact.turning import RELEASED, StrokeResistance, table_share

LENGTH, DEPTH, WAVE, EDGE = 0.026, 2.1e-3, 1.21 * 2.1e-3, 0.110
STROKE, RELEASE = 0.4, 0.2e-3


def wave_shares(wave=WAVE, edge=EDGE):
    return turning.wave_shares(LENGTH, DEPTH, wave, RELEASE, edge)


def imprint_shares(exponent=0.7, edge=EDGE):
    return turning.imprint_shares(LENGTH, exponent, RELEASE, edge)


def along_stroke(force, load, resistance=None):
    return StrokeResistance(resistance or dry_resistance(3486.0), force, force, load, load)


# closed form


@pytest.mark.parametrize("exponent", [0.0, 0.7, 2.5])
@pytest.mark.parametrize("u", [0.3, 0.6, 0.99])
def test_imprint_carries_the_integrals_of_its_pressure(exponent, u):
    """Force int p dy, load int p dx of p = y^n, y = 1 - x^2 from the edge of fresh mix at 1 - u to the front at 1."""
    force, load = imprint_shares(exponent)
    travel = force.distance + u * LENGTH
    exact = [
        mpmath.quad(density, [1 - u, 1]) / mpmath.quad(density, [0, 1])
        for density in (lambda x: (1 - x**2) ** exponent * 2 * x, lambda x: (1 - x**2) ** exponent)
    ]
    assert float(force(travel)) == pytest.approx(float(exact[0]), rel=1e-10)
    assert float(load(travel)) == pytest.approx(max(0.25, float(exact[1])), rel=1e-10)


@pytest.mark.parametrize("exponent", [0.0, 1.0, 3.0])
def test_imprint_is_complete_at_the_edge_distance(exponent):
    for share in imprint_shares(exponent):
        assert float(share(EDGE)) == 1
        assert float(share(EDGE - 1e-3)) < 1
        assert share.travels[-1] == pytest.approx(EDGE, rel=1e-14)


# published numbers


@pytest.mark.parametrize(
    ("ratio", "first", "length"),
    [(1.21, 0.45, 5.0), (1.8, 0.36, 9.0), (0.56, 0.64, 2.9), (0.22, 0.8, 2.0)],
    ids=["published lift", "deeper", "shallow", "thin layer"],
)
def test_wave_begins_and_builds_up_as_histories_by_a_law_without_saturation(ratio, first, length):
    """First plateau and build-up length of runs that had no part in the fit; the lengths were read from curves."""
    share, _ = wave_shares(ratio * DEPTH)
    missing = 1 - share(share.distance + LENGTH * np.array([0.5, 0.5 + length]))
    assert 1 - missing[0] == pytest.approx(first, abs=0.025)
    assert np.log(missing[0] / missing[1]) == pytest.approx(1, rel=0.25)


def test_make_up_of_a_millimetre_builds_up_as_measured():
    """It climbs later than other mix: 0.76 at half a contact length, 0.89 by the formula."""
    share, _ = wave_shares(0.13 * DEPTH)
    assert float(share(share.distance + LENGTH)) == pytest.approx(0.94, abs=0.02)


def test_load_of_the_wave_is_the_square_root_of_that_of_the_force():
    force, load = wave_shares()
    start = force.distance + 0.5 * LENGTH
    assert float(load(start)) == pytest.approx(np.sqrt(float(force(start))), rel=1e-12)
    ratios = [np.log((1 - each(start)) / (1 - each(start + LENGTH))) for each in (load, force)]
    assert ratios[0] / ratios[1] == pytest.approx(1 / 0.8, rel=1e-12)


# hard cases: limits and continuity

SHARES = {
    "wave": wave_shares(),
    "low wave": wave_shares(0.02 * DEPTH),
    "no wave": wave_shares(0.0),
    "high wave": wave_shares(200 * DEPTH),
    "open to the roller": wave_shares(edge=0.0),
    "imprint": imprint_shares(),
    "imprint below the roller": imprint_shares(edge=0.4 * LENGTH),
    "imprint at once": imprint_shares(edge=0.0),
    "table": (table_share((0.0, 0.110, 0.136), (0.0, 0.0, 1.0)),) * 2,
}


@pytest.mark.parametrize("shares", SHARES.values(), ids=SHARES.keys())
def test_shares_rise_without_jumps_from_the_track_to_one(shares):
    for share in shares:
        travels = np.linspace(0, max(1.1 * share.travels[-1], 0.05), 200_001)
        values = share(travels)
        assert values[-1] == 1
        assert values.min() >= share.track
        assert np.diff(values).min() >= 0
        assert np.diff(values).max() < 6 * np.diff(travels)[0] / LENGTH
        assert np.all(share(share.distance * np.linspace(0, 1, 9)[: 8 if share.distance else 0]) == share.track)


@pytest.mark.parametrize("shares", SHARES.values(), ids=SHARES.keys())
@pytest.mark.parametrize("stroke", [STROKE, 0.05, 1e-4])
def test_neither_force_nor_load_jumps_at_a_turn(shares, stroke):
    force, load = shares
    if not force.release:
        return
    forward, backward = along_stroke(force, load).over(stroke)
    for one, other in ((forward, backward), (backward, forward)):
        assert float(other.force_share(0.0)) == pytest.approx(-float(one.force_share(stroke)), abs=1e-12)
        assert float(other.load_share(0.0)) == pytest.approx(float(one.load_share(stroke)), abs=1e-12)


# refusals


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: turning.wave_shares(0.0, DEPTH, WAVE, RELEASE, EDGE),
            "`contact_length` must be positive and finite, got 0.0",
        ),
        (lambda: table_share((0.0, 0.1), (0.0, 1.2)), "`share` must be between 0 and 1, got"),
        (lambda: table_share((0.1, 0.1), (0.0, 1.0)), "`travel` must ascend, got"),
        (lambda: table_share((0.1,), (0.0, 1.0)), "`travel` and `share` must be columns of one length, got"),
        (
            lambda: along_stroke(wave_shares()[0], table_share((0.0,), (1.0,))),
            "`distance` and `release` of the shares of force and load must agree, got",
        ),
    ],
)
def test_refusals(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize("shares", SHARES.values(), ids=SHARES.keys())
def test_shares_are_smooth_between_their_travels(shares):
    for share in shares:
        breaks = np.unique([0.0, *share.travels])
        for low, high in pairwise(breaks):
            middle = (low + high) / 2 + (high - low) * np.linspace(-0.45, 0.45, 2001)
            bend = np.abs(np.diff(share(middle), 3))
            assert bend.max() < 1e-6


def test_wave_that_vanishes_leaves_the_climb():
    travels = np.linspace(0, 0.2, 2001)
    low, none = (wave_shares(ratio * DEPTH)[0](travels) for ratio in (1e-9, 0.0))
    assert low == pytest.approx(none, abs=1e-8)


def test_old_force_lets_go_within_its_release():
    shares = along_stroke(*wave_shares()).over(STROKE)[0]
    last = 1 - 1.21 / 2.21 * np.exp(-((STROKE - shares.force.distance) / LENGTH - 0.5) / (5 * 1.21**0.75))
    assert float(shares.force_share(0.0)) == pytest.approx(-last, rel=1e-12)
    assert float(shares.force_share(RELEASED * RELEASE)) == pytest.approx(0.02, abs=1e-14)
    assert float(shares.load_share(RELEASED * RELEASE)) == pytest.approx(0.25, abs=1e-14)
