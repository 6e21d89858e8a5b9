"""Table of published numbers: computed values are unchanged, verdicts are correct, `compact check` detects a change."""

import math
import re
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

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

values, places = st.floats(-1e6, 1e6), st.integers(0, 6)


@pytest.fixture(scope="module")
def rows():
    return {row.key: row for row in published_numbers.rows()}


def row_with(**changes):
    given = {"key": "contact.x", "source": "D", "quantity": "x", "unit": "m", "printed": "0.333", "computed": 1 / 3}
    return published_numbers.PublishedNumber(**given | {"verdict": "reproduced", "expected": 1 / 3} | changes)


# computed values


@pytest.mark.parametrize("key", list(published_numbers.recorded_lines()))
def test_computed_number_is_unchanged(rows, key):
    row = rows[key]
    assert row.computed == pytest.approx(row.expected, rel=1e-9, abs=0)
    assert row.unchanged


def test_every_number_recorded_is_computed_and_shown():
    assert set(published_numbers.recorded_lines()) == set(published_numbers.computed_values())


def test_expected_values_are_exact_or_have_ten_digits():
    for key, line in published_numbers.recorded_lines().items():
        digits = re.sub(r"[^0-9]", "", line["expected"]).lstrip("0")
        assert line["origin"].startswith("exact") or len(digits) >= 10, key


@pytest.mark.parametrize("source", ["A", "B", "C", "D (1.", "D 2", "D 3", "D 4", "D (4.", "D ch. 5", "D, law"])
def test_every_source_has_a_row(rows, source):
    assert any(row.source.startswith(source) for row in rows.values())


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


@given(values, places)
def test_rounded_number_agrees_and_one_two_units_off_does_not(computed, decimals):
    printed = Decimal(f"{computed:.{decimals}f}")
    assert row_with(computed=computed, printed=f"{printed:f}").matches_print
    assert not row_with(computed=computed, printed=f"{printed + 2 * Decimal(1).scaleb(-decimals):f}").matches_print


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


# table


def test_table_is_narrow_plain_text_with_every_row_and_the_count_of_verdicts(rows):
    lines = published_numbers.text_table(list(rows.values())).splitlines()
    assert "".join(lines).isascii()
    assert max(len(line) for line in lines) <= 120
    assert not any(line != line.rstrip() for line in lines)
    counts = Counter(row.verdict for row in rows.values())
    assert {verdict: sum(line.endswith(f" {verdict}") for line in lines[:-1]) for verdict in counts} == counts
    assert lines[-1].startswith(f"{len(rows)} numbers: ")
    assert all(f"{count} {verdict}" in lines[-1] for verdict, count in counts.items())


def test_table_marks_every_changed_number(rows):
    for row in rows.values():
        expected = row.expected * 1.1 + 1 if math.isfinite(row.expected) else 1.0
        text = published_numbers.text_table([replace(row, expected=expected)])
        assert "CHANGED: " in text, row.key
        assert max(len(line) for line in text.splitlines()) <= 120


# command


def check(monkeypatch, rows):
    monkeypatch.setattr(published_numbers, "rows", lambda: rows)
    monkeypatch.setattr(sys, "argv", ["compact", "check"])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code


def test_check_passes_on_unchanged_numbers(monkeypatch, capsys, rows):
    assert check(monkeypatch, list(rows.values())) == 0
    assert f"{len(rows)} numbers checked: all are unchanged" in capsys.readouterr().out


def test_check_fails_on_a_changed_number(monkeypatch, capsys, rows):
    first, *rest = rows.values()
    assert check(monkeypatch, [replace(first, expected=first.expected * (1 + 1e-8)), *rest]) == 1
    told = capsys.readouterr()
    assert "CHANGED: " in told.out
    assert f"1 of {len(rows)} computed numbers have changed" in told.err


@pytest.mark.slow
def test_check_runs_as_a_command():
    done = subprocess.run([sys.executable, "-m", "compact.cli", "check"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "all are unchanged" in done.stdout
