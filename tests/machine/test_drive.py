"""Rigid drive and ranking: closed forms, energy balance, set-valued resistance, hard cases, errors."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from machine_cases import free, friction, published_law
from published import CART_OF_C
from sampling import examples

from compact.drive import CRITERIA, Crank, Rigid, rank, simulate
from compact.machine.crankshaft import simulate_crankshaft
from compact.machine.elastic_drive import ElasticDrive
from compact.machine.rigid_drive import SAMPLES_PER_PIECE
from compact.motion.profile import LAWS, Cycle, law

CART = CART_OF_C
GUIDE = 0.008 * (2 * 9740.0 - 10e3)  # friction of the published_law guides while both wheels press
UNIT = replace(CART, mass=1.0, guide_friction=0.0)
WITH_IMPULSE = ("constant-velocity", "gear-sector")
# one of each kind: polynomials, boundary layers, steady parts, crank, jumps of acceleration, sines
WITHOUT_IMPULSE = ("cubic", "septic", "complex", "combined-3", "reversal-4", "crank", "parabolic", "modified-trapezoid")
KINDS = (*WITHOUT_IMPULSE, *WITH_IMPULSE)
STEADY_PART = [name for name in LAWS if name.startswith(("combined", "reversal"))]
# int s'^2 dz, in closed form
ENERGY_OF_LAW = {
    "constant-velocity": 1,
    "cubic": 6 / 5,
    "quintic": 10 / 7,
    "septic": 700 / 429,
    "parabolic": 4 / 3,
    "harmonic": np.pi**2 / 8,
    "cycloidal": 3 / 2,
}


def unit_law(name):
    return law(name, stroke=1.0, duration=1.0, rod_length=2.0)


# closed form


@pytest.mark.parametrize(("name", "power"), [("harmonic", np.pi**3 / 8), ("cycloidal", 3 * np.sqrt(3) * np.pi / 2)])
def test_peak_power_of_a_unit_cart(name, power):
    assert simulate(UNIT, Rigid(), unit_law(name), free).peak_power == pytest.approx(power, rel=1e-8)


@pytest.mark.parametrize("name", WITHOUT_IMPULSE)
def test_free_cart_requires_mass_times_acceleration(name):
    motion = published_law(name)
    run = simulate(replace(UNIT, mass=1000.0), Rigid(), motion, free)
    assert run.peak_force == pytest.approx(1000 * motion.peaks().acceleration, rel=1e-8)
    assert run.drive_force == pytest.approx(1000 * run.state.acceleration, rel=1e-14)


@pytest.mark.parametrize("name", WITHOUT_IMPULSE)
def test_peak_jerk_is_the_jerk_of_the_law(name):
    motion = published_law(name)
    run = simulate(CART, Rigid(), motion, friction(3562.0))
    jumps = any(join.order == 2 for join in motion.discontinuities())
    assert run.peak_jerk == (math.inf if jumps else pytest.approx(motion.peaks().jerk, rel=1e-8))


@pytest.mark.parametrize("dwell", [0.0, 0.5], ids=["reversal", "dwell"])
@pytest.mark.parametrize("name", KINDS)
def test_work_of_the_drive_equals_the_losses(name, dwell):
    run = simulate(CART, Rigid(), Cycle(published_law(name), dwell, dwell), friction(3562.0))
    assert run.energy == pytest.approx(2 * 0.4 * (3562 + GUIDE), rel=1e-9)
    standing = run.direction == 0
    assert standing.sum() == (2 * SAMPLES_PER_PIECE if dwell else 0)
    assert not np.any(run.drive_force[standing])
    assert run.weights.sum() == pytest.approx(6 + 2 * dwell, rel=1e-12)
    assert 0 <= run.energy <= run.drawn_energy * (1 + 1e-12)


@pytest.mark.parametrize(
    ("name", "force", "power"), [("cubic", math.sqrt(12), math.sqrt(216 / 35)), ("parabolic", 4.0, math.sqrt(64 / 3))]
)
def test_root_mean_squares_of_a_free_cart(name, force, power):
    run = simulate(UNIT, Rigid(), unit_law(name), free)
    assert run.rms_force == pytest.approx(force, rel=1e-12)
    assert run.rms_power == pytest.approx(power, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "working", "exact"),
    [
        *((name, (1 / 6, 5 / 6), 0.0) for name in (*STEADY_PART, *WITH_IMPULSE)),
        ("cubic", (1 / 6, 5 / 6), 12 / 23),
        ("parabolic", (1 / 6, 5 / 6), 1.0),
        ("harmonic", (0.5 - 1e-3, 0.5 + 1e-3), 0.0),
    ],
)
def test_nonuniformity_is_that_of_the_working_part(name, working, exact):
    run = simulate(CART, Rigid(), published_law(name), friction(3562.0), working=working)
    assert run.nonuniformity == pytest.approx(exact, rel=1e-6, abs=1e-5 if name == "harmonic" else 1e-12)


def test_dynamic_factor_is_the_peak_over_the_steady_force():
    run = simulate(CART, Rigid(), published_law("cubic"), friction(3562.0))
    assert run.steady_force == pytest.approx(3562 + GUIDE, rel=1e-14)
    assert run.dynamic_factor == pytest.approx(1 + 1000 * 6 * 0.4 / 9 / (3562 + GUIDE), rel=1e-12)


# hard cases


@pytest.mark.parametrize("size", [3562.0, 15924.0])
def test_dry_resistance_at_the_ends_is_the_limit_from_inside_the_motion(size):
    """Parabolic law: acceleration 4 s/T^2 and full resistance from t = 0+ on."""
    cart = replace(CART, guide_friction=0.0)
    run = simulate(cart, Rigid(), published_law("parabolic"), friction(size))
    inertia = 1000 * 4 * 0.4 / 9
    there, back = run.drive_force[run.direction > 0], run.drive_force[run.direction < 0]
    assert [there[0], there[-1]] == pytest.approx([inertia + size, size - inertia], rel=1e-12)
    assert [back[0], back[-1]] == pytest.approx([-inertia - size, inertia - size], rel=1e-12)
    assert run.peak_force == pytest.approx(inertia + size, rel=1e-12)


@pytest.mark.parametrize("name", WITH_IMPULSE)
def test_velocity_jump_requires_an_infinite_force(name):
    run = simulate(CART, Rigid(), published_law(name), friction(3562.0))
    names = ("peak_force", "peak_power", "rms_force", "rms_power", "peak_jerk", "dynamic_factor")
    assert [getattr(run, criterion) for criterion in names] == [math.inf] * 6
    assert len(run.impulses) == 2
    assert run.mean_power == pytest.approx(0.8 / 6 * (3562 + GUIDE), rel=1e-12)


# crank


@pytest.mark.parametrize("cart", [CART, replace(CART, mass=0.0), replace(CART, guide_friction=0.1)], ids=str)
def test_crank_drive_agrees_with_the_crankshaft(cart):
    crank, speed = Crank(0.2, 0.8), np.pi / 3.0
    run = simulate(cart, crank, published_law("crank"), friction(15924.0))
    shaft = simulate_crankshaft(cart, crank, speed, friction(15924.0))
    revolution = shaft.carts[0]
    assert run.time * speed == pytest.approx(shaft.angle, abs=1e-14)
    assert run.drive_force == pytest.approx(revolution.forces.drive_force, rel=1e-9)
    assert run.drive_power == pytest.approx(revolution.drive_power, rel=1e-9, abs=1e-9 * run.peak_power)
    assert run.mean_power == pytest.approx(shaft.mean(revolution.drive_power), rel=1e-12)
    assert run.peak_power == pytest.approx(shaft.peak_power, rel=1e-9)


# properties


@examples(8, slow=25)
@given(st.sampled_from(WITHOUT_IMPULSE), st.floats(0, 2e4), st.floats(0, 5e4), st.floats(0, 1e4))
def test_work_balances_for_any_cart_and_resistance(name, mass, size, coefficient):
    motion = published_law(name)
    resistance = lambda velocity, acceleration: size * np.sign(velocity) + coefficient * velocity  # noqa: E731
    run = simulate(replace(CART, mass=mass, guide_friction=0.0), Rigid(), motion, resistance)
    taken = 0.8 * size + 2 * coefficient * motion.criterion(1)
    rounding = 1e-12 * mass * motion.peaks().velocity ** 2
    assert run.energy == pytest.approx(taken, rel=1e-9, abs=rounding + 1e-12)


# ranking


def runs(**values):
    return [SimpleNamespace(name=name, peak_force=value, shocks=("jump",)) for name, value in values.items()]


INF, NAN = math.inf, math.nan


@pytest.mark.parametrize(
    ("values", "order", "ranks", "margins"),
    [
        ({}, "", [], []),
        ({"a": 1.0}, "a", [1], [NAN]),
        ({"c": 2.0, "b": 2 * (1 + 1e-12), "a": 1.0, "d": 3.0}, "acbd", [1, 2, 2, 4], [1.0, 0.5, 0.5, NAN]),
        ({"d": 3.0, "b": 2 * (1 + 1e-15), "c": 2.0, "e": 2 * (1 - 1e-15)}, "bced", [1, 1, 1, 4], [0.5, 0.5, 0.5, NAN]),
        ({"a": 1.0, "b": 0.0}, "ba", [1, 2], [NAN, NAN]),  # zero has no relative margin
        ({"s": INF, "g": 1.0, "j": INF, "f": 2.0}, "gfsj", [1, 2, 4, 4], [1.0, INF, NAN, NAN]),
        ({"j": NAN, "g": 1.0, "s": INF}, "gsj", [1, 3, 3], [INF, NAN, NAN]),
        ({"a": INF, "b": INF}, "ab", [2, 2], [NAN, NAN]),
    ],
)
def test_rank_counts_the_smaller_values(values, order, ranks, margins):
    found = rank(runs(**values))
    assert [place.run.name for place in found] == list(order)
    assert [place.rank for place in found] == ranks
    assert [place.margin for place in found] == pytest.approx(margins, rel=1e-9, nan_ok=True)
    reasons = ["the velocity jumps: impulsive force" if not math.isfinite(each.value) else "" for each in found]
    assert [place.reason for place in found] == reasons


JUMP = {2: "the velocity of the law jumps", 3: "velocity or acceleration of the law jumps"}
JUMP[4] = "velocity, acceleration or jerk of the law jumps"
MEAN_SQUARES = {  # J_k of the laws over unit stroke and duration, by order of their rank
    "squared_velocity": (1, dict(sorted(ENERGY_OF_LAW.items(), key=lambda item: item[1]))),
    "squared_acceleration": (2, {"cubic": 12.0, "harmonic": math.pi**4 / 8, "parabolic": 16.0, "quintic": 120 / 7,
                                 "cycloidal": 2 * math.pi**2, "septic": 280 / 11, "constant-velocity": math.inf}),
    "squared_jerk": (3, {"harmonic": math.pi**6 / 8, "cubic": 144.0, "quintic": 720.0, "cycloidal": 8 * math.pi**4,
                         "septic": 1120.0, "constant-velocity": math.inf, "parabolic": math.inf}),
    "squared_snap": (4, {"harmonic": math.pi**8 / 8, "septic": 100800.0, **dict.fromkeys(
        ("constant-velocity", "cubic", "cycloidal", "parabolic", "quintic"), math.inf)}),
}  # fmt: skip


@pytest.mark.parametrize("spring", [None, 1e6], ids=["rigid", "elastic"])
@pytest.mark.parametrize(("by", "case"), MEAN_SQUARES.items(), ids=MEAN_SQUARES)
def test_laws_rank_by_the_minimum_criteria_of_the_sources(by, case, spring):
    """A jump puts a law last, with its reason."""
    drive = Rigid() if spring is None else ElasticDrive(stiffness=spring, damping=3e3)
    order, exact = case
    found = rank([simulate(CART, drive, law(name, 0.4, 3.0), friction(3562.0)) for name in sorted(exact)], by)
    assert [place.run.name for place in found] == list(exact)
    unit = 0.4**2 / 3.0 ** (2 * order - 1)
    assert [place.value for place in found] == pytest.approx([unit * value for value in exact.values()], rel=1e-12)
    infinite = [place for place in found if place.value == math.inf]
    assert {(place.rank, place.reason) for place in infinite} <= {(len(found), JUMP.get(order))}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("criterion", CRITERIA)
def test_margins_are_not_rounding(criterion):
    """A free cart requires no energy and many laws have a steady part; the rest is rounding."""
    every = [simulate(replace(UNIT, mass=1000.0), Rigid(), published_law(name), free) for name in LAWS]
    found = rank(every, criterion)
    assert not any(1e3 < place.margin < math.inf for place in found)
    assert {place.rank for place in found if place.value == 0} <= {1}
    if criterion in ("energy", "mean_power"):
        assert [place.value for place in found] == [0.0] * len(LAWS)
    if criterion == "nonuniformity":
        assert sum(place.rank == 1 for place in found) == len({*STEADY_PART, *WITH_IMPULSE})


@given(st.data(), st.lists(st.sampled_from([0.0, 1.0, 1.0 + 1e-13, 2.0, 5.0, math.inf]), max_size=8))
def test_ranking_does_not_depend_on_the_order_of_the_runs(data, values):
    listed = [SimpleNamespace(name=i, peak_force=value, shocks=("jump",)) for i, value in enumerate(values)]
    shuffled = data.draw(st.permutations(listed))
    one_way, other_way = ({p.run.name: (p.rank, p.value, p.reason) for p in rank(o)} for o in (listed, shuffled))
    assert one_way == other_way
    margins = ({p.run.name: str(p.margin) for p in rank(o)} for o in (listed, shuffled))
    assert next(margins) == next(margins)


# errors


@pytest.mark.parametrize("name", WITHOUT_IMPULSE)
def test_free_cart_draws_its_kinetic_energy_once_per_stroke(name):
    motion = published_law(name)
    run = simulate(replace(UNIT, mass=1000.0), Rigid(), motion, free)
    assert run.drawn_energy == pytest.approx(2 * 500 * motion.peaks().velocity ** 2, rel=1e-3)


def viscous(coefficient):
    return lambda velocity, acceleration: coefficient * velocity


@pytest.mark.parametrize("name", sorted({*ENERGY_OF_LAW, *KINDS}))
def test_viscous_loss_equals_the_integral_of_the_squared_speed(name):
    run = simulate(UNIT, Rigid(), published_law(name), viscous(2e3))
    closed = ENERGY_OF_LAW.get(name, published_law(name).criterion(1) * 3.0 / 0.4**2)
    assert run.energy == pytest.approx(2 * 2e3 * closed * 0.4**2 / 3.0, rel=1e-9)


def test_rod_of_the_crank_is_a_triangle():
    crank, psi = Crank(0.2, 0.8), np.linspace(0, 2 * np.pi, 50)
    assert 0.8 * np.sin(crank.rod_angle(psi)) == pytest.approx(0.2 * np.sin(psi), abs=1e-16)
    assert crank.rod_tangent(0.75, 3.0) == pytest.approx(0.25 / math.sqrt(1 - 0.25**2), rel=1e-14)
