"""Forming process by columns: conservation, the confined identity, one stroke as one pass, closures and hard cases."""

from dataclasses import replace

import numpy as np
import pytest
from column_cases import mix

from compact.analysis.multipass import Pass, passes
from compact.engines.column import engine as column
from compact.engines.column.column_pass import Column
from compact.engines.process.forming import Closure, Feed, FormingMachine
from compact.engines.process.loose_mix import bed_stress, extrusion_pressure, sleeve_drag
from compact.engines.process.roller_row import RollerRow
from compact.engines.process.strokes import FeedError, FormingProblem, confined_work, solve_closure
from compact.rolling_contact import Layer, Roller

MIX = mix(unloading_modulus=60e6, fed_density_ratio=0.75, dry_side="flat")
RATED = replace(MIX, rate_sensitivity=0.02)
MACHINE = FormingMachine(0.11, 0.4, 0.22, 0.45, 0.4 / 0.45, 1.05 / 60, 20.0)
FEEDS = {
    "room": Feed(0.75),
    "even": Feed(0.75, "even"),
    "first": Feed(0.75, "first", 6),
    "forward": Feed(0.75, strokes="forward"),
}
DENSE = Closure("product_density_ratio", 0.98)
HALF = Closure("product_density_ratio", 0.83)  # reached in a few strokes


def at_rest(strokes):
    return replace(MACHINE, mould_speed=0.0, strokes=strokes)


def problem(machine=MACHINE, material=MIX, feed=FEEDS["room"], fill=None, layers=3):
    return FormingProblem(machine, material, fill or Column(0.22, 0.75), feed, layers)


def with_strokes(strokes, length=0.4):
    """Machine whose sections have a whole number of strokes."""
    return replace(MACHINE, roller_length=length, mould_speed=length / (strokes * MACHINE.stroke_period))


def row_of(given, closure=DENSE):
    return RollerRow(solve_closure(given, closure), 0.98)


# --- conservation and the confined identity


@pytest.mark.parametrize("feed", FEEDS.values(), ids=FEEDS)
@pytest.mark.parametrize("closure", [HALF, Closure("extrusion_pressure", 40e3)], ids=lambda each: each.kind)
def test_grains_and_work_close(feed, closure):
    found = row_of(problem(at_rest(8), RATED, feed), closure)
    assert found.flow.product == pytest.approx(found.flow.fill + found.flow.fed, rel=1e-9)
    assert abs(found.history.mass_residual) < 1e-9
    assert found.history.work_residual < 1e-9


@pytest.mark.parametrize("feed", FEEDS.values(), ids=FEEDS)
@pytest.mark.parametrize(("length", "strokes"), [(0.3, 8), (1.164, 12)])
def test_resistance_of_all_strokes_is_that_of_one_pass_over_all_mix(feed, length, strokes):
    """The plastic work of confined mix depends on its densities alone."""
    machine = replace(at_rest(strokes), roller_length=length)
    found = row_of(problem(machine, feed=feed, fill=Column(0.215, 0.78)), HALF)
    fed = float(found.history.make_up.sum())
    columns = Column(0.215, 0.78), Column(fed, 0.75)
    # a roller as large as to draw in all the mix at once
    once = column.roll_over(columns, Roller(10.0, indentation=0.215 + fed - 0.22, profile="circle"), MIX, 0.45)
    assert found.history.resistance.sum() == pytest.approx(once.resistance, rel=1e-4)


@pytest.mark.parametrize(("modulus", "difference"), [(60e6, 4e-3), pytest.param(600e6, 6e-4, marks=pytest.mark.slow)])
def test_closed_form_of_the_floor_differs_by_the_elastic_strain(modulus, difference):
    machine = with_strokes(20)
    found = row_of(problem(machine, replace(MIX, unloading_modulus=modulus)), Closure("product_density_ratio", 0.96))
    assert 0 < 1 - found.numbers["confined_floor"] / found.resistance < difference


def test_confined_work_equals_the_antiderivative_of_heckels_curve():
    """w = k [A/K (G(k) - G(k_in)) + (A - 1) pt (1/k_in - 1/k)], G = ln(k/(1 - k)) - ln((1 - k0)/(1 - k))/k."""
    A, k, k_in = MIX.confined_stress_ratio, 0.98, 0.75

    def integral(k):
        return np.log(k / (1 - k)) - np.log(0.28 / (1 - k)) / k

    exact = k * (A / 13e-6 * (integral(k) - integral(k_in)) + (A - 1) * 14e3 * (1 / k_in - 1 / k))
    assert confined_work(MIX, [(1.0, k_in)], k) == pytest.approx(exact, rel=1e-12)
    halves = [(0.5, k_in), (0.5, k)]
    assert confined_work(MIX, halves, k) == pytest.approx(exact / 2, rel=1e-12)


