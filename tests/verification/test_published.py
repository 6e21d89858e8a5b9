"""Table of published numbers: computed values are unchanged, verdicts are correct, `compact check` detects a change."""

import math
import re
from dataclasses import replace

import pytest

from compact.cli import program as cli
from compact.verification import published_numbers

# Verdicts on the printed peaks of D ch. 5, acceleration and jerk, copied from the shared table `laws.csv`.
CHAPTER_5 = {
    "septic": ("reproduced", "reproduced"),
    "complex": ("rounding", "reproduced"),
    "combined-2": ("reproduced", "reproduced"),
    "combined-3": ("rounding", "rounding"),
    "combined-4": ("rounding", "rounding"),
    "reversal-2": ("reproduced", "reproduced"),
    "reversal-3": ("reproduced", "reproduced"),
    "reversal-4": ("reproduced", "rounding"),
    "reversal-3-free-acceleration": ("misprint", "misprint"),
    "reversal-4-free-acceleration": ("misprint", "misprint"),
    "reversal-4-free-jerk": ("reproduced", "rounding"),
    "reversal-4-free-both": ("misprint", "misprint"),
}

# Digits of the same numbers in the shared theory and errata, found before this package.
SHARED = {
    "contact.exponent": ".4682744826",
    "contact.capture_angle": ".5122266165",
    "contact.force": "17720.764176",
    "contact.one_sided": "8298.181675",
    "contact.length": ".1013927703",
    "contact.roller_resistance": "3358.002985",
    "contact.cart_resistance": "8375.236079",
    "contact.power": "1340.037773",
    "contact.fitted_ratio": "27.3",
    "contact.coefficient": "0.179",
    "contact.coefficient_high": ".219",
    "contact.guide_friction": "76",
    "crank.used_one_peak": "7690.6",
    "crank.used_one_mean": "4749.33",
    "crank.used_sum_peak": "21100.7",
    "crank.used_sum_mean": "18997.3",
    "crank.used_one_over_quarter": "1.458",
    "crank.used_sum_over_mean": "1.11072",
    "crank.mean_frictionless": "21289",
    "crank.mean_upper_rail": "21425",
    "crank.mean_literal": "31",
    "crank.dead_centre": "27.56",
    "crank.inertia_for_ratio": "3.46",
    "crank.one_over_mean_then": "4.60",
    "crank.stated_rear_greater": "83",
    "claims.b_closure": "1.075",
    "claims.d41_closure": "1.05",
    "claims.b_velocity_step": "0.015",
    "claims.a_loss": "0.114",
    "claims.combined-2_criterion": "20.25",
    "claims.reversal-2_criterion": "17.28",
    "claims.combined-3_criterion": "11043",
    "claims.reversal-3_criterion": "7465",
    "cams.combined-2_breadth": "1.736",
    "cams.combined-3_breadth": "1.514",
    "cams.combined-4_breadth": "1.964",
    "cams.reversal-3_breadth": "1.227",
    "cams.reversal-4_breadth": "1.767",
    "cams.reversal-3-free-acceleration_breadth": "1.084",
    "cams.reversal-4-free-acceleration_breadth": "1.545",
}
SHARED_IN_KILO = {
    "contact.plain_force": "17.9",
    "contact.one_sided": "8.3",
    "contact.plain_one_sided": "8.9",
    "crank.inertia": "27.6",
    "crank.stated_one_peak": "55.6",
    "crank.peak_of_moving_force": "34.9",
    "crank.front_least": "0.2",
    "crank.front_largest": "5.9",
    "crank.rear_least": "7.7",
    "crank.rear_largest": "9.3",
    "crank.massless_rear_lowest": "-1.34",
}


@pytest.fixture(scope="module")
def rows():
    return {row.key: row for row in published_numbers.rows()}


def row_with(**changes):
    given = {"key": "contact.x", "source": "D", "quantity": "x", "unit": "m", "printed": "0.333", "computed": 1 / 3}
    return published_numbers.PublishedNumber(**given | {"verdict": "reproduced", "expected": 1 / 3} | changes)


