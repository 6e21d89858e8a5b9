"""Optimal laws: known extremals, duality gaps, limits at every instant, what conflicts, mixes of many samples."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compact.cam import Cam, FlatFace, Pointed
from compact.laws import ComplexLaw
from compact.lawspace import Space, bernstein_basis, graded_breaks, halved
from compact.limits import broken
from compact.motion import CamLimits, InfeasibleError, Limits, optimise
from compact.quadratic import Program, least_linear, least_quadratic

TWO_THIRDS = Limits(run_up=1 / 6, run_down=1 / 6)
MACHINE = {"stroke": 0.4, "duration": 3.0, "mass": 1000.0}


def none(velocity, acceleration):
    return 0.0 * velocity


def dry(force):
    return lambda velocity, acceleration: force * np.sign(velocity)


def viscous(velocity, acceleration):
    return velocity


def unit(objective, resistance=none, limits=None, **options):
    return optimise(objective, 1.0, 1.0, 1.0, resistance, limits, **options)


# ---- (a) closed form -------------------------------------------------------------------------------------------------


def trapezoid_speed(acceleration):
    """Plateau of the law of least top speed: v T - v^2/a = stroke, in units of stroke and duration."""
    return acceleration / 2 * (1 - np.sqrt(1 - 4 / acceleration))


def trapezoid_work(acceleration):
    """2 int v^2 dt of that law."""
    speed = trapezoid_speed(acceleration)
    return 2 * speed**2 * (1 - 4 / 3 * speed / acceleration)


def ramped_acceleration(jerk):
    """Least A of bang and bang with one ramp between them: A/4 - A^3/(3 jerk^2) = stroke, in units as above."""
    roots = np.roots([-1 / (3 * jerk**2), 0, 1 / 4, -1])
    return min(root.real for root in roots if abs(root.imag) < 1e-12 and root.real > 0)


@pytest.mark.parametrize(
    ("objective", "resistance", "limits", "exact", "within"),
    [
        pytest.param("peak_force", none, None, 4.0, 1e-9, id="bang-bang"),
        pytest.param("rms_force", none, None, np.sqrt(12), 1e-9, id="cubic"),
        # kinetic energy grows by P: v^2 = 2 P t/m to the middle, so P = 9/4 m stroke^2/duration^3
        pytest.param("peak_power", none, None, 9 / 4, 1e-3, id="even-power"),
        pytest.param("drawn_energy", none, Limits(acceleration=6.0), trapezoid_speed(6.0) ** 2, 1e-3, id="trapezoid"),
        pytest.param("energy", viscous, Limits(acceleration=6.0), trapezoid_work(6.0), 1e-4, id="even-speed"),
        pytest.param("peak_force", none, Limits(jerk=40.0), ramped_acceleration(40.0), 5e-4, id="one-ramp"),
        pytest.param(
            "peak_force", dry(3.0), TWO_THIRDS.replaced(acceleration=7.2, velocity=1.2), 10.2, 1e-8, id="reversal-2"
        ),
    ],
)
def test_extremal_is_known(objective, resistance, limits, exact, within):
    motion = unit(objective, resistance, limits)
    assert motion.value == pytest.approx(exact, rel=within)
    assert motion.gap < 1e-6
    assert broken(motion.limits, motion) == {}


def test_weighted_sum_is_the_complex_law_of_its_weights():
    """Stationary for a weighted sum of int v^2 and int H^2: the complex law without a weight of jerk, of some ratio."""
    motion = unit({"energy": 1.0, "rms_force": 0.7}, lambda v, a: 3.0 * v)
    z = np.linspace(0, 1, 2001)

    def criterion(curve):
        v, force = curve(z, nu=1), curve(z, nu=2) + 3.0 * curve(z, nu=1)
        return 2 * np.trapezoid(3.0 * v * v, z) + 0.7 * np.sqrt(np.trapezoid(force**2, z))

    least = min(criterion(ComplexLaw(d1, 1 - d1)) for d1 in np.linspace(0.02, 0.98, 193))
    assert motion.value == pytest.approx(least, rel=1e-4)
    assert motion.gap < 1e-6


def test_steady_speed_may_be_uneven_by_its_tolerance():
    even, uneven = (
        optimise("peak_force", **MACHINE, resistance=dry(3562.0), limits=TWO_THIRDS.replaced(steady_tolerance=share))
        for share in (0.0, 0.02)
    )
    assert uneven.value < even.value
    time = np.linspace(0.5, 2.5, 1001)
    assert np.ptp(even.velocity(time)) < 1e-12
    mean = np.diff(uneven.position([0.5, 2.5]))[0] / 2.0
    assert np.abs(uneven.velocity(time) / mean - 1).max() == pytest.approx(0.02, rel=1e-6)


# ---- splines and programs -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("smoothness", [1, 2, 3])
def test_each_derivative_is_that_of_the_one_before(smoothness):
    space = Space(graded_breaks(0.0, 1.0, 8, smoothness), smoothness)
    unknowns = np.random.default_rng(smoothness).normal(size=space.size)
    curve, u = space.curve(unknowns), np.array([0.2, 0.7])
    places = (space.breaks[:-1, None] + np.diff(space.breaks)[:, None] * u).ravel()
    for order in range(5):
        size = np.abs(curve(places, nu=order)).max() + 1e-300
        assert space.values(order, u) @ unknowns == pytest.approx(curve(places, nu=order), abs=1e-12 * size)
    inner = space.breaks[1:-1]
    for order in range(smoothness + 1):
        size = np.abs(curve(inner, nu=order)).max()
        assert curve(np.nextafter(inner, 0), nu=order) == pytest.approx(curve(inner, nu=order), abs=1e-11 * size)
    assert np.abs(curve(np.nextafter(inner, 0), nu=smoothness + 1) - curve(inner, nu=smoothness + 1)).max() > 0.1


@pytest.mark.parametrize("smoothness", [1, 2, 3])
def test_halved_pieces_hold_the_same_law(smoothness):
    coarse, fine = (Space(graded_breaks(0.0, 1.0, count, smoothness), smoothness) for count in (8, 16))
    unknowns = np.random.default_rng(smoothness).normal(size=coarse.size)
    z, curve = np.linspace(0, 1, 101), coarse.curve(unknowns)
    taken = fine.curve(fine.taken_over(curve))
    assert taken(z) == pytest.approx(curve(z), abs=1e-12 * np.abs(curve(z)).max())


@given(st.lists(st.floats(-1, 1), min_size=2, max_size=6))
def test_polynomial_lies_inside_its_coefficients_and_they_close_on_it(coefficients):
    rows = np.array(coefficients)[None, :, None]
    value = bernstein_basis(len(coefficients) - 1, np.linspace(0, 1, 201)) @ coefficients
    room = []
    for times in (0, 1, 2):
        hull = halved(rows, times)
        assert hull.max() >= value.max() - 1e-12
        assert hull.min() <= value.min() + 1e-12
        room.append(np.ptp(hull))
    assert room[0] >= room[1] - 1e-12 >= room[2] - 2e-12


def test_quadratic_program_meets_its_closed_form():
    """Nearest point of a simplex: x = max(y - t, 0) with the sum 1 (Held, Wolfe and Crowder 1974)."""
    y = np.random.default_rng(5).normal(size=40)
    program = Program(np.ones((1, 40)), np.ones(1), -np.eye(40), np.zeros(40))
    x = least_quadratic(np.eye(40), -y, program)
    ordered = np.sort(y)[::-1]
    shifts = (np.cumsum(ordered) - 1) / np.arange(1, 41)
    assert x == pytest.approx(np.maximum(y - shifts[ordered > shifts][-1], 0), abs=1e-9)


def test_quadratic_program_without_curvature_is_the_linear_one():
    rng = np.random.default_rng(7)
    program = Program(np.ones((1, 12)), np.ones(1), np.vstack([-np.eye(12), rng.normal(size=(9, 12))]), np.ones(21))
    cost, box = rng.normal(size=12), np.full(12, 5.0)
    quadratic, linear = (
        cost @ x for x in (least_quadratic(np.zeros((12, 12)), cost, program, box), least_linear(cost, program, box))
    )
    assert quadratic == pytest.approx(linear, abs=1e-8)


# ---- (d) hard cases --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "limits",
    [
        pytest.param(TWO_THIRDS.replaced(acceleration=0.5), id="acceleration"),
        pytest.param(TWO_THIRDS.replaced(velocity=0.16, jerk=8.0), id="velocity-jerk"),
        pytest.param(TWO_THIRDS.replaced(snap=400.0), id="snap"),
        pytest.param(TWO_THIRDS.replaced(smoothness=3, at_rest=(2, 3), jerk=8.0), id="rest"),
        pytest.param(TWO_THIRDS.replaced(turn="dwell", jerk=8.0), id="dwell"),
        pytest.param(Limits(run_up=0.1, run_down=0.25, jerk=8.0, steady_tolerance=0.01), id="askew-tolerance"),
        pytest.param(TWO_THIRDS.replaced(cam=CamLimits(0.6, pressure_angle=0.85)), id="pressure-angle"),
        pytest.param(TWO_THIRDS.replaced(cam=CamLimits(0.9, radius_of_curvature=0.1)), id="flat-face"),
    ],
)
@pytest.mark.parametrize("objective", ["peak_force", "peak_power"])
def test_limits_hold_at_every_instant(objective, limits):
    motion = optimise(objective, **MACHINE, resistance=dry(3562.0), limits=limits, pieces=16)
    assert broken(limits, motion, instants=100_001) == {}
    assert motion.gap < 1e-6


@pytest.mark.parametrize(
    ("limits", "follower", "quantity", "sign"),
    [
        (CamLimits(0.6, pressure_angle=0.85), Pointed(), "largest_pressure_angle", 1),
        (CamLimits(0.9, radius_of_curvature=0.1), FlatFace(), "least_radius_of_curvature", -1),
    ],
)
def test_cam_of_the_law_keeps_its_limits(limits, follower, quantity, sign):
    asked = limits.pressure_angle or limits.radius_of_curvature
    free, held = (
        optimise("peak_power", **MACHINE, resistance=dry(3562.0), limits=TWO_THIRDS.replaced(cam=cam), pieces=16)
        for cam in (None, limits)
    )
    assert sign * getattr(Cam(free.cycle(), limits.breadth, follower), quantity) > sign * asked
    assert sign * getattr(Cam(held.cycle(), limits.breadth, follower), quantity) <= sign * asked + 1e-9


@pytest.mark.parametrize(
    ("limits", "needed"),
    [
        (Limits(acceleration=0.1), {"acceleration": 4 * 0.4 / 9}),
        # a trapezoid of speed: v T - v^2/a = stroke
        (Limits(velocity=0.15, acceleration=0.2), {"velocity": 0.2, "acceleration": 0.15**2 / (0.15 * 3 - 0.4)}),
        # the mean radius of curvature of a flat-faced cam is half its breadth: at best an eccentric circle
        (Limits(cam=CamLimits(0.41, radius_of_curvature=0.3)), {"cam breadth for its radius of curvature": 0.6}),
    ],
)
def test_what_conflicts_is_told_with_how_much(limits, needed):
    with pytest.raises(InfeasibleError, match="no law keeps all limits; what would do") as told:
        optimise("peak_force", **MACHINE, resistance=none, limits=limits)
    assert told.value.alone
    conflicts = {conflict.name: conflict.needed for conflict in told.value.conflicts}
    assert conflicts == pytest.approx(needed, rel=3e-3)


def test_bounds_that_must_give_together_do_when_they_have_given():
    limits = Limits(velocity=0.1, acceleration=0.1, smoothness=2, jerk=0.1)
    with pytest.raises(InfeasibleError, match=r"velocity .* together with acceleration") as told:
        optimise("peak_force", **MACHINE, resistance=none, limits=limits, pieces=16)
    enough = {conflict.name: conflict.needed * (1 + 1e-6) for conflict in told.value.conflicts}
    assert not told.value.alone
    assert optimise("peak_force", **MACHINE, resistance=none, limits=limits.replaced(**enough), pieces=16).gap < 1e-6
    for name in enough:  # and none of them is told in vain
        with pytest.raises(InfeasibleError):
            optimise(
                "peak_force", **MACHINE, resistance=none, limits=limits.replaced(**(enough | {name: 0.1})), pieces=16
            )
