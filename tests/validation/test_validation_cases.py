"""Validation cases: no value of ours moves from the recorded one, and every verdict is the recorded one."""

import dataclasses

import numpy as np
import pytest

from compact.cli.options import NO_RESULT, SUCCESS
from compact.cli.program import validate
from compact.validation import compaction, plant_case
from compact.validation.case import CASES, Comparison, read_rows
from compact.validation.compaction import MIX, arc_forces, chord_forces, shear_strength

CHEAP, LONG = 0.5, 60.0  # [s], of processor time; longer cases are slow tests, or those of the night


def marked(about):
    """Case of a row of cases.csv as a parameter with the mark of its length."""
    seconds = float(about["seconds"])
    marks = [pytest.mark.nightly] if seconds > LONG else [pytest.mark.slow] if seconds > CHEAP else []
    return pytest.param(CASES[about["case"]], marks=marks, id=about["case"])


@pytest.mark.parametrize("case", list(map(marked, read_rows("cases.csv"))))
def test_values_and_verdicts_are_the_recorded_ones(case):
    comparisons = case.evaluated().rows.values()
    assert [each.key for each in comparisons if each.moved] == []
    recorded = {row["key"]: row["verdict"] for row in read_rows("rows.csv", case=case.name)}
    assert {each.key: each.verdict for each in comparisons} == recorded


def test_every_row_belongs_to_a_case_and_states_one_expected_distance():
    rows = read_rows("rows.csv")
    assert {row["case"] for row in rows} == set(CASES)
    assert all(bool(row["relative"]) != bool(row["absolute"]) for row in rows)
    assert all(row["why"] for row in rows if row["verdict"] == "explained")
    assert len({(row["case"], row["key"]) for row in rows}) == len(rows)


def comparison(**changes):
    return dataclasses.replace(Comparison("key", "quantity", "m", 1.05, 1.0, 0.1), **changes)


def test_a_verdict_is_earned_by_the_distance():
    assert comparison().verdict == "met"
    assert comparison(ours=1.2).verdict == "not met"
    assert comparison(ours=1.2, why="reason unknown").verdict == "not met"
    assert comparison(ours=1.2, why="shown by another number", explained=True).verdict == "explained"
    assert comparison(relative=None, absolute=0.04).verdict == "not met"
    assert comparison(ours=float("nan")).verdict == "not met"


def test_the_command_prints_a_case_and_fails_if_a_value_moves(monkeypatch, capsys, tmp_path):
    assert validate(("cam-clay",), out=tmp_path) == SUCCESS
    said = capsys.readouterr()
    assert "8 numbers of 1 case: 8 met, 0 explained, 0 not met" in said.out
    assert (tmp_path / "validation" / "cam-clay.png").exists()
    case = CASES["cam-clay"]
    moved = {key: dataclasses.replace(row, recorded=0.75) for key, row in case.rows.items()}
    monkeypatch.setattr(plant_case, "CASES", {"cam-clay": dataclasses.replace(case, rows=moved)})
    assert validate(("cam-clay",)) == NO_RESULT
    said = capsys.readouterr()
    assert "MOVED: ours 0.748075436, recorded 0.75" in said.out
    assert "8 computed numbers have moved" in said.err


# slip-line theory and the strength of the mix


def test_a_vanishing_heap_has_prandtls_pressure():
    heap = np.array([1e-8])
    vertical, horizontal = chord_forces(heap)
    length = 2 * np.sin(np.arccos(1 - heap) / 2)
    assert vertical / length == pytest.approx(2 + np.pi, rel=1e-3)
    assert horizontal / vertical == pytest.approx(np.sqrt(heap / 2), rel=1e-3)


@pytest.mark.parametrize("heap", [0.01, 0.05, 0.2])
def test_forces_of_the_arc_are_the_integrals_of_its_pressure(heap):
    slope = np.linspace(0, np.arccos(1 - heap), 20001)
    pressure = 2 + np.pi - slope[-1] - 2 * slope
    vertical, horizontal = arc_forces(np.array(heap))
    assert float(vertical) == pytest.approx(np.trapezoid(pressure * np.cos(slope), slope), rel=1e-8)
    assert float(horizontal) == pytest.approx(np.trapezoid(pressure * np.sin(slope), slope), rel=1e-8)


def test_the_arc_has_the_load_of_its_chord_and_a_steeper_force():
    heap = np.linspace(0.01, 0.06, 6)
    chord, arc = chord_forces(heap), arc_forces(heap)
    assert arc[0] == pytest.approx(chord[0], rel=2e-3)
    assert (arc[1] / arc[0] < chord[1] / chord[0]).all()


def test_the_mix_stays_on_its_flat_side_under_the_indenter():
    """(1 + pi) k lies below half of the preconsolidation pressure, so that nothing compacts."""
    assert (1 + np.pi) * shear_strength(MIX) < float(MIX.yield_pressure(MIX.fed_density_ratio)) / 2
    assert MIX.unloading_modulus / shear_strength(MIX) > 1000


@pytest.mark.parametrize("speed", [100.0, 1000.0])
def test_the_half_plane_of_finite_elements_is_thick_enough_at_high_speed(speed):
    found, exact = (compaction._resistance(engine, speed) for engine in ("fem", "spectral"))
    assert found == pytest.approx(exact, rel=5e-3)
