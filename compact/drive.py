"""Drives: what a motion asks of the drive of a cart against a resistance, its peaks, and the ranking of laws.

    drive force H = m a + resistance(v, a) + guide friction,  drive power = H v

`resistance` is any callable of velocity [m/s] and acceleration [m/s^2] that gives the force of the mix on all rollers
of one cart [N], odd in both. It is set-valued at rest; there the drive meets its limit from inside the motion.
"""

import itertools
import math
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from compact.cart import Balance, balance
from compact.refuse import refuse_nonpositive, refuse_unknown

POINTS = 129  # per piece of a motion, at Chebyshev's points: peaks and integrals of smooth laws to 1e-8
NEIGHBOURS = 3  # on each side of the largest sample, for the polynomial that finds the peak between samples
CREEP = 1e-12  # share of the peak velocity that stands for "just moving" at rest
TIE = 1e-9  # two values closer than this share a rank


@dataclass(frozen=True)
class Rigid:
    """A drive that imposes the law exactly and pushes along the travel (cam, rack)."""

    def rod_tangent(self, time, period):
        """tan(beta) of the rod at time [s]: none."""
        return np.zeros(np.shape(time))


@dataclass(frozen=True)
class Crank:
    """Crank and connecting rod in line with the pin; psi from the outer dead centre, uniform rotation.

        sin(beta) = (r/l) sin(psi),  x = r (1 - cos psi) + l (1 - cos beta)

    radius : r [m]; rod_length : l > r [m]. The crank pin is above the line on the way to the crank.
    """

    radius: float
    rod_length: float

    def __post_init__(self):
        refuse_nonpositive(radius=self.radius, rod_length=self.rod_length)
        if not self.rod_length > self.radius:
            raise ValueError(f"`rod_length` must exceed the crank radius {self.radius:g} m, got {self.rod_length!r}")

    def rod_angle(self, psi):
        """beta [rad] at crank angle psi [rad]."""
        return np.arcsin(self.radius / self.rod_length * np.sin(psi))

    def rod_tangent(self, time, period):
        """tan(beta) of the rod at time [s] from the outer dead centre."""
        return np.tan(self.rod_angle(2 * np.pi * np.asarray(time) / period))


@dataclass(frozen=True)
class Run:
    """One cycle of a cart under one law; arrays of shape (n,), pieces of the motion one after another.

    A join appears twice, with its values before and after. `weights` [s] integrate over the cycle. `impulses` are
    the jumps of velocity, `shocks` those of velocity or acceleration, as `Join`s of the motion.
    """

    name: str
    period: float
    time: np.ndarray
    weights: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    direction: np.ndarray
    resistance: np.ndarray
    rod_tangent: np.ndarray
    forces: Balance
    steady_force: float
    nonuniformity: float
    impulses: tuple
    shocks: tuple

    @property
    def drive_force(self):
        """H [N], along the travel."""
        return self.forces.drive_force

    @cached_property
    def drive_power(self):
        """H v [W]; negative where the cart drives the drive."""
        return self.drive_force * self.velocity

    @cached_property
    def peak_force(self):
        """Largest |H| [N]; infinite where the velocity jumps."""
        return math.inf if self.impulses else peak(self.time, self.drive_force)

    @cached_property
    def peak_power(self):
        """Largest |H v| [W]; infinite where the velocity jumps."""
        return math.inf if self.impulses else peak(self.time, self.drive_power)

    @cached_property
    def peak_jerk(self):
        """Largest |jerk| [m/s^3]; infinite where velocity or acceleration jumps."""
        return math.inf if self.shocks else peak(self.time, self.jerk)

    @cached_property
    def rms_force(self):
        """Root mean square of H over the cycle [N]; infinite where the velocity jumps."""
        return math.inf if self.impulses else math.sqrt(self._mean(self.drive_force**2))

    @cached_property
    def rms_power(self):
        """Root mean square of H v over the cycle [W]; infinite where the velocity jumps."""
        return math.inf if self.impulses else math.sqrt(self._mean(self.drive_power**2))

    @cached_property
    def mean_power(self):
        """Mean of H v over the cycle [W]."""
        return self._mean(self.drive_power)

    @cached_property
    def energy(self):
        """Net work of the drive over the cycle [J]: what resistance and friction took."""
        return self.mean_power * self.period

    @cached_property
    def drawn_energy(self):
        """Work given by a drive that cannot take back what the braking cart returns [J]."""
        return self._mean(np.maximum(self.drive_power, 0.0)) * self.period

    @property
    def dynamic_factor(self):
        """Peak force over the force that keeps the mean speed."""
        return self.peak_force / self.steady_force if self.steady_force else math.inf

    def _mean(self, values):
        return float(np.sum(self.weights * values) / self.period)