# --- one stroke, layers, cost


@pytest.mark.parametrize("material", [MIX, RATED], ids=["rate-independent", "rate-dependent"])
def test_one_stroke_is_a_pass(material):
    found = row_of(problem(at_rest(1), material), Closure("gap", 0.004)).history
    (once,) = passes(
        Layer(0.224), Roller(0.11, indentation=0.004, profile="circle"), material, 0.45, [Pass(height=0.22)]
    )
    assert found.load[0] == pytest.approx(once.load, rel=1e-9)
    assert found.resistance[0] == pytest.approx(once.resistance, rel=1e-9)
    assert found.leading[0] == pytest.approx(once.leading, rel=1e-9)
    assert found.trailing[0] == pytest.approx(-once.trailing, rel=1e-7)
    assert found.density_ratio[-1] == pytest.approx(once.exit_density_ratio, rel=1e-10)


def test_merged_layers_do_not_change_the_load():
    fill = Column(0.22, 0.80)  # of another density than the feed
    loads = [problem(fill=fill, layers=layers).with_amount(0.0008).load for layers in (3, 20, 80)]
    assert loads[0] == pytest.approx(loads[2], rel=1e-6)
    assert loads[1] == pytest.approx(loads[2], rel=1e-6)


# --- row, closures


def test_row_integrates_strokes_along_the_roller():
    found = row_of(problem())
    history, lengths = found.history, found.lengths
    assert lengths.sum() == pytest.approx(0.4, rel=1e-12)
    assert MACHINE.strokes_on_section == pytest.approx(25.714286, rel=1e-7)
    assert lengths[-1] == pytest.approx(0.714286 * MACHINE.advance, rel=1e-6)
    assert found.product_density_ratio == pytest.approx(0.98, abs=1e-8)
    numbers = found.numbers
    assert found.load == pytest.approx(history.load @ lengths)
    middle = found.edges[:-1] + lengths / 2
    moment = float((history.load * lengths) @ (middle - 0.4 / 2))
    assert numbers["skew_moment"] == pytest.approx(moment, rel=1e-9)
    assert 0.5 < numbers["load_centre"] / 0.4 < 0.8
    ratios = [column.density_ratio for column in history.states[-1].columns]
    assert np.ptp(ratios) < 1e-6  # over the height


def test_gap_is_ill_conditioned():
    """A tenth of a millimetre of the gap decides between loose and dense mix."""
    ratios = [row_of(problem(), Closure("gap", gap)).product_density_ratio for gap in (2.6e-3, 2.7e-3, 2.8e-3)]
    assert np.diff(ratios).min() > 0.004
    with pytest.raises(
        FeedError, match=r"stroke \d+ closes all pores: grains and water alone fill .*0.22.* feed less mix"
    ):
        solve_closure(problem(), Closure("gap", 3.5e-3))


def test_pressure_of_extrusion_bounds_the_peak_and_surplus_is_extruded():
    found = row_of(problem(at_rest(60)), Closure("extrusion_pressure", 203e3))
    assert found.numbers["peak_pressure"] == pytest.approx(203e3, rel=1e-6)
    assert found.flow.extruded == pytest.approx(found.flow.fill)
    assert found.flow.retained > 0
    offered = 60 * MACHINE.max_bite * 0.75
    assert found.flow.fed + found.flow.extruded + found.flow.retained == pytest.approx(offered, rel=1e-9)
    little = row_of(problem(at_rest(30)), Closure("extrusion_pressure", 203e3, offered=1e-4))
    assert little.flow.extruded == little.flow.retained == 0
    assert little.flow.missing == pytest.approx(little.flow.product * (0.98 / little.product_density_ratio - 1))
    assert little.numbers["peak_pressure"] < 203e3


def test_return_strokes_without_feed_have_no_resistance():
    history = row_of(problem(at_rest(8), feed=FEEDS["forward"]), Closure("gap", 0.003)).history
    assert history.make_up[1::2] == pytest.approx(0)
    assert history.resistance[1::2] == pytest.approx(0, abs=1e-6 * history.resistance[0])
    assert history.load[1::2].min() > 0


# --- hard cases


