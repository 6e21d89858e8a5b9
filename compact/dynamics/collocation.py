"""One interval of sliding of a cart behind a spring, solved by collocation of its resistance.

    (m + M) e'' + (c + d) e' + K e = (m + M) y'' + d y' + n y - g + R0 - d v0 - M a0 + r(t)
    r = R(v, a) - R0 - d (v - v0) - M (a - a0),   d = dR/dv, M = dR/da at the start of the interval

K e - n y + g is the force of the springs (`force_elements.SpringForce`). The remainder r of the linearised resistance
is interpolated by a polynomial at Chebyshev points, so that the elongation e has a closed form (`oscillator`). The
fixed-point iteration on r converges in one step for dry friction.

R is smooth between its knots. An interval continues R smoothly beyond the `SmoothRange` of its start and ends at the
exit from that range if the difference exceeds the tolerance. No interval extends across a knot.
"""

from typing import NamedTuple

import numpy as np

from compact.dynamics import oscillator as signals
from compact.dynamics.force_elements import (
    FULL_RANGE,
    KNOT_TOLERANCE,
    CartState,
    OscillatorParameters,
    ResistanceTable,
    SmoothRange,
    differentiate_resistance,
    smooth_range,
    solve_acceleration,
    spring_force,
)
from compact.numerics import Array, IntArray
from compact.numerics.jit import compiled, inlined

POINTS = 9  # [-], of the collocation; the defect falls with the ninth power of the step
DEFECT_POINTS = 16  # [-], cells between the points of an interval at which the defect is evaluated
COLLOCATION_ITERATIONS = 25  # [-], of the collocation; 1 for dry friction, 2 to 6 are usual
MIN_STEP_RATIO, MAX_STEP_RATIO, STEP_SAFETY = 0.2, 6.0, 0.9  # [-], of the step control
STEPS_PER_OCTAVE = 8  # [-], of the grid of steps
LEAST_RHO = 1 + 1e-3  # [-], of Bernstein's ellipse; an interval up to rest is within reach
FORCE_ROUNDING = 2e-12  # [-], of R; a thousand times the rounding of a defect by it
VELOCITY_ROUNDING = 2e-13  # [-], of the velocity of the driven end; a thousand times the rounding of a velocity
RESOLVED_DEFECT = 1e-3  # [-], of the tolerance; a larger defect determines the step, whatever its rounding
STOP_STEP_RATIO = 0.05  # [-]; smallest step ratio while the cart comes to rest
OVERSHOOT = 1.1  # [-], of the time to an event; the shortened interval still contains the event
EARLIEST_SATURATION = 1e-2  # [-], of an interval; earlier changes of the saturation are rounding at the limit
PULL_ROUNDING = 1e-10  # [-], of the pull; a smaller force of inertia is rounding and does not select a smooth range
NODES = np.sin(np.pi * np.arange(POINTS) / (2 * (POINTS - 1))) ** 2
DEFECT_NODES = np.arange(DEFECT_POINTS + 1) / DEFECT_POINTS
TO_COEFFICIENTS = np.linalg.inv(np.vander(NODES, increasing=True))


class LinearisedResistance(NamedTuple):
    """R near the start of an interval: force + damping (v - velocity) + added_mass (a - acceleration).

    Parameters
    ----------
    force, damping, added_mass : float
        R0 [N], d = dR/dv [N s/m] and M = dR/da [kg].
    velocity, acceleration : float
        v0 [m/s] and a0 [m/s^2] at the start.
    """

    force: float
    damping: float
    added_mass: float
    velocity: float
    acceleration: float
    smooth_range: SmoothRange


class SlidingProblem(NamedTuple):
    """A cart that slides from a state.

    Parameters
    ----------
    slip : int
        Direction of the motion, +1 or -1.
    tolerance : float
        Largest defect of the resistance [N].
    """

    oscillator: OscillatorParameters
    resistance: ResistanceTable
    state: CartState
    slip: int
    linear: LinearisedResistance
    tolerance: float


