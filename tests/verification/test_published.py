"""Table of published numbers: computed values are unchanged, verdicts are correct, `compact check` detects a change."""

import csv
import math
from dataclasses import replace
from pathlib import Path

import pytest

from compact.cli import program as cli
from compact.verification import published_numbers


@pytest.fixture(scope="module")
def rows():
    return {row.key: row for row in published_numbers.rows()}


def row_with(**changes):
    given = {"key": "contact.x", "source": "D", "quantity": "x", "unit": "m", "printed": "0.333", "computed": 1 / 3}
    return published_numbers.PublishedNumber(**given | {"verdict": "reproduced", "expected": 1 / 3} | changes)


# computed values


def test_computed_numbers_are_unchanged(rows):
    lines = published_numbers.recorded_lines()
    assert [line["key"] for line in lines] == list(rows)
    found = {key: row.computed for key, row in rows.items()}
    assert found == {key: pytest.approx(row.expected, rel=1e-9, abs=0) for key, row in rows.items()}
    assert [key for key, row in rows.items() if not row.unchanged] == []


def table(name):
    """Rows of a table beside this file."""
    with (Path(__file__).parent / name).open(newline="") as lines:
        return list(csv.DictReader(lines))


def test_verdicts_on_chapter_5_are_those_of_the_shared_table(rows):
    """Acceleration and jerk, copied from the shared table `laws.csv`."""
    for row in table("chapter_5.csv"):
        for peak in ("acceleration", "jerk"):
            assert rows[f"peaks.{row['name']}_{peak}"].verdict == row[peak], row


def test_computed_numbers_agree_with_the_shared_digits(rows):
    """Digits of the same numbers in the shared theory and errata, found before this package."""
    for line in table("shared_digits.csv"):
        row = rows[line["key"]]
        scaled = replace(row, computed=row.computed / float(line["unit"]), printed=line["printed"], decimals=None)
        assert scaled.matches_print, line


# verdicts


@pytest.mark.parametrize(
    ("printed", "computed", "decimals", "agrees"),
    [
        ("0.334", 0.3344999, None, True),
        ("0.334", 0.3345, None, True),  # half a unit itself
        ("0.334", 0.3345001, None, False),
        ("-1.34", -1.3441, None, True),
        ("0.6", 0.55814, None, True),
        ("0.6", 0.55814, 3, False),  # 0.600 with its zeros dropped
        ("6/5", 1.2, None, True),
        ("6/5", 1.2000001, None, False),
        ("inf", math.inf, None, True),
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
        ({"verdict": "rounding"}, False),
        ({"printed": ""}, False),
        ({"printed": "0.335"}, False),
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