def test_no_feed_presses_the_fill_alone():
    found = row_of(problem(fill=Column(0.223, 0.75)), Closure("gap", 0.0))
    assert found.flow.fed == 0
    assert found.history.resistance[1:] == pytest.approx(0, abs=1e-6 * found.history.resistance[0])
    low = row_of(problem(fill=Column(0.2, 0.75)), Closure("extrusion_pressure", 1e5, offered=0.0))
    assert low.load == low.resistance == 0
    assert low.numbers["load_centre"] == 0.4 / 2
    assert low.product_density_ratio == pytest.approx(0.75)


def test_mould_at_rest_has_equal_sections():
    found = row_of(problem(at_rest(10)), Closure("gap", 0.001))
    assert found.load == pytest.approx(0.4 * found.history.load[-1])
    assert found.numbers["load_centre"] == pytest.approx(0.4 / 2)
    assert found.numbers["skew_moment"] == pytest.approx(0, abs=1e-9)
    assert found.numbers["confined_floor"] == 0


REFUSED = [
    (lambda: replace(MACHINE, height=-1.0), "`height` must be positive"),
    (lambda: confined_work(MIX, [], 1.0), "`density_ratio` must lie between 0 and 1, got 1.0"),
    (lambda: solve_closure(problem(at_rest(5)), DENSE), r"at most 0.\d+ in 5 strokes whose bite is .*, 6.63 mm"),
    (lambda: solve_closure(problem(feed=Feed(0.75, "first", 5)), DENSE), "stroke 5 would have to draw in mix 1.* mm"),
    (
        lambda: problem(at_rest(1), fill=Column(0.4, 0.75)).with_amount(0.001),
        "stroke 1 would bury the roller to its axis",
    ),
    (
        lambda: solve_closure(problem(fill=Column(0.22, 0.985)), DENSE),
        r"density ratio without any feed, got 0\.98; the",
    ),
    (lambda: solve_closure(problem(fill=Column(0.22, 0.7)), DENSE), r"Heckel's curve at its start, 0\.72, got 0\.7"),
]


@pytest.mark.parametrize(("make", "words"), REFUSED)
def test_processes_without_meaning_are_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()


# --- sleeve, fields


def test_sleeve_has_the_limits_of_janssen():
    rho, K = 1700.0, 0.43
    assert bed_stress(0.18, 1.164, 1.0, 0.0, rho, K) == pytest.approx(9.80665 * rho)
    assert bed_stress(0.18, 1.164, 1e-6, 0.35, rho, K) == pytest.approx(9.80665 * rho * 1e-6, rel=1e-5)
    diameter = 2 * 0.18 * 1.164 / (0.18 + 1.164)
    tall = bed_stress(0.18, 1.164, 50.0, 0.35, rho, K)
    assert tall == pytest.approx(9.80665 * rho * diameter / (4 * 0.35 * K), rel=1e-9)
    drag = sleeve_drag(0.18, 1.164, 1.0, 0.35, rho, 35.0)
    stress = bed_stress(0.18, 1.164, 1.0, 0.35, rho, 1 - np.sin(np.radians(35)))
    assert drag == pytest.approx(stress * 0.18 * 1.164 * np.tan(np.radians(35)))
    assert 500 < drag < 1300
    flowing = sleeve_drag(0.18, 1.164, 1.0, 0.35, rho, 35.0, flowing=True)
    assert 0.1 * drag < flowing < 0.2 * drag  # K of 3.7 in place of 0.43


def test_wedge_bounds_the_thrust_on_the_tongue():
    """Without friction a wedge on the base is held by cohesion alone."""
    length = 0.22 / np.tan(np.radians(35))
    frictionless = extrusion_pressure(0.22, 1e-9, 1e-9, 1e4)
    assert frictionless <= 1e4 * length / 0.22 + 2e4 + 1e-6
    assert extrusion_pressure(0.44, 1700.0, 35.0, 0.0) == pytest.approx(2 * extrusion_pressure(0.22, 1700.0, 35.0, 0.0))
    sliding = 9.80665 * 1700 * 0.22 / 2 / np.tan(np.radians(35)) * np.tan(np.radians(35))  # along the base
    assert extrusion_pressure(0.22, 1700.0, 35.0, 0.0) <= 3.69 * sliding * (1 + 1e-3)
    pressures = [extrusion_pressure(0.22, 1700.0, angle, c) for angle, c in ((30, 5e3), (35, 1e4), (40, 2e4))]
    assert np.all(np.diff(pressures) > 0)
