"""Validation cases: no value of ours moves from the recorded one, and every verdict is the recorded one."""

import dataclasses
from collections import Counter
from pathlib import Path

import pytest

from compact.cli.checks import validate
from compact.cli.options import NO_RESULT, SUCCESS
from compact.report import validation_writer
from compact.validation import registry
from compact.validation.case import Comparison, read_rows
from compact.validation.registry import CASES, RECORDED, evaluate_case, select_cases

CHEAP = 0.5  # [s], of processor time; longer cases are slow tests


MARKED = [
    pytest.param(case, marks=[pytest.mark.slow] if case.seconds > CHEAP else [], id=case.name)
    for case in CASES.values()
]


@pytest.mark.parametrize("case", MARKED)
def test_values_and_verdicts_are_the_recorded_ones(case):
    result = evaluate_case(case)
    assert [each.key for each in result.moved] == []
    recorded = {row["key"]: row["verdict"] for row in read_rows(RECORDED, case=case.name)}
    assert {each.key: each.verdict for each in result.comparisons} == recorded
    assert len(result.comparisons) == len(recorded)


def test_every_case_is_recorded_and_states_its_source():
    assert {row["case"] for row in read_rows(RECORDED)} == set(CASES)
    for case in CASES.values():
        assert len(case.source) > 20
        assert case.licence


def comparison(**changes):
    return dataclasses.replace(Comparison("key", "quantity", "m", 1.05, 1.0, 0.1), **changes)


def test_a_verdict_is_earned_by_the_distance():
    assert comparison().verdict == "met"
    assert comparison(ours=1.2).verdict == "not met"
    assert comparison(ours=1.2, note="reason unknown").verdict == "not met"
    assert comparison(ours=1.2, explanation="shown by another number").verdict == "explained"
    assert comparison(expected=0.04, absolute=True).verdict == "not met"
    assert comparison(ours=float("nan")).verdict == "not met"


def test_a_value_moves_beyond_its_tolerance():
    assert comparison().moved(None)
    assert not comparison().moved(1.05 + 1e-8)
    assert comparison().moved(1.05 + 1e-5)
    assert comparison(ours=float("nan")).moved(1.05)


def test_an_unknown_case_is_refused_with_the_names():
    with pytest.raises(ValueError, match="contact-pa6"):
        select_cases(["contact"])


def test_the_command_prints_a_case_and_fails_if_a_value_moves(monkeypatch, capsys, tmp_path):
    assert validate(("cam-clay",), out=tmp_path) == SUCCESS
    said = capsys.readouterr()
    assert "8 numbers of 1 case: 8 met, 0 explained, 0 not met" in said.out
    assert (tmp_path / "validation" / "cam-clay.png").exists()
    monkeypatch.setattr(registry, "recorded_values", lambda name: {"K0_1": 0.75})
    assert validate(("cam-clay",)) == NO_RESULT
    said = capsys.readouterr()
    assert "MOVED: ours 0.748" in said.out
    assert "NOT RECORDED" in said.out
    assert "8 computed numbers have moved" in said.err


def test_the_page_of_the_documents_has_the_recorded_verdicts():
    page = (Path(__file__).parents[2] / "docs" / "validation.md").read_text("utf-8")
    recorded = Counter(row["verdict"] for row in read_rows(RECORDED))
    total = f"{recorded.total()} numbers of {len(CASES)} cases: "
    assert total + ", ".join(f"{recorded[verdict]} {verdict}" for verdict in validation_writer.VERDICTS) in page
    for name in CASES:
        assert f"### {name}\n" in page
        assert (Path(__file__).parents[2] / "docs" / "validation" / f"{name}.png").exists()


def test_the_page_has_a_section_and_a_figure_of_each_case(tmp_path):
    result = evaluate_case(min(CASES.values(), key=lambda case: case.seconds))
    written = validation_writer.write_validation(tmp_path, [result])
    page = written[0].read_text("utf-8")
    assert f"### {result.case.name}" in page
    assert result.case.licence in " ".join(page.split())
    assert all(path.stat().st_size > 500 for path in written)
    assert f"(validation/{result.case.name}.png)" in page