class SlidingSolution(NamedTuple):
    """Result of the collocation over 0 <= u <= 1.

    Parameters
    ----------
    driven_end : ndarray
        Coefficients of the driven-end position y(u) [m].
    elongation : Signal
        e(u) [m].
    remainder : ndarray
        Coefficients of r(u) [N].
    converged, evaluations : bool, int
        True after convergence of the iteration; evaluations of R.
    """

    driven_end: Array
    elongation: signals.Signal
    remainder: Array
    converged: bool
    evaluations: int


@inlined
def set_up_sliding(
    oscillator: OscillatorParameters,
    resistance: ResistanceTable,
    state: CartState,
    slip: int,
    position: float,
    velocity: float,
    tolerance: float,
) -> SlidingProblem:
    """Sliding problem of a state, with the driven end at a position [m] and a velocity [m/s].

    Parameters
    ----------
    oscillator : OscillatorParameters
        Cart on its drive spring.
    resistance : ResistanceTable
        Resistance of the mix.
    state : CartState
        State at the start.
    slip : int
        Direction of the motion, +1 or -1.
    position : float
        Position of the driven end [m].
    velocity : float
        Velocity of the driven end [m/s].
    tolerance : float
        Largest defect of the resistance [N].

    Returns
    -------
    SlidingProblem
    """
    springs = spring_force(oscillator, state.flank, state.zone)
    pull = springs.stiffness * state.elongation - springs.driven_end_stiffness * position + springs.constant
    pull += oscillator.damping * (velocity - state.velocity)
    a = solve_acceleration(resistance, slip, state.velocity, oscillator.mass, pull)
    steady = abs(oscillator.mass * a) <= PULL_ROUNDING * abs(pull)
    within = smooth_range(resistance, slip, state.velocity, 0.0 if steady else a)
    table = resistance.forward if slip > 0 else resistance.backward
    force, damping, added_mass = differentiate_resistance(
        table, resistance.added_mass, resistance.rate_limit, slip, state.velocity, a, within
    )
    linear = LinearisedResistance(force, damping, added_mass, state.velocity, a, within)
    return SlidingProblem(oscillator, resistance, state, slip, linear, tolerance)


@inlined
def limit_sliding_step(problem: SlidingProblem, h: float) -> float:
    """Step h [s], shortened where the linearised motion grows."""
    oscillator, state, linear = problem.oscillator, problem.state, problem.linear
    stiffness = spring_force(oscillator, state.flank, state.zone).stiffness
    return signals.limit_step(oscillator.mass + linear.added_mass, oscillator.damping + linear.damping, stiffness, h)


@inlined
def solve_sliding(problem: SlidingProblem, driven_end: Array, h: float, counter: IntArray) -> SlidingSolution:
    """Solve at most h [s] of sliding under driven_end(u) by collocation.

    The interval is shortened to a little beyond the exit from the smooth range where the exit affects the resistance.
    """
    force = _linear_force(problem, driven_end, h)
    elongation = _respond(problem, force, driven_end, h)
    fraction = _range_exit_fraction(problem, signals.cart_velocity(elongation, driven_end), counter)
    if fraction < 1:
        driven_end, h = signals.substitute(driven_end, 0.0, fraction), h * fraction
        force = _linear_force(problem, driven_end, h)
        elongation = _respond(problem, force, driven_end, h)
    remainder, previous = np.zeros(len(driven_end)), np.zeros(POINTS)
    for iteration in range(COLLOCATION_ITERATIONS):
        velocity = signals.cart_velocity(elongation, driven_end)
        values = _remainder(problem, velocity, NODES, problem.linear.smooth_range)[1]
        change = np.abs(values - previous).max()
        if not change < np.inf:
            return SlidingSolution(driven_end, elongation, remainder, False, (iteration + 1) * POINTS)
        previous, coefficients = values, TO_COEFFICIENTS @ values
        for j in range(POINTS):  # assignments of arrays take seconds to compile
            remainder[j] = coefficients[j]
        elongation = _respond(problem, force + remainder, driven_end, h)
        if change <= problem.tolerance / 10:  # the remaining error falls by the same factor
            return SlidingSolution(driven_end, elongation, remainder, True, (iteration + 1) * POINTS)
    return SlidingSolution(driven_end, elongation, remainder, False, COLLOCATION_ITERATIONS * POINTS)


