"""Expansion of the resistance in speed and acceleration by the engine "spectral": limits, tables, errors."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rolling_scenes import SPEED, prescribing, random_scenes
from sampling import examples

from compact.analysis.engines import expand_resistance
from compact.engines.spectral import engine as spectral
from compact.engines.spectral import speed_derivative
from compact.engines.spectral.engine import build_rolling_problem, solve_contact
from compact.engines.spectral.galerkin_system import assemble_system
from compact.material.laws import Elastic, Viscoelastic
from compact.resistance import UNSTEADINESS_LIMIT, ResistanceExpansion
from compact.rolling_contact import Layer, Ply, Roller

R = 0.11
BONDED, SLIP = Layer(0.22), Layer(0.22, base="slip")
PLIES = Layer(0.22, plies=(Ply(thickness=0.17, stiffness=1.0), Ply(thickness=0.05, stiffness=3.0)))
MIX = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 0.05),))  # table e2
THREE = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((0.5, 0.02), (1.0, 0.1), (0.3, 1.0)))


def pressed(indentation=0.006, **other):
    return Roller(R, indentation=indentation, **other)


def scale(found):
    """Scale of the errors of M, which passes through zero."""
    return max(abs(found.added_mass), found.relaxation_time * abs(found.slope))


@cache
def winkler(deborah, height=0.1):
    """F R^2/(kr b^4) and M R^2/(kr b^3 tau^2) of a thin layer on a frictionless base at De = v tau/b."""
    radius, mix = 100.0, Viscoelastic(youngs_modulus=0.91, poisson=0.3, branches=((1.0, deborah),))
    found = expand_resistance(Layer(height, base="slip"), Roller(radius, indentation=0.5 / radius), mix, 1.0)
    return found.resistance * radius**2 * height, found.added_mass * radius**2 * height / deborah**2


# closed form


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    "roller",
    [
        pressed(),
        pressed(profile="circle", friction=0.4, rolling="sliding"),
        Roller(R, load=1e4),
        Roller(R, peak_pressure=2e5),
    ],
    ids=["indentation", "circle sliding", "load", "peak pressure"],
)
@pytest.mark.parametrize("layer", [BONDED, SLIP, PLIES], ids=["bonded", "slip", "plies"])
def test_lag_at_low_speed_is_the_mean_relaxation_time(layer, roller):
    share, time = np.array(THREE.branches).T
    found = expand_resistance(layer, roller, THREE, 1e-7)
    assert found.added_mass / found.slope == pytest.approx(-(share @ time**2) / (share @ time), rel=1e-4)


def test_elastic_layer_has_no_added_mass():
    found = expand_resistance(
        BONDED, pressed(friction=0.3, rolling="sliding"), Elastic(youngs_modulus=10e6, poisson=0.3), 0.3
    )
    assert (found.slope, found.added_mass, found.error, found.relaxation_time) == (0.0, 0.0, 0.0, 0.0)
    assert found.unsteadiness(5.0) == 0.0
    assert found.resistance > 0


def test_equal_relaxation_times_act_as_one_branch():
    split = replace(MIX, branches=((0.3, 0.05), (0.7, 0.05 * (1 + 1e-12))))
    one, two = (expand_resistance(SLIP, pressed(), mix, 0.3) for mix in (MIX, split))
    assert two.added_mass == pytest.approx(one.added_mass, rel=1e-8)


# order


def test_added_mass_falls_with_the_third_power_of_speed():
    speeds = np.geomspace(1e2, 1e4, 4)
    masses = [abs(expand_resistance(BONDED, pressed(), MIX, speed).added_mass) for speed in speeds]
    rate = np.polyfit(np.log(speeds), np.log(masses), 1)[0]
    assert rate == pytest.approx(-3, abs=0.02), f"M falls as v^{rate:.2f}"


def test_remainder_is_of_second_order_in_the_acceleration():
    """The reference is the quadrature of the Winkler foundation at constant deceleration, contact.md e, m = De = 1."""
    steady, exact = 0.10445711, {-0.3: 0.09690354, -0.03: 0.10355338}
    mass = winkler(1.0)[1]
    remainder = [abs(force - steady - acceleration * mass) for acceleration, force in exact.items()]
    order = np.log10(remainder[0] / remainder[1])
    assert order == pytest.approx(2, abs=0.15), f"the remainder falls as a^{order:.2f}"


def test_error_falls_geometrically_with_the_modes():
    (problem, _), modes = build_rolling_problem(BONDED, pressed(), MIX, 0.1), np.array([4, 7, 10])
    contacts = [solve_contact(problem, int(count), 0.017, []) for count in (*modes, 40)]
    *masses, exact = (speed_derivative._expansion(problem, contact)[1] for contact in contacts)
    rate = -np.polyfit(modes, np.log(np.abs(np.array(masses) / exact - 1)), 1)[0]
    assert rate > 1, f"error falls by exp(-{rate:.2f}) a mode"


# published numbers: tables of reference/contact.md

TABLE_E2 = [
    (0.05, 5.86129e-5, 9.4278e-4, -3.904e-5),
    (0.2, 1.29245e-4, 1.6930e-4, 1.764e-6),
    (1.0, 1.21647e-4, -3.5182e-5, 1.213e-6),
]
TABLE_E = [
    (0.03, 0.01868985, -0.551640),
    (0.1, 0.05309453, -0.323041),
    (0.3, 0.10107269, 0.004042),
    (0.5, 0.11235094, 0.051034),
    (1.0, 0.10445711, 0.030866),
    (3.0, 0.06130111, 0.003842),
]
CONSTANT_ACCELERATION = [  # v, a, F at that instant, m = 1, tau = b = kr = R = 1, to 8 digits
    (0.1, -0.03, 0.06090090),
    (1.0, -0.3, 0.09690354),
    (1.0, -0.03, 0.10355338),
    (1.0, 0.03, 0.10540707),
    (3.0, -0.9, 0.05820110),
]


@pytest.mark.parametrize(("speed", "resistance", "slope", "mass"), TABLE_E2)
def test_layer_of_table_e2(speed, resistance, slope, mass):
    modulus = MIX.contact_modulus
    found = expand_resistance(BONDED, pressed(), MIX, speed)
    assert found.resistance / modulus == pytest.approx(resistance, rel=4e-4)
    assert found.slope / modulus == pytest.approx(slope, rel=4e-4)
    assert found.added_mass / modulus == pytest.approx(mass, rel=4e-4)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("deborah", "resistance", "mass"), TABLE_E)
def test_thin_layer_on_a_frictionless_base_is_the_winkler_foundation_of_table_e(deborah, resistance, mass):
    """The values are extrapolated to zero height; the deviation falls with the cube of the height."""
    thin, thinner = (np.array(winkler(deborah, height)) for height in (0.2, 0.1))
    found = (8 * thinner - thin) / 7
    assert thinner == pytest.approx((resistance, mass), rel=5e-3)
    assert found[0] == pytest.approx(resistance, rel=3e-6)
    assert found[1] == pytest.approx(mass, abs=6e-7)  # printed digits


@pytest.mark.parametrize(("speed", "acceleration", "force"), CONSTANT_ACCELERATION)
def test_constant_acceleration_on_a_winkler_foundation(speed, acceleration, force):
    """The remainder is below 0.4 % at an unsteadiness of `UNSTEADINESS_LIMIT` and falls with its square."""
    steady = {deborah: resistance for deborah, resistance, _ in TABLE_E}[speed]
    unsteadiness = abs(acceleration) / speed
    remainder = abs(force - steady - acceleration * winkler(speed)[1])
    assert remainder < 0.004 * (unsteadiness / UNSTEADINESS_LIMIT) ** 2 * force


@pytest.mark.parametrize("speed", [1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_slope_and_error_over_fifteen_decades_of_speed(speed):
    found = expand_resistance(BONDED, pressed(), MIX, speed)
    assert found.error <= 1e-3 * scale(found)
    assert found.slope * (1 if speed < 0.5 else -1) > 0


# properties

speeds = st.floats(1e-2, 1e1)
rollers = st.sampled_from(
    [
        pressed(),
        Roller(R, load=1e4),
        pressed(profile="circle", friction=0.4, rolling="sliding"),
        Roller(R, peak_pressure=2e5),
    ]
)


@examples(3, slow=6)
@given(rollers, st.sampled_from([BONDED, SLIP]), speeds)
def test_slope_agrees_with_differences_of_steady_rolling(roller, layer, speed):
    found = expand_resistance(layer, roller, THREE, speed)
    slower, steady, faster = (
        spectral.roll(layer, roller, THREE, speed * (1 + side * 1e-3), rtol=1e-7).resistance for side in (-1, 0, 1)
    )
    assert found.resistance == pytest.approx(steady, rel=1e-4)
    assert found.slope == pytest.approx(
        (faster - slower) / (2e-3 * speed), abs=3e-4 * scale(found) / found.relaxation_time
    )


@examples(3, slow=6)
@given(rollers, st.sampled_from([BONDED, SLIP]), speeds)
def test_added_mass_is_even_in_speed(roller, layer, speed):
    forth, back = (expand_resistance(layer, roller, MIX, side * speed) for side in (1, -1))
    assert (back.resistance, back.slope, back.added_mass) == (-forth.resistance, forth.slope, forth.added_mass)


@examples(3, slow=6)
@given(st.floats(1e-2, 1e2), st.floats(1e4, 1e9), st.floats(1e-3, 1e3), speeds)
def test_added_mass_scales_as_modulus_and_time_squared(length, modulus, time, speed):
    small, large = (
        expand_resistance(
            Layer(size),
            Roller(0.5 * size, indentation=0.02 * size),
            Viscoelastic(youngs_modulus=stiff, poisson=0.3, branches=((1.0, tau), (0.5, 5 * tau))),
            speed * size / tau,
        )
        for size, stiff, tau in ((1.0, 1.0, 1.0), (length, modulus, time))
    )
    assert large.added_mass == pytest.approx(small.added_mass * modulus * time**2, rel=1e-6, abs=1e-6 * scale(large))


# error estimate


@pytest.mark.parametrize("scenes", [slice(2, 4), pytest.param(slice(60), marks=pytest.mark.slow)], ids=["few", "many"])
def test_error_estimate_covers_the_true_error(scenes):
    """The reference has 200 modes."""
    for layer, roller, mix, name in list(random_scenes(60))[scenes]:
        if not mix.branches:
            continue
        target_roller = prescribing(roller, name, getattr(spectral.roll(layer, roller, mix, SPEED), name))
        found = expand_resistance(layer, target_roller, mix, SPEED)
        problem, half_width = build_rolling_problem(layer, target_roller, mix, SPEED)
        exact = speed_derivative._expansion(problem, solve_contact(problem, 200, half_width, []))[1] / SPEED**2
        assert abs(found.added_mass - exact) <= 2 * found.error


# cost


def test_number_of_assembled_systems_is_bounded(monkeypatch):
    calls = []
    for module in (speed_derivative, spectral):
        monkeypatch.setattr(module, "assemble_system", lambda *args: calls.append(args[1]) or assemble_system(*args))
    expand_resistance(BONDED, pressed(), MIX, 0.3)
    assert len(calls) <= 40
    assert max(calls) <= 36


# refused arguments and failures


@pytest.mark.parametrize(
    ("engine", "change", "words"),
    [
        ("spectral", {"speed": 0.0}, "`speed` must not be 0, got 0"),
        ("spectral", {"roller": pressed(profile="deformed")}, "'parabola' or 'circle', got 'deformed'; use fem"),
        ("spectral", {"rtol": -1.0}, "`rtol` must be positive and finite, got -1.0"),
        ("column", {}, "no engine with memory in time 'column'; choose from spectral, fem"),
    ],
    ids=str,
)
def test_contact_out_of_range_is_refused(engine, change, words):
    arguments = {"layer": BONDED, "roller": pressed(), "material": MIX, "speed": 0.3, "engine": engine} | change
    with pytest.raises(ValueError, match=words):
        expand_resistance(**arguments)


def test_speed_without_digits_of_the_added_mass_raises():
    with pytest.raises(
        RuntimeError,
        match=r"the longest creep length is .* half-widths, too short for the digits of M; use a higher speed",
    ):
        expand_resistance(BONDED, pressed(), MIX, 1e-14)


def test_insufficient_modes_raise_with_the_errors(monkeypatch):
    monkeypatch.setattr(spectral, "MODE_COUNTS", (3, 4, 6))
    with pytest.raises(RuntimeError, match=r"the added mass M does not converge: \(modes, error .*\) were \[\(6, "):
        expand_resistance(BONDED, pressed(), replace(MIX, branches=((30.0, 0.01),)), 0.03)


def test_unsteadiness_refuses_an_acceleration_that_is_not_finite():
    with pytest.raises(ValueError, match="`acceleration` must be finite, got nan"):
        ResistanceExpansion(1.0, 1.0, 1.0, 1.0, 0.0, 0.1).unsteadiness(np.nan)
