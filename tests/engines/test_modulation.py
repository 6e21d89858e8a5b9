"""Resistance at first order in the acceleration by the engine "spectral": limits, published tables, errors."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rolling_scenes import SPEED, prescribing, random_scenes

from compact.analysis.engines import expand_resistance
from compact.engines.spectral import engine as spectral
from compact.engines.spectral import rolling_problem as problems
from compact.engines.spectral import speed_derivative as spectral_expansion
from compact.engines.spectral.galerkin_system import assemble_system
from compact.engines.spectral.rolling_problem import build_rolling_problem, solve_contact
from compact.material.laws import Elastic, Viscoelastic
from compact.resistance import UNSTEADINESS_LIMIT, ResistanceExpansion
from compact.rolling_contact import Layer, Ply, Roller

R = 0.11
BONDED, SLIP = Layer(0.22), Layer(0.22, "slip")
PLIES = Layer(0.22, plies=(Ply(0.17, 1.0), Ply(0.05, 3.0)))
MIX = Viscoelastic(10e6, 0.3, branches=((1.0, 0.05),))  # table e2
THREE = Viscoelastic(10e6, 0.3, branches=((0.5, 0.02), (1.0, 0.1), (0.3, 1.0)))


def pressed(indentation=0.006, **other):
    return Roller(R, indentation=indentation, **other)


def scale(found):
    """What errors of M are relative to, as M passes zero."""
    return max(abs(found.added_mass), found.relaxation_time * abs(found.slope))


def winkler(deborah, height=0.1, **engine):
    """F R^2/(kr b^4) and M R^2/(kr b^3 tau^2) of a thin slipping layer at De = v tau/b, in units of v and b."""
    radius, mix = 100.0, Viscoelastic(0.91, 0.3, branches=((1.0, deborah),))
    found = expand_resistance(Layer(height, "slip"), Roller(radius, indentation=0.5 / radius), mix, 1.0, **engine)
    return found.resistance * radius**2 * height, found.added_mass * radius**2 * height / deborah**2


# closed form


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
def test_slow_rolling_lags_by_the_mean_relaxation_time(layer, roller):
    share, time = np.array(THREE.branches).T
    found = expand_resistance(layer, roller, THREE, 1e-7)
    assert found.added_mass / found.slope == pytest.approx(-(share @ time**2) / (share @ time), rel=1e-4)


def test_elastic_layer_remembers_nothing():
    found = expand_resistance(BONDED, pressed(friction=0.3, rolling="sliding"), Elastic(10e6, 0.3), 0.3)
    assert (found.slope, found.added_mass, found.error, found.relaxation_time) == (0.0, 0.0, 0.0, 0.0)
    assert found.unsteadiness(5.0) == 0.0
    assert found.resistance > 0


def test_many_relaxation_times_of_one_length_are_one():
    split = replace(MIX, branches=((0.3, 0.05), (0.7, 0.05 * (1 + 1e-12))))
    one, two = (expand_resistance(SLIP, pressed(), mix, 0.3) for mix in (MIX, split))
    assert two.added_mass == pytest.approx(one.added_mass, rel=1e-8)


# order


def test_memory_fades_with_the_third_power_of_speed():
    speeds = np.geomspace(1e2, 1e4, 4)
    masses = [abs(expand_resistance(BONDED, pressed(), MIX, speed).added_mass) for speed in speeds]
    rate = np.polyfit(np.log(speeds), np.log(masses), 1)[0]
    assert rate == pytest.approx(-3, abs=0.02), f"M falls as v^{rate:.2f}"


def test_what_is_left_is_of_second_order_in_the_acceleration():
    """Against exact quadratures of the Winkler foundation at constant deceleration, contact.md e: m = De = 1."""
    steady, exact = 0.10445711, {-0.3: 0.09690354, -0.03: 0.10355338}
    mass = winkler(1.0)[1]
    left = [abs(force - steady - acceleration * mass) for acceleration, force in exact.items()]
    order = np.log10(left[0] / left[1])
    assert order == pytest.approx(2, abs=0.15), f"what is left falls as a^{order:.2f}"


def test_error_falls_geometrically_with_the_modes():
    (scene, _), modes = build_rolling_problem(BONDED, pressed(), MIX, 0.1), np.array([4, 7, 10])
    contacts = [solve_contact(scene, int(count), 0.017, []) for count in (*modes, 40)]
    *masses, exact = (spectral_expansion._expansion(scene, contact)[1] for contact in contacts)
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


@pytest.mark.parametrize(("deborah", "resistance", "mass"), TABLE_E)
def test_thin_slip_layer_is_the_winkler_foundation_of_table_e(deborah, resistance, mass):
    """Extrapolated to no height at all: the distance falls with the cube of the height."""
    thin, thinner = (np.array(winkler(deborah, height)) for height in (0.2, 0.1))
    found = (8 * thinner - thin) / 7
    assert thinner == pytest.approx((resistance, mass), rel=5e-3)
    assert found[0] == pytest.approx(resistance, rel=3e-6)
    assert found[1] == pytest.approx(mass, abs=6e-7)  # as printed


@pytest.mark.parametrize(("speed", "acceleration", "force"), CONSTANT_ACCELERATION)
def test_constant_acceleration_on_a_winkler_foundation(speed, acceleration, force):
    """The second order is below 0.4 % at an unsteadiness of `UNSTEADINESS_LIMIT`, and falls with its square."""
    steady = {deborah: resistance for deborah, resistance, _ in TABLE_E}[speed]
    unsteadiness = abs(acceleration) / speed
    left = abs(force - steady - acceleration * winkler(speed)[1])
    assert left < 0.004 * (unsteadiness / UNSTEADINESS_LIMIT) ** 2 * force


@pytest.mark.parametrize("speed", [1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_speeds_over_fifteen_decades(speed):
    found = expand_resistance(BONDED, pressed(), MIX, speed)
    assert found.error <= 1e-3 * scale(found)
    assert found.slope * (1 if speed < 0.5 else -1) > 0


# properties

DEEP = Roller(R, load=1e4)
speeds = st.floats(1e-2, 1e1)
rollers = st.sampled_from(
    [pressed(), DEEP, pressed(profile="circle", friction=0.4, rolling="sliding"), Roller(R, peak_pressure=2e5)]
)


@settings(max_examples=6, deadline=None)
@given(rollers, st.sampled_from([BONDED, SLIP]), speeds)
def test_slope_is_that_of_steady_rolling(roller, layer, speed):
    found = expand_resistance(layer, roller, THREE, speed)
    slower, here, faster = (
        spectral.roll(layer, roller, THREE, speed * (1 + side * 1e-3), rtol=1e-7).resistance for side in (-1, 0, 1)
    )
    assert found.resistance == pytest.approx(here, rel=1e-4)
    assert found.slope == pytest.approx(
        (faster - slower) / (2e-3 * speed), abs=3e-4 * scale(found) / found.relaxation_time
    )


@settings(max_examples=6, deadline=None)
@given(rollers, st.sampled_from([BONDED, SLIP]), speeds)
def test_added_mass_is_even_in_speed(roller, layer, speed):
    there, back = (expand_resistance(layer, roller, MIX, side * speed) for side in (1, -1))
    assert (back.resistance, back.slope, back.added_mass) == (-there.resistance, there.slope, there.added_mass)


@settings(max_examples=6, deadline=None)
@given(st.floats(1e-2, 1e2), st.floats(1e4, 1e9), st.floats(1e-3, 1e3), speeds)
def test_added_mass_scales_as_modulus_and_time_squared(length, modulus, time, speed):
    small, large = (
        expand_resistance(
            Layer(each),
            Roller(0.5 * each, indentation=0.02 * each),
            Viscoelastic(stiff, 0.3, ((1.0, late), (0.5, 5 * late))),
            speed * each / late,
        )
        for each, stiff, late in ((1.0, 1.0, 1.0), (length, modulus, time))
    )
    assert large.added_mass == pytest.approx(small.added_mass * modulus * time**2, rel=1e-6, abs=1e-6 * scale(large))


# its own error


@pytest.mark.parametrize("scenes", [slice(2, 12), pytest.param(slice(60), marks=pytest.mark.slow)], ids=["few", "many"])
def test_error_told_is_the_true_one(scenes):
    """Against 200 modes."""
    for layer, roller, mix, name in list(random_scenes(60))[scenes]:
        if not mix.branches:
            continue
        given = prescribing(roller, name, getattr(spectral.roll(layer, roller, mix, SPEED), name))
        found = expand_resistance(layer, given, mix, SPEED)
        scene, half_width = build_rolling_problem(layer, given, mix, SPEED)
        exact = spectral_expansion._expansion(scene, solve_contact(scene, 200, half_width, []))[1] / SPEED**2
        assert abs(found.added_mass - exact) <= 2 * found.error


# cost


def test_few_systems_are_assembled(monkeypatch):
    calls = []
    for module in (spectral_expansion, problems):
        monkeypatch.setattr(module, "assemble_system", lambda *given: calls.append(given[1]) or assemble_system(*given))
    expand_resistance(BONDED, pressed(), MIX, 0.3)
    assert len(calls) <= 40
    assert max(calls) <= 36


# refusals


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
def test_refused_with_the_reason(engine, change, words):
    given = {"layer": BONDED, "roller": pressed(), "material": MIX, "speed": 0.3, "engine": engine} | change
    with pytest.raises(ValueError, match=words):
        expand_resistance(**given)


def test_speed_too_low_to_tell_raises():
    with pytest.raises(
        RuntimeError,
        match=r"the longest creep length is .* half-widths, too short for the digits of M; use a higher speed",
    ):
        expand_resistance(BONDED, pressed(), MIX, 1e-14)


def test_too_few_modes_raise_with_what_was_tried(monkeypatch):
    monkeypatch.setattr(spectral, "MODE_COUNTS", (3, 4, 6))
    with pytest.raises(RuntimeError, match=r"the added mass M does not converge: \(modes, error .*\) were \[\(6, "):
        expand_resistance(BONDED, pressed(), replace(MIX, branches=((30.0, 0.01),)), 0.03)


def test_unsteadiness_of_what_is_no_acceleration_is_refused():
    with pytest.raises(ValueError, match="`acceleration` must be finite, got nan"):
        ResistanceExpansion(1.0, 1.0, 1.0, 1.0, 0.0, 0.1).unsteadiness(np.nan)
