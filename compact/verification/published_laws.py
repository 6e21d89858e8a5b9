"""Computed values for the published numbers of the motion laws and their cams (sources A, B, D).

Each public function returns values by the name of their row in `data/published.csv`; `published_numbers` compares them
with the print.
"""

import math
from itertools import product

import numpy as np
from numpy.polynomial import Polynomial

from compact.cams.profile import Cam, FlatFace, Pointed, least_breadth
from compact.machine.roller_motors import roller_rotation
from compact.motion.laws import piecewise
from compact.motion.minimum_criterion import minimiser
from compact.motion.profile import Cycle, MotionProfile, law
from compact.numerics.piecewise import integrate

STROKE, DURATION = 0.4, 3.0  # [m], [s], of D ch. 5
PRINTED_LAWS = (
    *("septic", "complex", "combined-2", "combined-3", "combined-4", "reversal-2", "reversal-3", "reversal-4"),
    *("reversal-3-free-acceleration", "reversal-4-free-acceleration", "reversal-4-free-jerk", "reversal-4-free-both"),
)
A, B = "reversal-4", "reversal-4-free-both"  # laws of the papers A and B
PRINTED_B_SPEED, PRINTED_B_SLOPE = 6 / 5, 87 / 80  # [-], of B (28) and (30), over stroke/duration
COARSE_SPEED = 1 / 0.86  # [-], of D 2.7 with 2/3 truncated to 0.66, over stroke/duration
LIMITED_BREADTH = (  # laws whose flat-faced cam requires a breadth above the stroke
    *("combined-2", "combined-3", "combined-4", "reversal-3", "reversal-4"),
    *("reversal-3-free-acceleration", "reversal-4-free-acceleration", "constant-velocity"),
)
FREE_BREADTH = ("cubic", "quintic", "septic", "complex", "reversal-2")


def peak_numbers() -> dict[str, float]:
    """Compute peak acceleration [m/s2] and jerk [m/s3] of the laws of D ch. 5, with the readings behind the print."""
    found: dict[str, float] = {}
    for name in PRINTED_LAWS:
        largest = law(name, STROKE, DURATION).peaks()
        found |= {f"{name}_acceleration": largest.acceleration, f"{name}_jerk": largest.jerk}
    jumps = [join for join in law("reversal-2", STROKE, DURATION).discontinuities("dwell") if join.order == 2]
    return found | {"reversal-2_jerk_at_joins": math.inf if jumps else 0.0} | _coarse_readings() | _wrong_closures()


def _coarse_readings() -> dict[str, float]:
    """Read the peaks from coarse tables: every 10 degrees, or at a fraction of the acceleration phase."""
    complex_law, combined, reversal = (law(name, STROKE, DURATION) for name in ("complex", "combined-4", A))
    run_up = DURATION / 6
    return {
        "complex_acceleration_table": np.abs(complex_law.acceleration(DURATION * np.arange(19) / 18)).max(),
        "combined-4_acceleration_table": combined.acceleration(run_up / 3),
        "combined-4_jerk_table": combined.jerk(run_up / 6),
        "reversal-4_jerk_table": abs(reversal.jerk(run_up / 5)),
    }


def _wrong_closures() -> dict[str, float]:
    """Scale the peaks to a steady speed at which the law misses the stroke."""
    found = {}
    for name in ("combined-3", "reversal-3-free-acceleration", "reversal-4-free-acceleration"):
        speed = COARSE_SPEED if name == "combined-3" else PRINTED_B_SPEED
        scale, largest = speed / _unit(name).peaks().velocity, law(name, STROKE, DURATION).peaks()
        found[f"{name}_acceleration_scaled"] = scale * largest.acceleration
        found[f"{name}_jerk_scaled"] = scale * largest.jerk
    return found


def _unit(name: str) -> MotionProfile:
    return law(name, stroke=1.0, duration=1.0)


def claim_numbers() -> dict[str, float]:
    """Compute closures, energies, jumps, criteria and optima of A, B and D for unit stroke and duration.

    Returns
    -------
    dict of str to float
        Values by row name [-].
    """
    return _steady_speeds() | _defects_of_printed_b() | _energies() | _jumps_at_the_turn() | _criteria() | _optima()


def _steady_speeds() -> dict[str, float]:
    """Compute steady speeds, travels of the acceleration phase and the speed of the roller."""
    a, b, early = _unit(A), _unit(B), 0.1
    roller = roller_rotation(Cycle(b), roller_radius=1.0, time=[0.5, 5 / 6])
    return {
        "a_speed": a.velocity(0.5),
        "a_run_up": 6 * a.position(1 / 6) / a.velocity(0.5),
        "b_speed": b.velocity(0.5),
        "b_run_up": 6 * b.position(1 / 6) / b.velocity(0.5),
        "b_run_up_travel": b.position(1 / 6),
        "b_run_up_factor": b.position(early) / (early**2 * (432 * early**4 - 60 * early**2 + 5)),
        "b_slope": b.velocity(0.5),
        "d469_slope": b.velocity(0.5) / 3,
        "b_roller_speed": roller.angular_velocity[0],
        "b_roller_brakes": roller.angular_velocity[1],
        "d41_closure": PRINTED_B_SPEED / _unit("reversal-3-free-acceleration").peaks().velocity,
    }


def printed_law_of_b() -> MotionProfile:
    """Build the law of B (28)-(30) as printed: correct shapes at the wrong steady speed, continuous in position.

    Returns
    -------
    MotionProfile
        Law with the stroke and duration of D ch. 5 [m], [s].
    """
    run = PRINTED_B_SPEED / 6 * _run_up_of_b()(Polynomial([0, 6]))
    steady = Polynomial([run(1 / 6), PRINTED_B_SLOPE])
    curve = piecewise([1 / 6, 2 / 3, 1 / 6], [run, steady, 1 - run(Polynomial([1 / 6, -1]))])
    return MotionProfile("B as printed", STROKE, DURATION, curve)


