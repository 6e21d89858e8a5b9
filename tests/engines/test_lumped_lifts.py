"""Forming process in two dimensions: integrals over lumped lifts, extrapolation, and lifts by finite elements."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from column_cases import mix
from lift_sequences import sequence

from compact.engines.column.column_pass import Column
from compact.engines.process import lifts as lumped_lifts
from compact.engines.process.forming import Closure, Feed, FormingMachine
from compact.engines.process.lifts import KnownLifts, simulate_lifts
from compact.engines.process.roller_row import RollerRow
from compact.engines.process.strokes import FormingProblem, solve_closure

MIX = mix(unloading_modulus=60e6, fed_density_ratio=0.75, dry_side="flat")

MACHINE = FormingMachine(0.11, 0.4, 0.22, 0.45, 0.4 / 0.45, 1.05 / 60, 20.0)


@pytest.fixture(scope="module")
def row():
    problem = FormingProblem(MACHINE, MIX, Column(0.22, 0.75), Feed(0.75), 2)
    closure = Closure("product_density_ratio", 0.93)
    return RollerRow(solve_closure(problem, closure), 0.98)


def pair(**functions):
    """Lifts of two thicknesses on one mesh."""
    return sequence(0.004, **functions), sequence(0.005, **functions)


def lifted(row, sequences):
    """The row with lifts of its own rate and speed."""
    return replace(row, lifts=KnownLifts(tuple(sequences), row.history.rate_factor, MACHINE.cart_speed))


def test_mould_at_rest_has_no_work_of_the_throughput(row):
    machine = replace(MACHINE, mould_speed=0.0, strokes=5)
    problem = replace(row.problem, machine=machine)
    still = RollerRow(solve_closure(problem, Closure("gap", 0.001)), 0.98)
    found = lifted(still, pair())
    assert found.estimate("resistance").value == 0
    assert np.isnan(found.numbers_by_lifts["specific_work"])
    assert found.estimate("load").value == pytest.approx(1e3 * 0.4)


def lifts_of(fill, density_ratio=0.9):
    problem = FormingProblem(MACHINE, MIX, fill, Feed(0.75))
    return simulate_lifts(problem, 0.35, 1.0, density_ratio, thickness=0.005, increments=6)


def test_mould_that_is_not_full_takes_lifts_until_the_roller_touches(fake_roll):
    found = lifts_of(Column(0.208, 0.75))
    assert fake_roll[0] == pytest.approx(0.208 + 3 * 0.005 - 0.22)
    assert fake_roll[1:] == pytest.approx([0.005] * (len(fake_roll) - 1))
    assert found.lifts[-1].density_ratio >= 0.9


def test_sequence_ends_where_the_mix_heaps_up(fake_roll, monkeypatch):
    press = lumped_lifts.roll

    def roll(*args, **options):
        wave = 0.0026 if len(fake_roll) == 3 else 0.0024  # of a bite of 5 mm
        passed = press(*args, **options)
        return SimpleNamespace(exit=passed.exit, indentation=0.005, bow_wave=wave, work_residual=0.0)

    monkeypatch.setattr(lumped_lifts, "roll", roll)
    found = lifts_of(Column(0.22, 0.75))
    assert (len(found.lifts), found.stopped) == (4, "from lift 4 on the mix heaps up, in a wave of 2.6 mm")


def test_pass_whose_energy_stays_open_is_rolled_on_a_finer_mesh(fake_roll, monkeypatch):
    press, meshes, settlings = lumped_lifts.roll, [], []

    def roll(*args, increments, **options):
        meshes.append(increments)
        passed = press(*args, increments=increments, **options)
        passed.work_residual = 0.011 if len(meshes) == 2 else 0.009  # of a lift that is asked for 0.01
        return passed

    def settle(passed):
        settlings.append(passed)
        return passed

    monkeypatch.setattr(lumped_lifts, "roll", roll)
    monkeypatch.setattr(lumped_lifts, "_settled", settle)
    lifts_of(Column(0.22, 0.75))
    assert meshes[:4] == [6, 6, 8, 6]
    assert len(settlings) == lumped_lifts.SETTLINGS_MAX


def test_lift_without_a_steady_state_ends_the_sequence_or_is_refused(fake_roll, monkeypatch):
    def fail(*args, **options):
        if fake_roll:
            raise RuntimeError("the mix heaps up; last step")
        return press(*args, **options)

    press = lumped_lifts.roll
    monkeypatch.setattr(lumped_lifts, "roll", fail)
    found = lifts_of(Column(0.22, 0.75))
    assert (len(found.lifts), found.stopped) == (1, "the mix heaps up")
    with pytest.raises(RuntimeError, match="heaps up"):
        lifts_of(Column(0.22, 0.75))
