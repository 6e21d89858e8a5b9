"""Resolved ranks and agreement of two rankings, against counts by hand and by scipy."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import kendalltau

from compact.analysis.ranking_uncertainty import Place, agreement, places
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


@pytest.mark.parametrize(
    ("one", "other", "counts"),
    [
        pytest.param({"a": 10, "b": 20, "c": 30}, {"c": 10, "a": 20, "b": 30}, (2, 2, 3), id="three laws"),
        pytest.param({"a": 10, "b": 20}, {"b": 10, "a": 11}, (1, 0, 1), id="within an error"),
        pytest.param({"a": 1000, "b": 1100}, {"b": 1000, "a": 1005}, (1, 0, 1), id="within the build tolerance"),
        pytest.param({"a": 1000, "b": 1100}, {"b": 1000, "a": 1050}, (1, 1, 1), id="beyond both"),
    ],
)
def test_discordant_pairs_are_counted_and_resolved_beyond_errors_and_build_tolerance(one, other, counts):
    found = agreement(order(**one), order(**other), "peak_force")
    assert (found.discordant_pairs, found.resolved_discordant_pairs, found.pairs) == counts
    assert found.tau == pytest.approx(1 - 2 * counts[0] / counts[2])


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


def test_nonuniformity_is_resolved_to_a_hundredth_of_the_mean_speed():
    def even(name, value):
        return SimpleNamespace(name=name, nonuniformity=value, shocks=())

    runs = [even("a", 3e-17), even("b", 2e-16), even("c", 0.008), even("d", 0.5)]
    found = places(rank(runs, "nonuniformity"), "nonuniformity", {each.name: each for each in runs})
    assert [(place.rank, place.value) for place in found] == [(1, 0.0), (1, 0.0), (3, 0.008), (4, 0.5)]
    assert [place.margin for place in found] == pytest.approx([0.008, 0.008, 0.492, math.nan], nan_ok=True)
    assert [(place.tie, place.resolved) for place in found] == [
        (True, False),
        (True, False),
        (False, False),
        (False, True),
    ]


# hard cases


def test_infinite_values_have_a_reason_and_form_no_pair():
    runs = [Ranked(1, run("a", 10.0), 10.0, math.nan, ""), Ranked(2, run("b", math.inf), math.inf, math.nan, "a jump")]
    first, last = places(runs, "peak_force", {"a": run("a", 11.0), "b": run("b", math.inf)})
    assert (first.resolved, last.resolved, last.error, last.reason) == (True, False, 0.0, "a jump")
    assert agreement([first, last], [first, last], "peak_force")[:4] == (pytest.approx(math.nan, nan_ok=True), 0, 0, 0)


# properties


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=2, max_size=8))
def test_tau_is_that_of_kendall_with_ties(pairs):
    one, other = zip(*pairs, strict=True)
    named = [
        [
            Place(1 + sum(v < value for v in values), str(i), value, 0.0, None, None, "")
            for i, value in enumerate(values)
        ]
        for values in (one, other)
    ]
    expected = kendalltau(one, other).statistic if len(set(one)) > 1 and len(set(other)) > 1 else np.nan
    assert agreement(*named, "peak_force").tau == pytest.approx(expected, abs=1e-12, nan_ok=True)
