"""The published motion laws and their cams (sources A, B, D), for the formulas of `data/published.csv`."""

from functools import cache
from itertools import product

import numpy as np
from numpy.polynomial import Polynomial

from compact.cams.profile import Cam, FlatFace, Pointed, least_breadth
from compact.machine.roller_motors import roller_rotation
from compact.motion.laws import minimiser, piecewise
from compact.motion.profile import Cycle, MotionProfile, law
from compact.numerics import Array
from compact.numerics.piecewise import integrate

STROKE, DURATION = 0.4, 3.0  # [m], [s], of D ch. 5
RUN_UP = DURATION / 6  # [s]
A, B = "reversal-4", "reversal-4-free-both"  # laws of the papers A and B
PRINTED_B_SPEED, PRINTED_B_SLOPE = 6 / 5, 87 / 80  # [-], of B (28) and (30), over stroke/duration
COARSE_SPEED = 1 / 0.86  # [-], of D 2.7 with 2/3 truncated to 0.66, over stroke/duration
EARLY = 0.1  # [-], phase within the run-up
FREE_BREADTH = ("cubic", "quintic", "septic", "complex", "reversal-2")  # their flat-faced cam needs the stroke only


@cache
def unit(name: str) -> MotionProfile:
    """Return a law of unit stroke and duration."""
    return law(name, 1.0, 1.0)


@cache
def printed(name: str) -> MotionProfile:
    """Return a law of the stroke and the duration of D ch. 5."""
    return law(name, STROKE, DURATION)


def wrong_closure(name: str) -> float:
    """Return the scale of the peaks at a steady speed at which the law misses the stroke [-]."""
    return (COARSE_SPEED if name == "combined-3" else PRINTED_B_SPEED) / unit(name).peaks().velocity


def jerk_jump(name: str) -> float:
    """Return the jump of the jerk at the reversal without a dwell [-]; 0 where the jerk is continuous."""
    steps = unit(name).discontinuities()
    return abs(sum(step.after - step.before for step in steps if step.time == 0 and step.order == 3))


def jerk_at_joins(name: str) -> float:
    """Return infinity for a law whose acceleration jumps between dwells, else 0."""
    return np.inf if any(join.order == 2 for join in printed(name).discontinuities("dwell")) else 0.0


def run_up_travel(name: str) -> float:
    """Return the travel of the run-up over that at the steady speed in the same time [-]."""
    return float(6 * unit(name).position(1 / 6) / unit(name).velocity(0.5))


def run_up_criterion(travel: float) -> float:
    """Compute J_4 of an acceleration phase of A over a travel, in unit time to unit speed."""
    run = minimiser(4, {0: 0, 1: 0, 2: 0, 3: 0}, {0: travel, 1: 1, 2: 0, 3: 0})
    return integrate(run.deriv(4) ** 2, [0.0, 1.0])


def best_run_up() -> float:
    """Compute the travel z of the acceleration of A, over that at the steady speed, with the least criterion [-].

    At fixed stroke the criterion is proportional to j/(z + 2)^2 with j = a z^2 + b z + c; its derivative is linear.
    """
    constant, half, whole = (run_up_criterion(travel) for travel in (0.0, 0.5, 1.0))
    square = 2 * (constant + whole - 2 * half)
    linear = whole - square - constant
    return 2 * (constant - linear) / (4 * square - linear)


def at_fixed_stroke(travel: float) -> float:
    """Compute the criterion of A at fixed stroke, up to a factor."""
    return run_up_criterion(travel) / (travel + 2) ** 2


def run_up_of_b() -> Polynomial:
    """Return the run-up of B in unit time to unit speed."""
    return minimiser(4, {0: 0, 1: 0, 3: 0}, {1: 1, 2: 0, 3: 0})


def lone_phase() -> Polynomial:
    """Return the optimal single phase of D 4.3."""
    return minimiser(4, {0: 0, 1: 0, 2: 0}, {1: 1, 2: 0, 3: 0})


def roller_speed(phase: float) -> float:
    """Return the angular speed of a roller of unit radius by B without slip [-]."""
    return roller_rotation(Cycle(unit(B)), roller_radius=1.0, time=[phase])[1][0]


@cache
def printed_law_of_b() -> MotionProfile:
    """Build the law of B (28)-(30) as printed, for D ch. 5: correct shapes at the wrong steady speed."""
    run = PRINTED_B_SPEED / 6 * run_up_of_b()(Polynomial([0, 6]))
    steady = Polynomial([run(1 / 6), PRINTED_B_SLOPE])
    curve = piecewise([1 / 6, 2 / 3, 1 / 6], [run, steady, 1 - run(Polynomial([1 / 6, -1]))])
    return MotionProfile("B as printed", STROKE, DURATION, curve)


def velocity_step(motion: MotionProfile | Cycle) -> float:
    """Return the largest jump of the velocity [m/s]."""
    return max(abs(join.after - join.before) for join in motion.discontinuities() if join.order == 1)


@cache
def cam(name: str) -> Cam:
    """Return the cam of a pointed follower, of twice the stroke in breadth; of B as printed without a name."""
    cycle = Cycle(unit(name)) if name else printed_law_of_b().cycle()
    return Cam(cycle, breadth=2.0 if name else 2 * STROKE, follower=Pointed())


def breadth(made: Cam) -> float:
    """Compute the largest rho(phi) + rho(phi + pi) over b [-]."""
    angle = np.linspace(0, np.pi, 361)
    return (made.radius(angle) + made.radius(angle + np.pi)).max() / made.breadth


def flat_breadth(name: str) -> float:
    """Compute the least breadth of a flat-faced cam over the stroke [-]."""
    return least_breadth(Cycle(unit(name)), FlatFace()).breadth


def return_radius(u: Array | float) -> Array:
    """Compute the radius of the cam of A less half its breadth on the return stroke, phi = 7 pi/6 + u pi/3 [-]."""
    return cam(A).radius(7 * np.pi / 6 + np.asarray(u) * np.pi / 3) - 1.0


def miss_of_return(*signs: tuple[float, float, float]) -> float:
    """Compute how far the nearest reading of the printed radius, 0.4 (a + b u) + c/2, is from that of the cam of A [-].

    Parameters
    ----------
    *signs : tuple of float
        Readings (a, b, c), as of A (42); by default every choice of signs, as of D (4.113).
    """
    u = np.linspace(0, 2, 41)
    readings = signs or product((1, -1), repeat=3)
    return min(np.abs(0.4 * (a + b * u) + c / 2 - return_radius(u)).max() for a, b, c in readings)
