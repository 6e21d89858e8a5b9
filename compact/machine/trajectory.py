"""Trajectory of a cart behind a spring: its motion and forces at any place of the intervals of `elastic_motion`."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from compact.machine.oscillator import (
    POLYNOMIAL,
    SCALE,
    SERIES_TERMS,
    ZERO_TOLERANCE,
    combine,
    evaluate,
    max_abs_product,
    transform,
)
from compact.machine.spring_cart import (
    AT_NEAR_PLATE,
    FULL_RANGE,
    KNOT_TOLERANCE,
    NEAR_SPRING,
    CartState,
    SpringCart,
    differentiate_resistance,
    solve_acceleration,
    spring_force,
)
from compact.numerics import Array, IntArray
from compact.numerics.jit import compiled
from compact.numerics.piecewise import clenshaw_curtis

CELL_POINTS = 17  # [-], points of a cell; integrals of the square of an oscillation are exact to 1e-9
CELL_ANGLE = 2.5  # [rad], of an oscillation; size of a cell
OSCILLATION_FLOOR = 1e-12  # [-], of the initial amplitude; a smaller oscillation is not resolved
MAX_SAMPLES = 250_000  # [-], of a cycle; 1 kB each at the peak, 128 B for the lifetime of the run
RANGES_PER_CALL = 50_000  # [-], of one compiled call; 0.1 s or less
ROW_HEAD = 6  # columns of an interval before its signal and its driven end: start, duration, slip, flank, zone, turn


class Intervals(NamedTuple):
    """Solution over intervals between events, one row per interval; u = (t - start)/scale.

    Parameters
    ----------
    start, duration, scale : ndarray, shape (n,)
        Start, duration and time over which u increases by 1 [s], duration <= scale.
    slip, flank, zone : ndarray, shape (n,)
        Direction of the motion, 0 at rest, and as in `CartState`.
    turn : ndarray, shape (n,)
        Position of the last turn [m].
    decay, discriminant, cosine, sine : ndarray, shape (n,)
        d, D, A and B of the elongation.
    elongation : ndarray, shape (n, SERIES_TERMS)
        Polynomial part of the elongation e(u) [m].
    driven_end : ndarray, shape (n, degree + 1)
        Coefficients of the driven-end position y(u) [m].
    """

    start: Array
    duration: Array
    slip: IntArray
    flank: IntArray
    zone: IntArray
    turn: Array
    decay: Array
    discriminant: Array
    scale: Array
    cosine: Array
    sine: Array
    elongation: Array
    driven_end: Array


class Kinematics(NamedTuple):
    """Motion and forces at places of a trajectory; arrays of one shape.

    Parameters
    ----------
    position, velocity, acceleration, jerk : ndarray
        Of the cart [m], [m/s], [m/s^2], [m/s^3].
    resistance : ndarray
        Force of mix and guides on the cart [N]; the whole pull for a cart at rest.
    drive_force, end_spring_force : ndarray
        H of drive spring and damper [N], and S of the end springs [N], at a plate the force that holds the cart.
    elongation, elongation_rate : ndarray
        e [m] and e' [m/s].
    driven_end, driven_velocity : ndarray
        y [m] and y' [m/s].
    """

    position: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    resistance: Array
    drive_force: Array
    end_spring_force: Array
    elongation: Array
    elongation_rate: Array
    driven_end: Array
    driven_velocity: Array


@compiled
def _sample(cart: SpringCart, rows: Array, places: IntArray, us: Array) -> Array:
    """`Kinematics` at places of intervals, shape (11, n)."""
    out, last, first = np.empty((11, len(us))), -1, ROW_HEAD + POLYNOMIAL + SERIES_TERMS
    for n in range(len(us)):
        if places[n] != last:
            last = places[n]
            row = rows[last]
            e, slip, flank, zone = row[ROW_HEAD:first], row[2], row[3], row[4]
            y, e_rate = combine(e, row[first:], 0.0, 0.0, 1.0, 0.0, 0.0), transform(e, 0.0, 1.0, 0.0)
            y_rate = transform(y, 0.0, 1.0, 0.0)
            y_change = transform(y_rate, 0.0, 1.0, 0.0)
            stiffness, _, constant = spring_force(cart, flank, 0.0)
        u = us[n]
        elongation, rate, driven, pace = evaluate(e, u), evaluate(e_rate, u), evaluate(y, u), evaluate(y_rate, u)
        force, side = stiffness * elongation + constant + cart.damping * rate, np.sign(zone)
        position, velocity = driven - elongation, (pace - rate) * abs(slip)
        compressed = cart.end_preload + cart.end_stiffness * (
            cart.end_length - (position if side > 0 else cart.stroke - position)
        )
        holding = min(max(-side * force, 0.0), cart.end_preload)
        end_force = side * (holding if abs(zone) == AT_NEAR_PLATE else compressed)
        acceleration = jerk = 0.0
        resistance = pull = force + end_force
        if slip != 0:
            travel, until = slip * (position - row[5]), row[1] / e[SCALE]
            acceleration = solve_acceleration(cart, slip, velocity, travel, pull)
            resistance = pull - cart.mass * acceleration
            inside = min(max(u, KNOT_TOLERANCE), until * (1 - KNOT_TOLERANCE))  # slopes are limits from inside
            within = evaluate(y_rate, inside) - evaluate(e_rate, inside)
            _, damping, mass, steepness = differentiate_resistance(cart, slip, within, acceleration, travel, FULL_RANGE)
            steepness += cart.end_stiffness if abs(zone) == NEAR_SPRING else 0.0
            pull_rate = stiffness * rate + cart.damping * (evaluate(y_change, u) - acceleration)
            jerk = (pull_rate - damping * acceleration - steepness * velocity) / (cart.mass + mass)
        values = (position, velocity, acceleration, jerk, resistance, force, end_force, elongation, rate, driven, pace)
        for k in range(11):
            out[k, n] = values[k]
    return out


@dataclass(frozen=True)
class Trajectory:
    """Motion of a cart over a time. A place is an interval index i and u in [0, duration/scale]."""

    cart: SpringCart
    rows: Array
    start: CartState
    end: CartState

    @cached_property
    def intervals(self) -> Intervals:
        """Intervals between events, in order of time."""
        start, duration, slip, flank, zone, turn, *signal = self.rows[:, : ROW_HEAD + POLYNOMIAL].T
        elongation, driven_end = np.split(self.rows[:, ROW_HEAD + POLYNOMIAL :], [SERIES_TERMS], axis=1)
        directions = (column.astype(int) for column in (slip, flank, zone))
        return Intervals._make([start, duration, *directions, turn, *signal, elongation, driven_end])

    @property
    def sample_count(self) -> int:
        """Upper bound of the number of `sample_points`, without their computation."""
        return CELL_POINTS * (
            2 * len(self.intervals.start) + sum(map(self._cell_count, range(len(self.intervals.start))))
        )

    def sample_points(self) -> tuple[IntArray, Array, Array]:
        """Interval indices i, places u and weights [s] that resolve imposed motion and oscillation, shape (n,)."""
        nodes, unit_weights = clenshaw_curtis(CELL_POINTS)
        columns = []
        for i, scale in enumerate(self.intervals.scale):
            edges = self._cell_edges(i)
            width = np.diff(edges)[:, None]
            t = (edges[:-1, None] + width * nodes).ravel()
            columns.append((np.full(t.shape, i), t / scale, (width * unit_weights).ravel()))
        rows, places, weights = (np.concatenate(column) for column in zip(*columns, strict=True))
        return rows, places, weights

    def _cell_edges(self, i):
        """Edges [s] of cells of interval i in each of which the oscillation turns by `CELL_ANGLE` at most."""
        duration, decay, discriminant = (float(column[i]) for column in self._oscillation)
        if not self._oscillates(i):
            return np.linspace(0, duration, 3)
        if discriminant >= 0:  # two real roots; bisection towards the start, where the faster one decays
            halvings = math.ceil(math.log2(max(2.0, duration * (abs(decay) + math.sqrt(discriminant)))))
            return np.append(0.0, duration * 2.0 ** np.arange(-halvings, 1))
        resolved = oscillation_time(decay, duration)
        edges = np.linspace(0, resolved, self._cell_count(i) + 1)
        return edges if resolved == duration else np.append(edges, np.linspace(resolved, duration, 3)[1:])

    def _cell_count(self, i):
        """Count the cells that resolve the oscillation of interval i, 0 without one."""
        duration, decay, discriminant = (float(column[i]) for column in self._oscillation)
        if discriminant >= 0 or not self._oscillates(i):
            return 0
        return math.ceil(oscillation_time(decay, duration) * math.sqrt(decay**2 - discriminant) / CELL_ANGLE)

    @property
    def _oscillation(self):
        """Duration [s], decay [1/s] and discriminant [1/s^2] of all intervals."""
        return self.intervals.duration, self.intervals.decay, self.intervals.discriminant

    def _oscillates(self, i):
        """Return true if the free oscillation of interval i is larger than rounding of the elongation."""
        duration, _, discriminant = (abs(float(column[i])) for column in self._oscillation)
        cosine, sine = abs(self.intervals.cosine[i]), abs(self.intervals.sine[i])
        amplitude = cosine + sine * min(duration, 1 / math.sqrt(discriminant) if discriminant else math.inf)
        return bool(amplitude > ZERO_TOLERANCE * np.abs(self.intervals.elongation[i]).max())

    def locate(self, time: Array) -> tuple[IntArray, Array]:
        """Interval indices i and places u of times [s] within the trajectory."""
        starts = self.intervals.start
        i = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, len(starts) - 1)
        return i, (time - starts[i]) / self.intervals.scale[i]

    def at(self, i: IntArray, u: Array) -> Kinematics:
        """Motion and forces at places of the trajectory, arrays of shape (n,)."""
        return Kinematics(*_sample(self.cart, self.rows, i, u))

    def energy(self, state: CartState, driven_end: float = 0.0) -> float:
        """Energy of cart and springs [J] in a state, with the driven end at a position [m]."""
        cart, position = self.cart, driven_end - state.elongation
        stretch = state.elongation - state.flank * cart.backlash / 2 if state.flank else 0.0
        compression = max(cart.end_length - min(position, cart.stroke - position), 0.0) if cart.end_length else 0.0
        stored = cart.end_preload * compression + cart.end_stiffness / 2 * compression**2
        return cart.mass / 2 * state.velocity**2 + cart.stiffness / 2 * stretch**2 + stored

    def peak_force_and_power(self) -> tuple[float, float]:
        """Largest |H| of drive spring and damper [N] and largest |H y'| [W]."""
        peaks, row = np.zeros(2), 0
        while row < len(self.rows):  # Python handles interrupts between two calls
            try:
                row = _search_peaks(self.cart, self.rows, peaks, row)
            except RuntimeError as error:
                raise RuntimeError(f"the search for the peak force did not end: {error}") from None
        return float(peaks[0]), float(peaks[1])


