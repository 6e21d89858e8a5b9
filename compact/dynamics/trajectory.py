"""The way of a cart behind a spring over a time: arcs of it, as numbers at any place."""

import math
from dataclasses import dataclass

import numpy as np

from compact.dynamics.event_driven import Intervals
from compact.dynamics.force_elements import AT_NEAR, NEAR, CartState, Resistance, Spring
from compact.numerics.piecewise import clenshaw_curtis, horner

SAMPLES, TURN = 17, 2.5  # points for each so many rad of an oscillation: integrals of its square to 1e-9
ALIVE = 1e-12  # of an oscillation's first amplitude
MOST_SAMPLES = 250_000  # [-], of a cycle; they take 1 kB each at the peak, 128 B as long as the run is kept


@dataclass(frozen=True)
class Course:
    """The cart over a time: its arcs and what gives them meaning; it ran from the state `start` to `end`."""

    spring: Spring
    arcs: Intervals
    resistance: Resistance
    start: CartState
    end: CartState

    @property
    def sample_count(self):
        """Number of samples of `places`, without making them."""
        return SAMPLES * sum(self._cells(i, length) + 2 for i, length in enumerate(self.arcs.length))

    def places(self):
        """(arc, u, weight [s]) of samples that resolve law and ringing, each of shape (n,); weights integrate."""
        nodes, unit_weights = clenshaw_curtis(SAMPLES)
        columns = []
        for i, (span, length) in enumerate(zip(self.arcs.span, self.arcs.length, strict=True)):
            edges = self._edges(i, length)
            width = np.diff(edges)[:, None]
            t = (edges[:-1, None] + width * nodes).ravel()
            columns.append((np.full(t.shape, i), t / span, (width * unit_weights).ravel()))
        return tuple(np.concatenate(column) for column in zip(*columns, strict=True))

    def _edges(self, i, length):
        """Times of arc i, from 0 to its length, between which nothing swings more than TURN."""
        cosine, sine, decay, bend = self.arcs.ring[i]
        if not (cosine or sine):
            return np.linspace(0, length, 3)
        if bend >= 0:  # two real roots: halving towards the start, where the faster one lives
            halvings = math.ceil(math.log2(max(2.0, length * (abs(decay) + math.sqrt(bend)))))
            return np.append(0.0, length * 2.0 ** np.arange(-halvings, 1))
        alive = alive_time(decay, length)
        edges = np.linspace(0, alive, self._cells(i, length) + 1)
        return edges if alive == length else np.append(edges, np.linspace(alive, length, 3)[1:])

    def _cells(self, i, length):
        """Cells of arc i that resolve its oscillation, 0 where nothing swings."""
        cosine, sine, decay, bend = self.arcs.ring[i]
        if not (cosine or sine) or bend >= 0:
            return 0
        return math.ceil(alive_time(decay, length) * math.sqrt(decay**2 - bend) / TURN)

    def at(self, time):
        """(arc, u) at times [s] within the course."""
        i = np.clip(np.searchsorted(self.arcs.start, time, side="right") - 1, 0, len(self.arcs.start) - 1)
        return i, (time - self.arcs.start[i]) / self.arcs.span[i]

    def stretch(self, i, u):
        """e [m] and its rate [m/s] at places u of arcs i."""
        span, ring = self.arcs.span[i], self.arcs.ring[i].T
        cosine, sine, decay, bend = ring
        g0, g1 = _swings(decay, bend, span * u)
        poly = self.arcs.stretch[i]
        stretch = horner(poly, u) + cosine * g0 + sine * g1
        rate = horner(_slope(poly), u) / span + (sine - decay * cosine) * g0 + (bend * cosine - decay * sine) * g1
        return stretch, rate

    def far_end(self, i, u, order=0):
        """y or its derivative by time at places u of arcs i."""
        poly = self.arcs.law[i]
        for _ in range(order):
            poly = _slope(poly)
        return horner(poly, u) / self.arcs.span[i] ** order

    def force(self, i, u):
        """H [N] at places u of arcs i."""
        stretch, rate = self.stretch(i, u)
        return self._pulled(self.arcs.side[i], stretch) + self.spring.damping * rate

    def _pulled(self, side, stretch):
        taken = np.where(side != 0, stretch - side * self.spring.backlash / 2, 0.0)
        return self.spring.stiffness * taken

    def push(self, i, u):
        """S [N] of the end springs at places u of arcs i; where a cart stands at a plate no more than holds it."""
        ends, zone = self.spring.ends, self.arcs.zone[i]
        position = self.far_end(i, u) - self.stretch(i, u)[0]
        way = np.sign(zone)
        pressed = ends.length - np.where(way > 0, position, ends.stroke - position)
        held = np.clip(-way * self.force(i, u), 0.0, ends.preload)
        return way * np.where(np.abs(zone) == AT_NEAR, held, ends.preload + ends.stiffness * pressed)

    def motion(self, i, u):
        """Position, velocity, acceleration, jerk of the cart and what resists it [N], at places u of arcs i."""
        stretch, rate = self.stretch(i, u)
        slip, pull = self.arcs.slip[i], self.force(i, u) + self.push(i, u)
        velocity = np.where(slip != 0, self.far_end(i, u, 1) - rate, 0.0)
        force, rise, added, grows = self._met(slip, velocity)
        # R = F + M a up to a pace, and M at the pace beyond
        mass, most = self.spring.mass, _most(self.resistance.pace, slip * velocity)
        free = (pull - force) / (mass + added)
        inside = np.abs(free) <= most
        sign, held = np.sign(free), np.where(inside, 0.0, most)
        acceleration = np.where(inside, free, (pull - force - sign * added * held) / mass) * (slip != 0)
        resisted = np.where(slip != 0, force + added * np.where(inside, acceleration, sign * held), pull)
        beyond = sign * slip * (np.where(inside, 0.0, self.resistance.pace) * added + grows * held)
        rise = rise + np.where(inside, slip * grows * acceleration, beyond)
        stiffness = np.where(self.arcs.side[i] != 0, self.spring.stiffness, 0.0)
        pulls = stiffness * rate + self.spring.damping * (self.far_end(i, u, 2) - acceleration)
        pulls = pulls - np.where(np.abs(self.arcs.zone[i]) == NEAR, self.spring.ends.stiffness, 0.0) * velocity
        jerk = np.where(slip != 0, (pulls - rise * acceleration) / (mass + np.where(inside, added, 0.0)), 0.0)
        return self.far_end(i, u) - stretch, velocity, acceleration, jerk, resisted

    def _met(self, slip, velocity):
        """F, dF/dv, M and dM/d|v| on the side of the slip."""
        speed = slip * velocity
        there, back = ((table(speed), _rise(table, speed)) for table in self.resistance[:2])
        force, rise = (np.where(slip > 0, one, other) for one, other in zip(there, back, strict=True))
        if self.resistance.pace == 0:
            return force, slip * rise, 0.0, 0.0
        return force, slip * rise, self.resistance.added(speed), _rise(self.resistance.added, speed)

    def energy(self, state, place=0.0):
        """Energy of cart and springs [J] in a state, the far end at a place [m]."""
        ends, side = self.spring.ends, state.side
        pulled, position = float(self._pulled(side, state.stretch)), place - state.stretch
        pressed = max(ends.length - min(position, ends.stroke - position), 0.0) if ends.length else 0.0
        held = ends.preload * pressed + ends.stiffness / 2 * pressed**2
        return self.spring.mass / 2 * state.velocity**2 + pulled**2 / (2 * self.spring.stiffness) + held