def _run_up_of_b() -> Polynomial:
    return minimiser(4, {0: 0, 1: 0, 3: 0}, {1: 1, 2: 0, 3: 0})


def _defects_of_printed_b() -> dict[str, float]:
    closure = PRINTED_B_SPEED * (_run_up_of_b()(1.0) / 3 + 2 / 3)
    return {"b_closure": closure, "b_velocity_step": _velocity_step(printed_law_of_b())}


def _velocity_step(motion: MotionProfile | Cycle) -> float:
    return max(abs(join.after - join.before) for join in motion.discontinuities() if join.order == 1)


def _energies() -> dict[str, float]:
    laws = {name: _unit(name) for name in ("cubic", "quintic")}
    energies = {f"{name}_energy": each.criterion(1) for name, each in laws.items()}
    return energies | {f"{name}_peak_energy": each.peaks().velocity ** 2 for name, each in laws.items()}


def _jumps_at_the_turn() -> dict[str, float]:
    """Compute the jump of the jerk at the reversal without a dwell; 0 where the jerk is continuous."""
    found = {}
    for name in ("cubic", "quintic", "combined-3", "reversal-2", "reversal-3-free-acceleration", B):
        steps = _unit(name).discontinuities()
        jumps = [step.after - step.before for step in steps if step.time == 0 and step.order == 3]
        found[f"{name}_jerk_jump"] = abs(sum(jumps))
    return found


def _criteria() -> dict[str, float]:
    """Compute J_n of the laws of order n with a = 0 imposed (combined) and with the natural condition (reversal)."""
    pairs = product((2, 3, 4), ("combined", "reversal"))
    return {f"{kind}-{order}_criterion": _unit(f"{kind}-{order}").criterion(order) for order, kind in pairs}


def _optima() -> dict[str, float]:
    """Compute the optimal acceleration travel of A at fixed stroke, and the optimal single phase of D 4.3.

    At fixed stroke J is proportional to j/(z + 2)^2 with x1 = z v t1 and j = a z^2 + b z + c; J' = 0 is linear in z.
    """
    c, half, whole = (_run_up_criterion(travel) for travel in (0.0, 0.5, 1.0))
    a = 2 * (c + whole - 2 * half)
    b = whole - a - c
    best = 2 * (c - b) / (4 * a - b)
    loss = half / (0.5 + 2) ** 2 / (_run_up_criterion(best) / (best + 2) ** 2) - 1
    lone = minimiser(4, {0: 0, 1: 0, 2: 0}, {1: 1, 2: 0, 3: 0})
    return {"a_best_run_up": best, "a_loss": 100 * loss, "lone_jerk": lone.deriv(3)(0.0), "lone_travel": lone(1.0)}


def _run_up_criterion(travel: float) -> float:
    """Compute J_4 of an acceleration phase of A over a travel, in unit time to unit speed."""
    run = minimiser(4, {0: 0, 1: 0, 2: 0, 3: 0}, {0: travel, 1: 1, 2: 0, 3: 0})
    return integrate(run.deriv(4) ** 2, [0.0, 1.0])


def cam_numbers() -> dict[str, float]:
    """Compute breadths, radii and kinks of the cams of A, B and D, over the stroke.

    Returns
    -------
    dict of str to float
        Values by row name [-].
    """
    return _profile_of_a() | _profiles_of_b() | _least_breadths()


def _profile_of_a() -> dict[str, float]:
    """Compare radii less half the breadth with A (42) and D (4.113); return stroke phi = 7 pi/6 + u pi/3."""
    cam = Cam(Cycle(_unit(A)), breadth=2.0, follower=Pointed())
    u = np.linspace(0, 2, 41)
    right = cam.radius(7 * np.pi / 6 + u * np.pi / 3) - 1.0
    readings = [np.abs(0.4 * (a + b * u) + c / 2 - right).max() for a, b, c in product((1, -1), repeat=3)]
    return {
        "a_breadth": _breadth(cam),
        "a42_start": right[0],
        "a42_miss": np.abs(-0.4 * (1 - u) + 0.5 - right).max(),
        "d4113_miss": min(readings),
    }


def _profiles_of_b() -> dict[str, float]:
    cam, cycle = Cam(Cycle(_unit(B)), breadth=2.0, follower=Pointed()), printed_law_of_b().cycle()
    printed = Cam(cycle, breadth=2 * STROKE, follower=Pointed())
    return {
        "b_breadth": _breadth(cam),
        "b41_start": float(cam.radius(np.pi)) - 1.0,
        "b_printed_breadth": _breadth(printed),
        "b_kinks": len(printed.corner_angles),
        "b_kink": _velocity_step(cycle) * DURATION / np.pi / STROKE,
    }


def _breadth(cam: Cam) -> float:
    """Compute the largest rho(phi) + rho(phi + pi) over b."""
    angle = np.linspace(0, np.pi, 361)
    return (cam.radius(angle) + cam.radius(angle + np.pi)).max() / cam.breadth


def _least_breadths() -> dict[str, float]:
    """Compute the least breadth over stroke of cams with flat-faced followers."""
    least = {name: least_breadth(Cycle(_unit(name)), FlatFace()).breadth for name in LIMITED_BREADTH + FREE_BREADTH}
    found = {f"{name}_breadth": least[name] for name in LIMITED_BREADTH}
    return found | {"free_breadth": max(least[name] for name in FREE_BREADTH)}
