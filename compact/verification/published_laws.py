"""Computed values for the published numbers of the motion laws and their cams (sources A, B, D).

A row LAW_QUANTITY of `data/published.csv` is a quantity of `BY_LAW`; the others are computed once each.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from itertools import product
from types import MappingProxyType

import numpy as np
from numpy.polynomial import Polynomial

from compact.cams.profile import Cam, FlatFace, Pointed, least_breadth
from compact.machine.roller_motors import roller_rotation
from compact.motion.laws import LAWS, minimiser, piecewise
from compact.motion.profile import Cycle, MotionProfile, law
from compact.numerics.piecewise import integrate

STROKE, DURATION = 0.4, 3.0  # [m], [s], of D ch. 5
A, B = "reversal-4", "reversal-4-free-both"  # laws of the papers A and B
PRINTED_B_SPEED, PRINTED_B_SLOPE = 6 / 5, 87 / 80  # [-], of B (28) and (30), over stroke/duration
COARSE_SPEED = 1 / 0.86  # [-], of D 2.7 with 2/3 truncated to 0.66, over stroke/duration
FREE_BREADTH = ("cubic", "quintic", "septic", "complex", "reversal-2")  # their flat-faced cam needs the stroke only


@cache
def _unit(name: str, stroke: float = 1.0, duration: float = 1.0) -> MotionProfile:
    return law(name, stroke, duration)


def _printed(name: str) -> MotionProfile:
    return _unit(name, STROKE, DURATION)


def _wrong_closure(name: str) -> float:
    """Return the scale of the peaks at a steady speed at which the law misses the stroke."""
    return (COARSE_SPEED if name == "combined-3" else PRINTED_B_SPEED) / _unit(name).peaks().velocity


def _jerk_jump(name: str) -> float:
    """Return the jump of the jerk at the reversal without a dwell; 0 where the jerk is continuous."""
    steps = _unit(name).discontinuities()
    return abs(sum(step.after - step.before for step in steps if step.time == 0 and step.order == 3))


BY_LAW: Mapping[str, Callable[[str], float]] = MappingProxyType(
    {
        "acceleration": lambda name: _printed(name).peaks().acceleration,  # [m/s2], of D ch. 5
        "jerk": lambda name: _printed(name).peaks().jerk,  # [m/s3]
        "acceleration_scaled": lambda name: _wrong_closure(name) * _printed(name).peaks().acceleration,
        "jerk_scaled": lambda name: _wrong_closure(name) * _printed(name).peaks().jerk,
        "energy": lambda name: _unit(name).criterion(1),
        "peak_energy": lambda name: _unit(name).peaks().velocity ** 2,
        "jerk_jump": _jerk_jump,
        "criterion": lambda name: _unit(name).criterion(int(name[-1])),  # J_n of a law of order n
        "breadth": lambda name: least_breadth(Cycle(_unit(name)), FlatFace()).breadth,
    }
)


def numbers_by_law(names: Iterable[str]) -> dict[str, float]:
    """Compute the rows LAW_QUANTITY."""
    parts = {name: name.partition("_") for name in names}
    return {
        name: BY_LAW[quantity](motion)
        for name, (motion, _, quantity) in parts.items()
        if motion in LAWS and quantity in BY_LAW
    }


def peak_numbers() -> dict[str, float]:
    """Read peak acceleration [m/s2] and jerk [m/s3] from coarse tables: every 10 degrees, or a part of the run-up."""
    combined, reversal, run_up = _printed("combined-4"), _printed(A), DURATION / 6
    jumps = [join for join in _printed("reversal-2").discontinuities("dwell") if join.order == 2]
    return {
        "reversal-2_jerk_at_joins": math.inf if jumps else 0.0,
        "complex_acceleration_table": np.abs(_printed("complex").acceleration(DURATION * np.arange(19) / 18)).max(),
        "combined-4_acceleration_table": combined.acceleration(run_up / 3),
        "combined-4_jerk_table": combined.jerk(run_up / 6),
        "reversal-4_jerk_table": abs(reversal.jerk(run_up / 5)),
    }


def claim_numbers() -> dict[str, float]:
    """Compute closures, steady speeds, jumps and optima of A, B and D for unit stroke and duration [-].

    At fixed stroke the criterion of A is proportional to j/(z + 2)^2 with the travel x1 = z v t1 of the acceleration
    and j = a z^2 + b z + c; its derivative is linear in z.
    """
    a, b, early = _unit(A), _unit(B), 0.1
    roller = roller_rotation(Cycle(b), roller_radius=1.0, time=[0.5, 5 / 6])
    constant, half, whole = (_run_up_criterion(travel) for travel in (0.0, 0.5, 1.0))
    square = 2 * (constant + whole - 2 * half)
    linear = whole - square - constant
    best = 2 * (constant - linear) / (4 * square - linear)
    loss = half / (0.5 + 2) ** 2 / (_run_up_criterion(best) / (best + 2) ** 2) - 1
    lone = minimiser(4, {0: 0, 1: 0, 2: 0}, {1: 1, 2: 0, 3: 0})  # optimal single phase of D 4.3
    return {
        "a_speed": a.velocity(0.5),
        "a_run_up": 6 * a.position(1 / 6) / a.velocity(0.5),
        "a_best_run_up": best,
        "a_loss": 100 * loss,
        "b_speed": b.velocity(0.5),
        "b_run_up": 6 * b.position(1 / 6) / b.velocity(0.5),
        "b_run_up_travel": b.position(1 / 6),
        "b_run_up_factor": b.position(early) / (early**2 * (432 * early**4 - 60 * early**2 + 5)),
        "b_slope": b.velocity(0.5),
        "b_closure": PRINTED_B_SPEED * (_run_up_of_b()(1.0) / 3 + 2 / 3),
        "b_velocity_step": _velocity_step(printed_law_of_b()),
        "b_roller_speed": roller.angular_velocity[0],
        "b_roller_brakes": roller.angular_velocity[1],
        "d469_slope": b.velocity(0.5) / 3,
        "d41_closure": PRINTED_B_SPEED / _unit("reversal-3-free-acceleration").peaks().velocity,
        "lone_jerk": lone.deriv(3)(0.0),
        "lone_travel": lone(1.0),
    }


def printed_law_of_b() -> MotionProfile:
    """Build the law of B (28)-(30) as printed, for D ch. 5: correct shapes at the wrong steady speed."""
    run = PRINTED_B_SPEED / 6 * _run_up_of_b()(Polynomial([0, 6]))
    steady = Polynomial([run(1 / 6), PRINTED_B_SLOPE])
    curve = piecewise([1 / 6, 2 / 3, 1 / 6], [run, steady, 1 - run(Polynomial([1 / 6, -1]))])
    return MotionProfile("B as printed", STROKE, DURATION, curve)


def _run_up_of_b() -> Polynomial:
    return minimiser(4, {0: 0, 1: 0, 3: 0}, {1: 1, 2: 0, 3: 0})


def _velocity_step(motion: MotionProfile | Cycle) -> float:
    return max(abs(join.after - join.before) for join in motion.discontinuities() if join.order == 1)


def _run_up_criterion(travel: float) -> float:
    """Compute J_4 of an acceleration phase of A over a travel, in unit time to unit speed."""
    run = minimiser(4, {0: 0, 1: 0, 2: 0, 3: 0}, {0: travel, 1: 1, 2: 0, 3: 0})
    return integrate(run.deriv(4) ** 2, [0.0, 1.0])


def cam_numbers() -> dict[str, float]:
    """Compute breadths, radii and kinks of the cams of A, B and D, over the stroke [-].

    Radii less half the breadth are compared with A (42) and D (4.113) on the return stroke phi = 7 pi/6 + u pi/3.
    """
    cam_a, cam_b = (Cam(Cycle(_unit(name)), breadth=2.0, follower=Pointed()) for name in (A, B))
    u = np.linspace(0, 2, 41)
    right = cam_a.radius(7 * np.pi / 6 + u * np.pi / 3) - 1.0
    readings = [np.abs(0.4 * (a + b * u) + c / 2 - right).max() for a, b, c in product((1, -1), repeat=3)]
    cycle = printed_law_of_b().cycle()
    printed = Cam(cycle, breadth=2 * STROKE, follower=Pointed())
    return {
        "a_breadth": _breadth(cam_a),
        "a42_start": right[0],
        "a42_miss": np.abs(-0.4 * (1 - u) + 0.5 - right).max(),
        "d4113_miss": min(readings),
        "b_breadth": _breadth(cam_b),
        "b41_start": float(cam_b.radius(np.pi)) - 1.0,
        "b_printed_breadth": _breadth(printed),
        "b_kinks": len(printed.corner_angles),
        "b_kink": _velocity_step(cycle) * DURATION / np.pi / STROKE,
        "free_breadth": max(BY_LAW["breadth"](name) for name in FREE_BREADTH),
    }


def _breadth(cam: Cam) -> float:
    """Compute the largest rho(phi) + rho(phi + pi) over b."""
    angle = np.linspace(0, np.pi, 361)
    return (cam.radius(angle) + cam.radius(angle + np.pi)).max() / cam.breadth
