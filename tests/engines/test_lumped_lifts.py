"""Forming process in two dimensions: integrals over lumped lifts, extrapolation, and lifts by finite elements."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from column_cases import mix
from lift_sequences import sequence

from compact.analysis.multipass import Pass, passes
from compact.engines.column.column_pass import Column
from compact.engines.compaction.engine import roll
from compact.engines.process import lifts as lumped_lifts
from compact.engines.process.forming import Closure, Feed, FormingMachine
from compact.engines.process.kneading import Kneading
from compact.engines.process.lifts import KnownLifts, lift_thickness, simulate_lifts
from compact.engines.process.roller_row import RollerRow
from compact.engines.process.strokes import FormingProblem, grain_height, solve_closure
from compact.material.pore_air import PoreAir
from compact.rolling_contact import Layer, Roller
from compact.turning import LOAD_TRACK, TRACK

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


def test_forces_are_integrals_over_the_strokes(row):
    """Constant P gives P L, constant F/t the advance times the fed thickness."""
    found = lifted(row, pair())
    assert found.estimate("load").value == pytest.approx(1e3 * 0.4, rel=1e-12)
    fed = row.history.make_up @ MACHINE.stroke_shares
    assert found.estimate("resistance").value == pytest.approx(1e5 * MACHINE.advance * fed, rel=1e-12)
    assert found.numbers_by_lifts["specific_work"] == pytest.approx(1e5 * fed / row.product_height, rel=1e-12)
    assert found.estimate("load").extrapolated_share == 0
    assert found.estimate("load").lumping_error == pytest.approx(0, abs=1e-12)
    assert found.estimate("load").mesh_error == pytest.approx(0.01)
    assert found.estimate("resistance").mesh_error == pytest.approx(0.05)
    assert found.estimate("load").error == pytest.approx(0.01)


def test_air_is_in_proportion_to_the_mix_that_a_pass_displaces(row):
    """P_air = c t and F_air = c t^2 of the lifts are those of the strokes with their make-up."""
    found, made_up = lifted(row, pair()), row.history.make_up
    assert found.estimate("air_load").value == pytest.approx(2e4 * float(made_up @ row.lengths), rel=1e-12)
    swept = MACHINE.advance * MACHINE.stroke_shares
    assert found.estimate("air_resistance").value == pytest.approx(1e4 * float(made_up**2 @ swept), rel=1e-12)
    assert found.estimate("air_load").error == pytest.approx(0, abs=1e-12)
    assert found.numbers_by_lifts["air_excess_behind"] == 2e3


def test_two_thicknesses_err_by_the_difference_of_a_line_and_a_power_law(row):
    """Of F/t as a power of t the value is that of the line, and the error leads to the exact result."""
    sequences = tuple(sequence(t, work=lambda k, t=t: 1e5 * t**-0.2) for t in (0.005, 0.006))
    found, made_up = lifted(row, sequences), row.history.make_up
    exact = MACHINE.advance * float(1e5 * made_up**0.8 @ MACHINE.stroke_shares)
    assert found.estimate("resistance").value * (1 + found.estimate("resistance").lumping_error) == pytest.approx(
        exact, rel=1e-9
    )
    assert 0.05 < found.estimate("resistance").lumping_error < 0.1


def test_exponential_forces_are_interpolated_and_extrapolated_exactly(row):
    def load(k):
        return 1e3 * np.exp(12 * k)

    short, long = (lifted(row, pair(to=to, load=load)) for to in (0.85, 0.95))
    exact = float(load(row.history.density_ratio) @ row.lengths)
    assert long.estimate("load").value == pytest.approx(exact, rel=1e-9)
    assert short.estimate("load").value == pytest.approx(exact, rel=1e-9)
    assert 0.4 < short.estimate("load").extrapolated_share < 1
    assert row.centre_of(load(row.history.density_ratio)) > 0.2


def test_few_strokes_are_not_lumped():
    """One stroke is one lift of its make-up; many strokes are at least ten lifts within the nip angle."""
    assert lift_thickness(MACHINE, np.array([0.004]), 0.75) == pytest.approx(0.004)
    many = np.full(75, 1e-3)
    assert lift_thickness(MACHINE, many, 0.75) == pytest.approx(0.75 * MACHINE.max_bite)
    assert lift_thickness(MACHINE, many[:20], 0.75) == pytest.approx(0.75 * 2e-3)


def test_thickness_is_extrapolated_in_a_line(row):
    """The error is the difference to a power law, and leads away from the line."""
    sequences = tuple(sequence(t, work=lambda k, t=t: 1e5 + 2e7 * t) for t in (0.004, 0.006))
    found, made_up = lifted(row, sequences), row.history.make_up
    exact = MACHINE.advance * float((1e5 + 2e7 * made_up) * made_up @ MACHINE.stroke_shares)
    assert found.estimate("resistance").value == pytest.approx(exact, rel=1e-9)
    power = float(found.at_strokes("resistance", power=True) @ made_up) / float(made_up.sum())
    line = float(found.at_strokes("resistance") @ made_up) / float(made_up.sum())
    assert found.estimate("resistance").lumping_error == pytest.approx(abs(power / line - 1), rel=0.05)
    assert found.estimate("resistance").mesh_error == pytest.approx(0.05)


@pytest.fixture
def fake_roll(monkeypatch):
    """Passes that press a section to the lowest generatrix, uniformly and without elastic strain."""
    bites = []

    def press(layer, roller, material, speed, *, fed_layer, increments, steady_tolerance):
        bites.append(roller.indentation)
        share = 1 - roller.indentation / fed_layer.height
        points = replace(fed_layer.points, density_ratio=fed_layer.points.density_ratio / share)
        pressed = replace(fed_layer, heights=fed_layer.heights * share, points=points)
        return SimpleNamespace(exit=pressed, indentation=roller.indentation, bow_wave=0.0)

    def record(passed, before, thickness, *_):
        found = sequence(to=0.8).lifts[0]
        return replace(found, thickness=thickness, density_ratio=passed.exit.density_ratio)

    monkeypatch.setattr(lumped_lifts, "roll", press)
    monkeypatch.setattr(lumped_lifts, "_with_closed_energy", lambda passed: passed)
    monkeypatch.setattr(lumped_lifts, "gyrations_of", lambda *_: 1.0)
    monkeypatch.setattr(lumped_lifts, "_lift", record)
    return bites


@pytest.mark.parametrize("kneading", [None, Kneading(gain=0.5, exponent=0.5)])
def test_kneaded_lifts_soften(fake_roll, kneading, monkeypatch):
    """Of one gyration a lift, shared by all grains; the slope is that at the middle of a pass."""
    slopes = []
    press = lumped_lifts.roll

    def roll(layer, roller, material, *args, **options):
        slopes.append(material.heckel_slope / MIX.heckel_slope)
        return press(layer, roller, material, *args, **options)

    monkeypatch.setattr(lumped_lifts, "roll", roll)
    problem = FormingProblem(MACHINE, MIX, Column(0.22, 0.75), Feed(0.75), kneading=kneading)
    found = simulate_lifts(problem, 0.35, 1.0, 0.85, thickness=0.005, increments=6)
    assert found.lifts[0].gyrations == 1
    assert found.lifts[1].gyrations == pytest.approx(1 + 0.225 / 0.23)
    if kneading is None:
        assert set(slopes) == {1.0}
        return
    assert slopes[0] == 1
    assert slopes[1] == pytest.approx(1 + 0.5 * np.sqrt(0.225 / 0.23 + 0.5))
    assert np.all(np.diff(slopes) > 0)


@pytest.mark.slow
def test_lifts_are_passes_of_finite_elements_and_close_their_balances():
    """A thin product, so that a lift takes seconds."""
    machine = replace(MACHINE, height=0.05)
    problem = FormingProblem(machine, MIX, Column(0.05, 0.75), Feed(0.75))
    found = simulate_lifts(problem, 0.35, 1.0, 0.85, thickness=0.003, increments=6)
    assert found.stopped == ""
    assert len(found.lifts) >= 2
    assert found.lifts[-1].density_ratio >= 0.85
    assert found.largest_work_residual < 0.02
    assert max(lift.mass_residual for lift in found.lifts) < 1e-12
    for count, lift in enumerate(found.lifts, start=1):  # the grains of fill and feed, whatever the meshes between
        grains = sum(grain_height(Column(*row), MIX.bulk_modulus) for row in lift.rows)
        assert grains == pytest.approx(0.75 * (0.05 + 0.003 * count), rel=1e-12)
    assert all(lift.top_density_ratio > lift.bottom_density_ratio for lift in found.lifts)
    roller = Roller(0.11, indentation=0.003, friction=0.35, rolling="free", profile="deformed")
    stages = [Pass(height=0.05), Pass(lift=0.003, height=0.05)]
    results = passes(Layer(0.053), roller, MIX, 0.45, stages, engine="compaction", increments=6)
    # `passes` starts with fresh mix of one row, which the mesh resamples likewise
    assert [lift.load for lift in found.lifts[:2]] == pytest.approx([each.load for each in results], rel=1e-2)
    assert [lift.resistance for lift in found.lifts[:2]] == pytest.approx([e.resistance for e in results], rel=2e-2)


@pytest.mark.slow
@pytest.mark.parametrize("thickness", [0.003, 0.0015])
def test_share_on_the_own_track_of_a_make_up(thickness, monkeypatch):
    """A second pass without feed has the share of a lift or less; behind a thin make-up the surface has settled."""
    passed, press = [], lumped_lifts._passed

    def keep(*args, **options):
        passed.append(press(*args, **options))
        return passed[-1]

    monkeypatch.setattr(lumped_lifts, "_passed", keep)
    machine, stiff = replace(MACHINE, height=0.05), replace(MIX, unloading_modulus=120e6)
    problem = FormingProblem(machine, stiff, Column(0.05, 0.75), Feed(0.75))
    simulate_lifts(problem, 0.35, 1.0, 0.85, thickness=thickness, increments=4)
    state = passed[-1].exit
    if thickness < 0.002:
        assert state.height < machine.height
        return
    roller = Roller(0.11, indentation=state.height - 0.05, friction=0.35, rolling="free", profile="deformed")
    again = roll(Layer(state.height), roller, stiff, 0.45, fed_layer=state, increments=4, steady_tolerance=1e-2)
    assert 0.5 * LOAD_TRACK < again.load / passed[-1].load < LOAD_TRACK
    assert 0.5 * TRACK < again.resistance / passed[-1].resistance < 1.35 * TRACK


@pytest.mark.slow
def test_air_of_a_lift_one_way_and_coupled():
    """Twice the speed over the permeability has twice the force of nearly drained air; coupling is of its order."""
    problem = FormingProblem(replace(MACHINE, height=0.05), MIX, Column(0.05, 0.75), Feed(0.75))

    def first(permeability, coupled):
        air = PoreAir(permeability=permeability, water=0.21, fed_density_ratio=0.75), coupled
        return simulate_lifts(problem, 0.35, 1.0, 0.76, thickness=0.003, increments=6, air=air).lifts[0]

    drained, twice, coupled = first(4e-11, False), first(2e-11, False), first(4e-11, True)
    assert 0 < drained.air_load < 0.05 * drained.load
    assert twice.air_load == pytest.approx(2 * drained.air_load, rel=0.05)
    assert twice.air_resistance == pytest.approx(2 * drained.air_resistance, rel=0.05)
    assert coupled.load == drained.load
    assert 0.3 * drained.air_load < coupled.air_load < 3 * drained.air_load
    assert set(coupled.mesh.cell_data) >= {"density_ratio", "stress", "air_pressure"}