def alive_time(decay, length):
    """Time [s] of a `length` [s] in which an oscillation of a decay [1/s] is above rounding."""
    return min(length, -math.log(ALIVE) / decay) if decay > 0 else length


def _most(pace, speed):
    """A |v|, without the product of an infinite pace and no speed."""
    return np.full(np.shape(speed), np.inf) if pace == np.inf else pace * speed


def _slope(poly):
    """Coefficients of the derivative by u, same shape."""
    slope = np.zeros_like(poly)
    slope[..., :-1] = poly[..., 1:] * np.arange(1, poly.shape[-1])
    return slope


def _rise(table, speed):
    """dF/d|v| of a table."""
    i = np.clip(np.searchsorted(table.breaks, speed, side="right") - 1, 0, len(table.coefficients) - 1)
    width = table.breaks[i + 1] - table.breaks[i]
    return horner(_slope(table.coefficients)[i], (speed - table.breaks[i]) / width) / width


def _swings(decay, bend, t):
    """g0, g1 of `ringing.swings`, arrays of one shape."""
    swing, growth = np.sqrt(np.abs(bend)), np.sqrt(np.maximum(bend, 0.0))
    safe = np.where(swing > 0, swing, 1.0)
    fall = np.exp(-decay * t)
    slow, fast = np.exp(-(decay - growth) * t), -np.expm1(-2 * growth * t)
    g0 = np.where(bend < 0, fall * np.cos(swing * t), slow * (1 - fast / 2))
    g1 = np.where(bend < 0, fall * np.sin(swing * t) / safe, slow * fast / (2 * safe))
    return np.where(bend == 0, fall, g0), np.where(bend == 0, fall * t, g1)