@compiled
def _linear_force(problem, driven_end, h):
    """Force f(u) [N] on the oscillator of a sliding cart, without r."""
    oscillator, state, linear = problem.oscillator, problem.state, problem.linear
    springs, n = spring_force(oscillator, state.flank, state.zone), len(driven_end)
    mass, force = oscillator.mass + linear.added_mass, springs.driven_end_stiffness * driven_end
    for j in range(n):
        if j + 2 < n:
            force[j] += mass / h**2 * (j + 1) * (j + 2) * driven_end[j + 2]
        if j + 1 < n:
            force[j] += linear.damping / h * (j + 1) * driven_end[j + 1]
    force[0] += (
        linear.force - springs.constant - linear.damping * linear.velocity - linear.added_mass * linear.acceleration
    )
    return force


@compiled
def _respond(problem, force, driven_end, h):
    """Elongation under f(u) as a `Signal`."""
    oscillator, state, linear = problem.oscillator, problem.state, problem.linear
    mass, damping = oscillator.mass + linear.added_mass, oscillator.damping + linear.damping
    stiffness = spring_force(oscillator, state.flank, state.zone).stiffness
    return signals.solve_oscillator(
        mass, damping, stiffness, force, state.elongation, driven_end[1] / h - state.velocity, h
    )


@compiled
def _remainder(problem, velocity, places, within):
    """Velocities [m/s] and r [N] at places u, with R continued beyond a smooth range."""
    resistance, slip, linear = problem.resistance, problem.slip, problem.linear
    table, added_mass = resistance.forward if slip > 0 else resistance.backward, resistance.added_mass
    limit = resistance.rate_limit
    change, velocities, remainder = signals.differentiate(velocity), np.empty(len(places)), np.empty(len(places))
    for i in range(len(places)):
        v = signals.evaluate(velocity, places[i])
        a = signals.evaluate(change, places[i]) / velocity.scale if limit > 0 else 0.0
        force = differentiate_resistance(table, added_mass, limit, slip, v, a, within)[0]
        tangent = linear.force + linear.damping * (v - linear.velocity) + linear.added_mass * (a - linear.acceleration)
        velocities[i], remainder[i] = v, force - tangent
    return velocities, remainder


@inlined
def _range_exit_fraction(problem, velocity, counter):
    """Fraction of a motion to a little beyond its exit from the smooth range; 1 where the exit has no effect."""
    slip, within = problem.slip, problem.linear.smooth_range
    velocities, continued = _remainder(problem, velocity, NODES, within)
    low, high = (slip * velocities).min(), (slip * velocities).max()
    if problem.resistance.rate_limit == 0 and within.low <= low and high <= within.high:
        return 1.0
    exact = _remainder(problem, velocity, NODES, FULL_RANGE)[1]
    for i in range(POINTS):
        if slip * velocities[i] > 0 and abs(exact[i] - continued[i]) > problem.tolerance:
            return min(1.0, OVERSHOOT * range_exit(problem, velocity, counter))
    return 1.0


