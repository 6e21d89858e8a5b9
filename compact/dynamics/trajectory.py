"""Trajectory of a cart behind a spring: evaluation of the intervals of `event_driven` at any place."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from compact.dynamics.event_driven import Intervals
from compact.dynamics.force_elements import (
    AT_NEAR_PLATE,
    KNOT_TOLERANCE,
    NEAR_SPRING,
    CartState,
    OscillatorParameters,
    ResistanceTable,
)
from compact.dynamics.oscillator import ZERO_TOLERANCE
from compact.numerics import Array, IntArray
from compact.numerics.piecewise import PiecewisePolynomial, clenshaw_curtis, horner

CELL_POINTS = 17  # [-], points of a cell; integrals of the square of an oscillation are exact to 1e-9
CELL_ANGLE = 2.5  # [rad], of an oscillation; size of a cell
OSCILLATION_FLOOR = 1e-12  # [-], of the initial amplitude; a smaller oscillation is not resolved
MAX_SAMPLES = 250_000  # [-], of a cycle; 1 kB each at the peak, 128 B for the lifetime of the run


class Kinematics(NamedTuple):
    """Motion of a cart at places of its trajectory; arrays of one shape.

    Parameters
    ----------
    position, velocity, acceleration, jerk : ndarray
        [m], [m/s], [m/s^2], [m/s^3].
    resistance : ndarray
        Force of mix and guides on the cart [N]; the whole pull for a cart at rest.
    """

    position: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    resistance: Array


@dataclass(frozen=True)
class Trajectory:
    """Motion of a cart over a time. A place is an interval index i and u in [0, duration/scale]."""

    oscillator: OscillatorParameters
    intervals: Intervals
    resistance: ResistanceTable
    start: CartState
    end: CartState

    @property
    def sample_count(self) -> int:
        """Upper bound of the number of `sample_points`, without their computation."""
        return CELL_POINTS * sum(self._cell_count(i, float(d)) + 2 for i, d in enumerate(self.intervals.duration))

    def sample_points(self) -> tuple[IntArray, Array, Array]:
        """Interval indices i, places u and weights [s] that resolve imposed motion and oscillation, shape (n,)."""
        nodes, unit_weights = clenshaw_curtis(CELL_POINTS)
        columns = []
        for i, (scale, duration) in enumerate(zip(self.intervals.scale, self.intervals.duration, strict=True)):
            edges = self._cell_edges(i, duration)
            width = np.diff(edges)[:, None]
            t = (edges[:-1, None] + width * nodes).ravel()
            columns.append((np.full(t.shape, i), t / scale, (width * unit_weights).ravel()))
        rows, places, weights = (np.concatenate(column) for column in zip(*columns, strict=True))
        return rows, places, weights

    def _cell_edges(self, i: int, duration: float) -> Array:
        """Edges [s] of cells of interval i in each of which the oscillation turns by `CELL_ANGLE` at most."""
        _, _, decay, discriminant = self.intervals.oscillation[i]
        if not self._oscillates(i, duration):
            return np.linspace(0, duration, 3)
        if discriminant >= 0:  # two real roots; bisection towards the start, where the faster one decays
            halvings = math.ceil(math.log2(max(2.0, duration * (abs(decay) + math.sqrt(discriminant)))))
            return np.append(0.0, duration * 2.0 ** np.arange(-halvings, 1))
        resolved = oscillation_time(decay, duration)
        edges = np.linspace(0, resolved, self._cell_count(i, duration) + 1)
        return edges if resolved == duration else np.append(edges, np.linspace(resolved, duration, 3)[1:])

    def _cell_count(self, i: int, duration: float) -> int:
        """Count the cells that resolve the oscillation of interval i, 0 without one."""
        _, _, decay, discriminant = self.intervals.oscillation[i]
        if not self._oscillates(i, duration) or discriminant >= 0:
            return 0
        return math.ceil(oscillation_time(decay, duration) * math.sqrt(decay**2 - discriminant) / CELL_ANGLE)

    def _oscillates(self, i: int, duration: float) -> bool:
        """Return true if the free oscillation of interval i is larger than rounding of the elongation."""
        cosine, sine, _, discriminant = np.abs(self.intervals.oscillation[i])
        amplitude = cosine + sine * min(duration, 1 / math.sqrt(discriminant) if discriminant else math.inf)
        return bool(amplitude > ZERO_TOLERANCE * np.abs(self.intervals.elongation[i]).max())

    def locate(self, time: Array) -> tuple[IntArray, Array]:
        """Interval indices i and places u of times [s] within the trajectory."""
        starts = self.intervals.start
        i = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, len(starts) - 1)
        return i, (time - starts[i]) / self.intervals.scale[i]

    def elongation(self, i: IntArray, u: Array) -> tuple[Array, Array]:
        """Elongation e [m] of the drive spring and its rate [m/s]."""
        scale, polynomial = self.intervals.scale[i], self.intervals.elongation[i]
        cosine, sine, decay, discriminant = self.intervals.oscillation[i].T
        g0, g1 = _free_oscillation(decay, discriminant, scale * u)
        elongation = horner(polynomial, u) + cosine * g0 + sine * g1
        rate = horner(_derivative(polynomial), u) / scale
        rate = rate + (sine - decay * cosine) * g0 + (discriminant * cosine - decay * sine) * g1
        return elongation, rate

    def driven_end(self, i: IntArray, u: Array, order: int = 0) -> Array:
        """Position y of the driven end [m], or its derivative with respect to time of the given order."""
        polynomial = self.intervals.driven_end[i]
        for _ in range(order):
            polynomial = _derivative(polynomial)
        return horner(polynomial, u) / self.intervals.scale[i] ** order

    def drive_force(self, i: IntArray, u: Array) -> Array:
        """Force H of drive spring and damper [N]."""
        elongation, rate = self.elongation(i, u)
        return self._flank_force(self.intervals.flank[i], elongation) + self.oscillator.damping * rate

    def _flank_force(self, flank, elongation):
        """Force of the drive spring [N]."""
        engaged = np.where(flank != 0, elongation - flank * self.oscillator.backlash / 2, 0.0)
        return self.oscillator.stiffness * engaged

    def end_spring_force(self, i: IntArray, u: Array) -> Array:
        """Force S of the end springs [N]; at the plate of one the force that holds the cart at rest."""
        ends, zone = self.oscillator.end_springs, self.intervals.zone[i]
        position = self.driven_end(i, u) - self.elongation(i, u)[0]
        sign = np.sign(zone)
        compression = ends.length - np.where(sign > 0, position, ends.stroke - position)
        holding = np.clip(-sign * self.drive_force(i, u), 0.0, ends.preload)
        compressed = ends.preload + ends.stiffness * compression
        return sign * np.where(np.abs(zone) == AT_NEAR_PLATE, holding, compressed)

    def kinematics(self, i: IntArray, u: Array) -> Kinematics:
        """Motion of the cart and the force that resists it."""
        elongation, rate = self.elongation(i, u)
        slip, pull = self.intervals.slip[i], self.drive_force(i, u) + self.end_spring_force(i, u)
        velocity: Array = np.where(slip != 0, self.driven_end(i, u, 1) - rate, 0.0)
        inside = np.clip(u, KNOT_TOLERANCE, self.intervals.duration[i] / self.intervals.scale[i] * (1 - KNOT_TOLERANCE))
        within = self.driven_end(i, inside, 1) - self.elongation(i, inside)[1]
        force, slope, added_mass, mass_slope = self._resistance_terms(slip, velocity, within)
        mass, rate_limit = self.oscillator.mass, self.resistance.rate_limit
        limit = np.full(np.shape(velocity), np.inf) if rate_limit == np.inf else rate_limit * (slip * velocity)
        unsaturated = (pull - force) / (mass + added_mass)
        follows, sign = np.abs(unsaturated) <= limit, np.sign(unsaturated)
        limit = np.where(follows, 0.0, limit)
        saturated = (pull - force - sign * added_mass * limit) / mass
        acceleration = np.where(follows, unsaturated, saturated) * (slip != 0)
        resisting = np.where(slip != 0, force + added_mass * np.where(follows, acceleration, sign * limit), pull)
        saturated_slope = sign * slip * (np.where(follows, 0.0, rate_limit) * added_mass + mass_slope * limit)
        slope = slope + np.where(follows, slip * mass_slope * acceleration, saturated_slope)
        pull_rate = self._pull_rate(i, u, rate, velocity, acceleration)
        moving_mass = mass + np.where(follows, added_mass, 0.0)
        jerk = np.where(slip != 0, (pull_rate - slope * acceleration) / moving_mass, 0.0)
        return Kinematics(self.driven_end(i, u) - elongation, velocity, acceleration, jerk, resisting)

    def _pull_rate(self, i, u, rate, velocity, acceleration):
        """Rate of the force of drive and end springs [N/s]."""
        stiffness = np.where(self.intervals.flank[i] != 0, self.oscillator.stiffness, 0.0)
        pull_rate = stiffness * rate + self.oscillator.damping * (self.driven_end(i, u, 2) - acceleration)
        compressed = np.abs(self.intervals.zone[i]) == NEAR_SPRING
        return pull_rate - np.where(compressed, self.oscillator.end_springs.stiffness, 0.0) * velocity

    def _resistance_terms(self, slip, velocity, within):
        """F, dF/dv, M and dM/d|v| on the side of the slip; the slopes are limits from inside the interval."""
        speed, within = slip * velocity, slip * within
        tables = self.resistance.forward, self.resistance.backward
        forward, backward = ((table(speed), _table_slope(table, within)) for table in tables)
        force, slope = (np.where(slip > 0, one, other) for one, other in zip(forward, backward, strict=True))
        if self.resistance.rate_limit == 0:
            return force, slip * slope, 0.0, 0.0
        added_mass = self.resistance.added_mass
        return force, slip * slope, added_mass(speed), _table_slope(added_mass, within)

    def energy(self, state: CartState, driven_end: float = 0.0) -> float:
        """Energy of cart and springs [J] in a state, with the driven end at a position [m]."""
        ends, flank = self.oscillator.end_springs, state.flank
        force, position = float(self._flank_force(flank, state.elongation)), driven_end - state.elongation
        compression = max(ends.length - min(position, ends.stroke - position), 0.0) if ends.length else 0.0
        stored = ends.preload * compression + ends.stiffness / 2 * compression**2
        kinetic = self.oscillator.mass / 2 * state.velocity**2
        return kinetic + force**2 / (2 * self.oscillator.stiffness) + stored


def oscillation_time(decay: float, duration: float) -> float:
    """Time [s] within a duration [s] during which an oscillation of a decay [1/s] exceeds `OSCILLATION_FLOOR`."""
    return min(duration, -math.log(OSCILLATION_FLOOR) / decay) if decay > 0 else duration


def _derivative(polynomial: Array) -> Array:
    """Coefficients of the derivative with respect to u, in the same shape."""
    derivative = np.zeros_like(polynomial)
    derivative[..., :-1] = polynomial[..., 1:] * np.arange(1, polynomial.shape[-1])
    return derivative


def _table_slope(table: PiecewisePolynomial, speed: Array) -> Array:
    """Differentiate a table with respect to |v|."""
    i = np.clip(np.searchsorted(table.breaks, speed, side="right") - 1, 0, len(table.coefficients) - 1)
    width = table.breaks[i + 1] - table.breaks[i]
    return horner(_derivative(table.coefficients)[i], (speed - table.breaks[i]) / width) / width


def _free_oscillation(decay, discriminant, t):
    """g0 and g1 of `oscillator.free_oscillation`, for arrays of one shape."""
    frequency, growth = np.sqrt(np.abs(discriminant)), np.sqrt(np.maximum(discriminant, 0.0))
    safe = np.where(frequency > 0, frequency, 1.0)
    amplitude = np.exp(-decay * t)
    slow, fast = np.exp(-(decay - growth) * t), -np.expm1(-2 * growth * t)
    g0 = np.where(discriminant < 0, amplitude * np.cos(frequency * t), slow * (1 - fast / 2))
    g1 = np.where(discriminant < 0, amplitude * np.sin(frequency * t) / safe, slow * fast / (2 * safe))
    return np.where(discriminant == 0, amplitude, g0), np.where(discriminant == 0, amplitude * t, g1)