def simulate(cart, drive, motion, resistance, *, working=(1 / 6, 5 / 6)):
    """`Run` of one cycle with the law imposed exactly (inverse dynamics).

    Parameters
    ----------
    cart : Cart
    drive : Rigid or Crank
    motion : Motion (there and back without a dwell) or Cycle
    resistance : callable(velocity, acceleration) -> N, of all rollers of the cart
    working : shares of the pass between which the speed should be even, for `nonuniformity`

    Raises ValueError where the resistance is not finite, and where a crank is given another law than its own.
    """
    cycle = motion if hasattr(motion, "legs") else motion.cycle()
    samples = _sampled(cycle)
    _refuse_foreign_law(drive, cycle)
    creep = CREEP * max(np.abs(samples["velocity"]).max(), np.finfo(float).tiny)
    at_rest = np.abs(samples["velocity"]) < creep
    moving = np.where(at_rest, samples["direction"] * creep, samples["velocity"])
    met = _met(resistance, moving, samples["acceleration"])
    rod_tangent = drive.rod_tangent(samples["time"], cycle.period)
    forces = balance(cart, samples["acceleration"], met, np.sign(moving), rod_tangent)
    joins = cycle.joins()
    return Run(
        name=cycle.there.name,
        period=cycle.period,
        **samples,
        resistance=met,
        rod_tangent=rod_tangent,
        forces=forces,
        steady_force=_steady_force(cart, cycle.there, resistance),
        nonuniformity=_nonuniformity(cycle.there, working),
        impulses=tuple(join for join in joins if join.order == 1),
        shocks=tuple(join for join in joins if join.order <= 2),
    )


def _met(resistance, velocity, acceleration):
    met = np.broadcast_to(np.asarray(resistance(velocity, acceleration), float), velocity.shape)
    met = np.where(velocity == 0, 0.0, met)  # standing still asks nothing of the drive
    if not np.all(np.isfinite(met)):
        worst = int(np.flatnonzero(~np.isfinite(met))[0])
        raise ValueError(
            f"`resistance` must be finite, got {met[worst]} at velocity {velocity[worst]:g} m/s "
            f"and acceleration {acceleration[worst]:g} m/s^2"
        )
    return met


def _steady_force(cart, motion, resistance):
    mean_velocity = np.array(motion.stroke / motion.duration)
    steady = balance(cart, 0.0, _met(resistance, mean_velocity[None], np.zeros(1)), 1.0)
    return abs(float(steady.drive_force[0]))


def _nonuniformity(motion, working):
    """(v_max - v_min)/v_mean over the working part of the way there."""
    inside = motion.velocity(np.linspace(*working, 2001) * motion.duration)
    return float((inside.max() - inside.min()) / inside.mean())


def _refuse_foreign_law(drive, cycle):
    if isinstance(drive, Crank):
        psi = np.linspace(0, np.pi, 9)
        travel = drive.radius * (1 - np.cos(psi)) + drive.rod_length * (1 - np.cos(drive.rod_angle(psi)))
        gap = np.abs(cycle.there.position(psi / np.pi * cycle.there.duration) - travel).max()
        if gap > 1e-9 * cycle.there.stroke or cycle.period > 2 * cycle.there.duration:
            raise ValueError(
                f"a crank turns its own law only, got '{cycle.there.name}' that differs by {gap:g} m; "
                f"use Rigid(), or law('crank', ..., rod_length={drive.rod_length:g}) without dwells"
            )