@compiled
def range_exit(problem: SlidingProblem, velocity: signals.Signal, counter: IntArray) -> float:
    """First u at which a motion leaves the smooth range of its start; 2.0 without an exit.

    Parameters
    ----------
    problem : SlidingProblem
        Cart that slides from a state.
    velocity : Signal
        Velocity v(u) [m/s].
    counter : ndarray
        Search counter, modified in place.

    Returns
    -------
    float
        u of the exit [-], 2.0 without one.
    """
    slip, within, first = problem.slip, problem.linear.smooth_range, 2.0
    for sign, limit in ((1.0, within.low), (-1.0, within.high)):
        if 0 < limit < np.inf:
            distance = signals.multiply(velocity, sign * slip)
            distance.polynomial[0] -= sign * limit
            u = signals.first_downcrossing(distance, counter)
            first = min(first, u if u > KNOT_TOLERANCE else 2.0)
    rate_limit = problem.resistance.rate_limit
    if 0 < rate_limit < np.inf:
        change, inside = signals.differentiate(velocity), within.saturation == 0
        for sign in (1.0, -1.0):
            if inside or sign == within.saturation:
                margin = signals.add(
                    signals.multiply(velocity, slip * rate_limit), signals.multiply(change, -sign / velocity.scale)
                )
                u = signals.first_downcrossing(margin if inside else signals.multiply(margin, -1.0), counter)
                first = min(first, u if u > EARLIEST_SATURATION else 2.0)
    return first


@compiled
def evaluate_defect(
    problem: SlidingProblem, velocity: signals.Signal, remainder: Array, until: float
) -> tuple[float, float]:
    """Largest defect of r(u) [N] and largest |v| [m/s] for 0 <= u <= until.

    Parameters
    ----------
    problem : SlidingProblem
        Cart that slides from a state.
    velocity : Signal
        Velocity v(u) [m/s].
    remainder : ndarray
        Coefficients of r(u) [N].
    until : float
        Upper end of u [-].

    Returns
    -------
    tuple of float
        Largest defect [N] and largest |v| [m/s].
    """
    places = until * DEFECT_NODES
    velocities, exact = _remainder(problem, velocity, places, FULL_RANGE)
    worst, fastest = 0.0, 0.0
    for i in range(len(places)):
        r = 0.0
        for j in range(POINTS - 1, -1, -1):
            r = r * places[i] + remainder[j]
        if problem.slip * velocities[i] > 0:
            worst = max(worst, abs(exact[i] - r))
        fastest = max(fastest, abs(velocities[i]))
    return worst, fastest


@inlined
def step_ratio(problem: SlidingProblem, driven_end_velocity: float, defect: float) -> float:
    """Ratio of the admissible step to the last one for its defect [N], for a uniformly smooth R.

    A defect that rounding of force and velocity affects counts as one that it does not.
    """
    linear = problem.linear
    rounding = FORCE_ROUNDING * abs(linear.force) + VELOCITY_ROUNDING * abs(linear.damping * driven_end_velocity)
    resolved = min(rounding / problem.tolerance, RESOLVED_DEFECT)
    return STEP_SAFETY * max(defect / problem.tolerance, resolved, 1e-300) ** (-1 / POINTS)


@inlined
def round_step(step: float) -> float:
    """Longest step [s] of a geometric grid up to a step [s], so that rounding of a defect does not change the steps."""
    return 2.0 ** (np.floor(STEPS_PER_OCTAVE * np.log2(step)) / STEPS_PER_OCTAVE)


@inlined
def next_step(step: float, ratio: float, before: float, after: float) -> float:
    """Step [s] after a step [s], of which `ratio` was admissible.

    A power of |v| is singular at rest. Over an interval from speed `before` to `after` [m/s] the error of the
    interpolation falls by the parameter of Bernstein's ellipse, rho = |(1 + s)/(1 - s)| with s^2 = after/before, per
    point. A step that reaches rest is not rounded: it would end before.
    """
    s = np.sqrt(after / max(before, 1e-300))
    if abs(1 - s) < 1e-3:
        return round_step(step * min(ratio, MAX_STEP_RATIO))
    if s > 1e3:
        return round_step(step * MAX_STEP_RATIO)
    rho = max((1 + s) / abs(1 - s) / ratio, LEAST_RHO)
    end = (rho - 1) / (rho + 1) if s < 1 else (rho + 1) / (rho - 1)
    longest = step * min(max(s**2 * (1 - end**2) / (1 - s**2), STOP_STEP_RATIO), MAX_STEP_RATIO)
    return longest if s < 1 and rho == LEAST_RHO else round_step(longest)
