"""How sure an order is, and whether two agree: against orders counted by hand and by scipy."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import kendalltau

from compact.ordering import Place, agreement, places
from compact.ranking import Ranked, rank


def run(name, value):
    return SimpleNamespace(name=name, peak_force=value, shocks=())


def order(**values):
    """Places of laws by their peak forces, each with an error of 1 N."""
    runs = {name: run(name, value) for name, value in values.items()}
    heavier = {name: run(name, value + 1) for name, value in values.items()}
    return places(rank(runs.values(), "peak_force"), "peak_force", heavier)


# closed form


def test_error_is_what_a_greater_resistance_adds():
    ranked = rank([run("a", 10.0), run("b", 12.0)], "peak_force")
    first, last = places(ranked, "peak_force", {"a": run("a", 10.5), "b": run("b", 11.0)})
    assert (first.error, last.error) == (0.5, 1.0)
    assert (first.law, first.rank, first.value, first.margin) == ("a", 1, 10.0, pytest.approx(0.2))


@pytest.mark.parametrize(("second", "sure"), [(11.9, False), (12.1, True)], ids=["within", "beyond"])
def test_place_is_sure_beyond_both_errors(second, sure):
    assert [place.sure for place in order(a=10.0, b=second)] == [sure, True]


def test_law_behind_that_moves_further_puts_every_place_before_it_in_doubt():
    heavier = {"a": run("a", 10.1), "b": run("b", 12.1), "c": run("c", 20.0)}
    ranked = rank([run("a", 10.0), run("b", 12.0), run("c", 14.0)], "peak_force")
    assert [place.sure for place in places(ranked, "peak_force", heavier)] == [False, False, True]


def test_two_swaps_among_three_laws():
    agreed = agreement(order(a=10, b=20, c=30), order(c=10, a=20, b=30))
    assert agreed == (pytest.approx(-1 / 3), 2, 2, 3)


def test_swap_of_laws_that_an_error_parts_is_not_sure():
    assert agreement(order(a=10, b=20), order(b=10, a=11))[1:] == (1, 0, 1)


# hard cases


def test_law_that_cannot_be_carried_then_has_no_bound():
    ranked = rank([run("a", 10.0), run("b", 12.0)], "peak_force")
    first, last = places(ranked, "peak_force", {"a": run("a", 10.1)})
    assert last.error == math.inf
    assert not first.sure


def test_unknown_error_is_told_as_unknown():
    told = places(rank([run("a", 10.0), run("b", 12.0)], "peak_force"), "peak_force", None)
    assert [(place.error, place.sure) for place in told] == [(None, None)] * 2


def test_infinite_values_keep_their_reason_and_move_nothing():
    runs = [Ranked(1, run("a", 10.0), 10.0, math.nan, ""), Ranked(2, run("b", math.inf), math.inf, math.nan, "a jump")]
    first, last = places(runs, "peak_force", {"a": run("a", 11.0), "b": run("b", math.inf)})
    assert (first.sure, last.error, last.reason) == (True, 0.0, "a jump")
    assert agreement([first, last], [first, last]) == (pytest.approx(math.nan, nan_ok=True), 0, 0, 0)


# properties


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=2, max_size=8))
def test_tau_is_kendalls_with_ties(pairs):
    one, other = zip(*pairs, strict=True)
    named = [
        [
            Place(1 + sum(v < value for v in values), str(i), value, 0.0, None, None, "")
            for i, value in enumerate(values)
        ]
        for values in (one, other)
    ]
    expected = kendalltau(one, other).statistic if len(set(one)) > 1 and len(set(other)) > 1 else np.nan
    assert agreement(*named).tau == pytest.approx(expected, abs=1e-12, nan_ok=True)