def _sampled(cycle):
    """Motion at Chebyshev's points of every piece, ends included from inside, with Clenshaw-Curtis weights."""
    nodes, unit_weights = clenshaw_curtis(POINTS)
    columns = {name: [] for name in ("time", "weights", "position", "velocity", "acceleration", "jerk", "direction")}
    for leg in cycle.legs():
        for start, end in itertools.pairwise(leg.joined_at()):
            phase = np.clip(start + (end - start) * nodes, np.nextafter(start, end), np.nextafter(end, start))
            columns["time"].append(leg.start + leg.duration * phase)
            columns["weights"].append(leg.duration * (end - start) * unit_weights)
            for order, name in enumerate(("position", "velocity", "acceleration", "jerk")):
                columns[name].append(leg.at_phase(phase, order))
            columns["direction"].append(np.full(POINTS, float(leg.direction)))
    return {name: np.concatenate(parts) for name, parts in columns.items()}


def clenshaw_curtis(count):
    """Nodes on [0, 1], ends included, and weights of Clenshaw and Curtis' rule of odd `count`."""
    n = count - 1
    theta = np.pi * np.arange(count) / n
    k = np.arange(1, n // 2 + 1)
    factors = np.where(k == n // 2, 1.0, 2.0) / (4.0 * k**2 - 1)
    weights = (1 - np.cos(2 * np.outer(theta, k)) @ factors) / n
    weights[[0, -1]] /= 2
    return np.sin(theta / 2) ** 2, weights


def peak(time, values):
    """Largest |value| of samples at Chebyshev's points, piece after piece; between them by a local polynomial."""
    size = np.abs(values)
    best = int(np.argmax(size))
    inside = best % POINTS
    if inside in (0, POINTS - 1):
        return float(size[best])
    first = best - min(inside, NEIGHBOURS)
    last = best + min(POINTS - 1 - inside, NEIGHBOURS)
    near = np.polynomial.Polynomial.fit(time[first : last + 1], values[first : last + 1], last - first)
    return float(max(size[best], np.abs(near(np.linspace(time[best - 1], time[best + 1], 2001))).max()))


@dataclass(frozen=True)
class Criterion:
    """What laws may be ranked by: name, unit, and why it may be infinite."""

    unit: str
    infinite_because: str = ""


_JUMP = "the velocity jumps: an infinite force for no time"
CRITERIA = MappingProxyType(
    {
        "peak_force": Criterion("N", _JUMP),
        "peak_power": Criterion("W", _JUMP),
        "rms_force": Criterion("N", _JUMP),
        "rms_power": Criterion("W", _JUMP),
        "mean_power": Criterion("W"),
        "energy": Criterion("J"),
        "drawn_energy": Criterion("J"),
        "peak_jerk": Criterion("m/s^3", "the acceleration jumps"),
        "dynamic_factor": Criterion("1", _JUMP),
        "nonuniformity": Criterion("1"),
    }
)


@dataclass(frozen=True)
class Ranked:
    """A run's place: `rank` from 1, shared by ties; `margin` to the next worse value, relative; why it is infinite."""

    rank: int
    run: Run
    value: float
    margin: float
    reason: str


def rank(runs, by="peak_force"):
    """Runs in order of a criterion, least first, as a list of `Ranked`; ties share a rank, infinite values come last.

    The margin of the last finite value is infinite where worse ones follow, nan where none does.
    """
    refuse_unknown("criterion", by, tuple(CRITERIA))
    ordered = sorted(((getattr(run, by), run) for run in runs), key=lambda pair: pair[0])
    places = []
    for i, (value, run) in enumerate(ordered):
        tied = bool(places) and _tie(value, places[-1].value)
        worse = [other for other, _ in ordered[i:] if not _tie(value, other)]
        margin = (worse[0] - value) / value if worse and 0 < value < math.inf else math.nan
        place = places[-1].rank if tied else i + 1
        reason = CRITERIA[by].infinite_because if value == math.inf else ""
        places.append(Ranked(place, run, value, margin, reason))
    return places


def _tie(a, b):
    return a == b or (math.isfinite(a - b) and abs(a - b) <= TIE * max(abs(a), abs(b)))
