"""Resolved ranks by the error of the resistance."""

import math
from types import SimpleNamespace

import pytest

from compact.analysis.ranking_uncertainty import places
from compact.machine.ranking import Ranked, rank


def run(name, value):
    return SimpleNamespace(name=name, peak_force=value, shocks=())


def order(**values):
    """Places of laws by their peak forces, each with an error of 1 N."""
    runs = {name: run(name, value) for name, value in values.items()}
    heavier = {name: run(name, value + 1) for name, value in values.items()}
    return places(rank(runs.values(), "peak_force"), "peak_force", heavier)


# closed form


def test_error_is_the_change_under_a_greater_resistance():
    ranked = rank([run("a", 10.0), run("b", 12.0)], "peak_force")
    first, last = places(ranked, "peak_force", {"a": run("a", 10.5), "b": run("b", 11.0)})
    assert (first.error, last.error) == (0.5, 1.0)
    assert (first.law, first.rank, first.value, first.margin) == ("a", 1, 10.0, pytest.approx(0.2))


@pytest.mark.parametrize(("second", "resolved"), [(11.9, False), (12.1, True)], ids=["within", "beyond"])
def test_rank_is_resolved_beyond_both_errors(second, resolved):
    assert [place.resolved for place in order(a=10.0, b=second)] == [resolved, True]


@pytest.mark.parametrize(("second", "tie"), [(1009.0, True), (1011.0, False)], ids=["within", "beyond"])
def test_difference_below_the_build_tolerance_is_a_tie_and_not_resolved(second, tie):
    """The error of 1 N in a thousand alone would resolve the two."""
    first, last = order(a=1000.0, b=second)
    assert first.tie == tie
    assert [first.resolved, last.resolved] == [not tie] * 2
    assert not last.tie  # no law is worse


def test_equal_values_share_a_resolved_rank():
    assert [(place.rank, place.resolved) for place in order(a=100.0, b=100.0 * (1 + 1e-12), c=110.0)] == [
        (1, True), (1, True), (3, True),
    ]  # fmt: skip


# hard cases


def test_infinite_values_have_a_reason():
    runs = [Ranked(1, run("a", 10.0), 10.0, math.nan, ""), Ranked(2, run("b", math.inf), math.inf, math.nan, "a jump")]
    first, last = places(runs, "peak_force", {"a": run("a", 11.0), "b": run("b", math.inf)})
    assert (first.resolved, last.resolved, last.error, last.reason) == (True, False, 0.0, "a jump")