@compiled
def _search_peaks(cart, rows, peaks, row):
    """Update the largest |H| and |H y'| from an interval on; returns the first one that is left."""
    work, first, degree = 0, ROW_HEAD + POLYNOMIAL, rows.shape[1] - ROW_HEAD - POLYNOMIAL - SERIES_TERMS
    for i in range(row, len(rows)):
        terms = SERIES_TERMS
        while terms > degree and rows[i, first + terms - 1] == 0:
            terms -= 1
        elongation, y, until = rows[i, ROW_HEAD : first + terms], rows[i, first + SERIES_TERMS :], rows[i, 1]
        stiffness, _, constant = spring_force(cart, rows[i, 3], 0.0)
        force = transform(elongation, stiffness, cart.damping, constant)
        one = transform(elongation, 0.0, 0.0, 1.0)
        pace = combine(elongation, y, 0.0, 0.0, 0.0, 1.0, 0.0)
        for which, factor in ((0, one), (1, pace)):
            largest, ranges = max_abs_product(force, factor, until / elongation[SCALE])
            peaks[which] = max(peaks[which], largest)
            work += ranges
        if work > RANGES_PER_CALL:
            return i + 1
    return len(rows)


def oscillation_time(decay: float, duration: float) -> float:
    """Time [s] within a duration [s] during which an oscillation of a decay [1/s] exceeds `OSCILLATION_FLOOR`."""
    return min(duration, -math.log(OSCILLATION_FLOOR) / decay) if decay > 0 else duration