# computed values


@pytest.mark.parametrize("key", [line["key"] for line in published_numbers.recorded_lines()])
def test_computed_number_is_unchanged(rows, key):
    row = rows[key]
    assert row.computed == pytest.approx(row.expected, rel=1e-9, abs=0)
    assert row.unchanged


def test_expected_values_are_exact_or_have_ten_digits():
    for line in published_numbers.recorded_lines():
        digits = re.sub(r"[^0-9]", "", line["expected"]).lstrip("0")
        assert line["origin"].startswith("exact") or len(digits) >= 10, line["key"]


@pytest.mark.parametrize("name", CHAPTER_5)
def test_verdicts_on_chapter_5_are_those_of_the_shared_table(rows, name):
    assert (rows[f"peaks.{name}_acceleration"].verdict, rows[f"peaks.{name}_jerk"].verdict) == CHAPTER_5[name]


@pytest.mark.parametrize("key", SHARED)
def test_computed_numbers_agree_with_the_shared_digits(rows, key):
    assert replace(rows[key], printed=SHARED[key], decimals=None).matches_print


@pytest.mark.parametrize("key", SHARED_IN_KILO)
def test_computed_numbers_agree_with_the_shared_digits_in_kilo(rows, key):
    assert replace(rows[key], computed=rows[key].computed / 1e3, printed=SHARED_IN_KILO[key]).matches_print


# verdicts


@pytest.mark.parametrize(
    ("printed", "computed", "decimals", "agrees"),
    [
        ("0.334", 0.3344999, None, True),
        ("0.334", 0.3345, None, True),  # half a unit itself
        ("0.334", 0.3345001, None, False),
        ("-1.34", -1.3441, None, True),
        ("12", 12.4, None, True),
        ("0.6", 0.55814, None, True),
        ("0.6", 0.55814, 3, False),  # 0.600 with its zeros dropped
        ("6/5", 1.2, None, True),
        ("6/5", 1.2000001, None, False),
        ("-6/5", 1.2, None, False),
        ("inf", math.inf, None, True),
        ("inf", 1e300, None, False),
        ("0", 0.0, None, True),
        ("1.5", math.nan, None, False),
        ("", 1.0, None, False),
    ],
)
def test_print_agrees_to_half_a_unit_of_its_last_digit(printed, computed, decimals, agrees):
    assert row_with(printed=printed, computed=computed, decimals=decimals).matches_print == agrees


@pytest.mark.parametrize(
    ("changes", "unchanged"),
    [
        ({}, True),
        ({"printed": "0.335", "verdict": "misprint"}, True),
        ({"printed": "", "verdict": "derived"}, True),
        ({"expected": 0.3333333}, False),
        ({"expected": math.nan}, False),
        ({"computed": math.nan}, False),
        ({"verdict": "rounding"}, False),
        ({"verdict": "derived"}, False),
        ({"verdict": "right"}, False),
        ({"printed": ""}, False),
        ({"printed": "0.335"}, False),
        ({"printed": "0.335", "verdict": "right"}, False),
    ],
    ids=str,
)
def test_a_row_is_unchanged_with_the_expected_value_and_a_correct_verdict(changes, unchanged):
    assert row_with(**changes).unchanged == unchanged


# command


@pytest.mark.parametrize(("factor", "code"), [(1.0, 0), (1 + 1e-8, 1)])
def test_check_fails_on_a_changed_number(monkeypatch, capsys, rows, factor, code):
    first, *rest = rows.values()
    checked = [replace(first, expected=first.expected * factor), *rest]
    monkeypatch.setattr(published_numbers, "rows", lambda: checked)
    assert cli._exit_code(["check"]) == code
    told = capsys.readouterr()
    assert ("CHANGED: " in told.out, "1 of 153 computed numbers have changed" in told.err) == (code == 1,) * 2
    assert max(map(len, told.out.splitlines())) <= 120
