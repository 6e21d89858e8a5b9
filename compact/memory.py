"""Resistance with a memory, cheap enough for an equation of motion: what a map of speeds lacks near a reversal.

    F(t) = F_ss(v) + k [m(t) - m_ss(v)]

F_ss is the map of steady speeds, m the resistance of a foundation of columns with the relaxation spectrum of the layer:
each column stands on its own, bears p >= 0 and relaxes in time wherever the roller is,

    p = w + sum s_i (w - z_i),    tau_i dz_i/dt = w - z_i,    w = (b^2 - x^2)/2R where p > 0, else p = 0.

The z_i are the internal variables: they stay with the mix, fade in time under the roller and recover behind it. Columns
are the limit of a layer thin against its contact; of any other layer they keep what matters, a contact of a length in
which the mix stays for a time 2b/|v| and the print that the roller meets on its way back. Modes of a contact of fixed
length in their place would pull at its rear end and know no print: they miss a reversal by a fifth of the force. Two
numbers, the half-length b and the stiffness k, are fitted to one transient, and what they miss of it is told: 1 to 6 %
of the peak. Other motions are met within 1 to 3 % where the map misses 15 to 30 %, and within 8 % in turns so sudden
that it misses 75 %. In steady motion the model is the map.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import minimize_scalar

from compact.imprint import Imprint, rolled
from compact.refuse import refuse_nonpositive
from compact.resistance import ResistanceMap, sampled

COLUMNS = 40  # per half-length, and steps of the way
INSTANTS = 10  # per shortest relaxation time
BESIDE = 1.5  # half-lengths to either side of the way that are told apart
CLOSE = 1e-3  # relative tolerance of the half-length
SHORTEST, LONGEST = 0.3, 3.0  # half-lengths tried, over sqrt(R delta)
MOST_INSTANTS = 1_000_000  # [-], of a motion; each takes some hundred bytes
ROUGH = 2001  # instants from which the way is measured
FORGETTING = 14.0  # times the slowest recovery: a millionth is left
FINE = 6  # times as many steps for a column that is passed
SLOW = 0.02  # half-lengths in the slowest recovery: below, m_ss is in proportion to the speed
STEADY = 3e-3  # of the largest m: tolerance of m_ss between speeds


@dataclass(frozen=True)
class Columns:
    """A foundation of columns: `radius` R, `half_length` b of the contact [m]; `branches` (share, time [s])."""

    radius: float
    half_length: float
    branches: tuple

    def __post_init__(self):
        refuse_nonpositive(radius=self.radius, half_length=self.half_length, branches=self.branches)

    @property
    def shares(self):
        return np.array(self.branches, dtype=float)[:, 0]

    @property
    def times(self):
        return np.array(self.branches, dtype=float)[:, 1]

    @property
    def slowest(self):
        """Time in which a free column recovers, at the latest [s]."""
        return self.times.max() * (1 + self.shares.sum())

    @property
    def spacing(self):
        """From column to column [m]."""
        return self.half_length / COLUMNS

    def resistance(self, time, position, speed=0.0):
        """m(t) [m2] at instants, shape (n,), of a roller at positions [m] that had a steady speed, or stood, before."""
        return rolled(self.imprint(position.min(), position.max(), position[0], speed), time, position)

    def imprint(self, low, high, start, speed=0.0):
        """The `Imprint` for ways from `low` to `high` of a roller at `start` [m] that had a steady speed, or stood."""
        spacing, reach = self.spacing, BESIDE * self.half_length
        place = np.arange(low - reach, high + reach + spacing, spacing)
        w, z = self._before(place - start, speed)
        return Imprint(self.radius, self.half_length, self.shares, self.times, float(place[0]), spacing, w, z)

    def steady(self, speed):
        """m_ss [m2] at a speed [m/s] > 0."""
        x, _, _, pressure = self._passage(speed)
        return float(-np.trapezoid(pressure * x, x) / self.radius)

    def _before(self, x, speed):
        """w and z at places x ahead of a roller in steady motion, or one that has stood for ever."""
        if speed == 0:
            w = np.maximum(self._depth(x), 0.0)
            return w, np.tile(w, (len(self.branches), 1))
        ahead, w, z, _ = self._passage(abs(speed))
        along = np.sign(speed) * x  # ahead of the roller falls towards its rear
        return np.interp(along, ahead[::-1], w[::-1]), np.array(
            [np.interp(along, ahead[::-1], each[::-1]) for each in z]
        )

    def _passage(self, speed):
        """x of one column that the roller passes, falling until all is forgotten, and its w, z and pressure."""
        near = np.linspace(BESIDE, -BESIDE, 2 * FINE * COLUMNS + 1) * self.half_length
        behind = FORGETTING * speed * self.slowest + 2 * BESIDE * self.half_length
        x = np.concatenate([near, -np.geomspace(BESIDE * self.half_length, behind, COLUMNS)[1:]])
        w, z, path = 0.0, np.zeros((len(self.branches), 1)), []
        for depth, step in zip(self._depth(x), -np.diff(x, prepend=x[0]) / speed, strict=True):
            w, z, pressure = self._stepped(w, z, depth, step)
            path.append((*w, *z[:, 0], *pressure))
        w, *z, pressure = np.array(path).T
        return x, w, np.array(z), pressure

    def _depth(self, x):
        return (self.half_length**2 - x**2) / (2 * self.radius)

    def _stepped(self, w, z, depth, step):
        """w, z and the pressure after a step, w linear in time: where p(w = depth) > 0 in contact, else free."""
        y = np.maximum(step, 1e-300) / self.times[:, None]
        new = np.where(y > 1e-8, 1 + np.expm1(-y) / np.maximum(y, 1e-8), y / 2)
        known = np.exp(-y) * z + (-np.expm1(-y) - new) * w
        stiff, held = 1 + self.shares @ (1 - new), self.shares @ known
        w = np.maximum(depth, held / stiff)
        return w, known + new * w, stiff * w - held


@dataclass(frozen=True, eq=False)
class Memory:
    """F = F_ss + k (m - m_ss), to be taken `along` a motion; called with a speed it is F_ss alone.

    steady : F_ss(velocity), odd, in N or in N/m;  stiffness : k, that unit over m2;  columns : `Columns`
    shape : m_ss R^2/b^4 over v/b [1/s], which all half-lengths share
    error : largest miss of the transient that it was fitted to, over its peak
    """

    steady: object
    stiffness: float
    columns: Columns
    shape: ResistanceMap
    error: float | None = None

    @property
    def odd(self):
        """Whether F_ss changes its sign with the velocity by construction."""
        return getattr(self.steady, "odd", False)

    def __call__(self, velocity, acceleration=0.0):
        return self.steady(velocity, acceleration)

    def over(self, time, position, velocity):
        """F at instants of a motion that was steady, or at rest, before the first of them, arrays of shape (n,)."""
        m = self.columns.resistance(time, position, float(velocity[0]))
        return self.steady(velocity) + self.stiffness * self.lacking(m, velocity)

    def lacking(self, m, velocity):
        """m - m_ss [m2]."""
        b, R = self.columns.half_length, self.columns.radius
        return m - self.shape(velocity / b) * b**4 / R**2

    @property
    def prompt(self):
        """What goes with the speed alone: F without k m, a `Prompt`."""
        return Prompt(self)

    def scaled(self, share):
        """The memory of a resistance that is so many times as large."""
        return replace(self, steady=self.steady.scaled(share), stiffness=share * self.stiffness)

    def settled(self, imprint, time, position):
        """Let the `Imprint` go along a cycle, from its start to its end, until all before is forgotten."""
        turns = 1 + int(np.ceil(FORGETTING * self.columns.slowest / (time[-1] - time[0])))
        times = np.append(time[0], (time[1:] + (time[-1] - time[0]) * np.arange(turns)[:, None]).ravel())
        return rolled(imprint, times, np.append(position[0], np.tile(position[1:], turns)))[1 - len(time) :]

    def along(self, motion):
        """The `Remembered` force over a motion; over a cycle with the memory of all the cycles before."""
        time = instants(motion.position, motion.duration, self.columns)
        position, velocity = motion.position(time), motion.velocity(time)
        if not hasattr(motion, "legs"):
            return Remembered(self, time, self.over(time, position, velocity))
        m = self.settled(self.columns.imprint(position.min(), position.max(), position[0]), time, position)
        lacking = self.lacking(np.append(m[-1], m), velocity)
        return Remembered(self, time, self.steady(velocity) + self.stiffness * lacking)


@dataclass(frozen=True, eq=False)
class Prompt:
    """F_ss - k m_ss of a `Memory` over velocities; `speeds`: where its cubics join."""

    memory: Memory

    def __call__(self, velocity, acceleration=0.0):
        memory = self.memory
        return memory.steady(velocity) + memory.stiffness * memory.lacking(0.0, velocity)

    @property
    def speeds(self):
        columns, steady = self.memory.shape.speeds * self.memory.columns.half_length, self.memory.steady
        return np.union1d(columns, getattr(steady, "speeds", ()))


@dataclass(frozen=True, eq=False)
class Remembered:
    """The force of a `Memory` along a motion: `of_time`; called with a speed, the map."""

    memory: Memory
    time: np.ndarray
    force: np.ndarray

    def of_time(self, time):
        """F at times [s] within the motion, of any shape."""
        return np.interp(time, self.time, self.force)

    def __call__(self, velocity, acceleration=0.0):
        return self.memory(velocity, acceleration)


def instants(position, duration, columns):
    """Times of a motion close enough for the way and for the relaxation, shape (n,)."""
    rough = np.linspace(0, duration, ROUGH)
    way = np.concatenate([[0], np.cumsum(np.abs(np.diff(position(rough))))])
    count = way * COLUMNS / columns.half_length + rough * INSTANTS / columns.times.min()
    if count[-1] > MOST_INSTANTS:
        raise ValueError(
            f"a mix that relaxes in {columns.times.min():g} s takes {count[-1]:.2g} instants over {duration:g} s, at "
            f"most {MOST_INSTANTS} are followed; give its `steady` resistance"
        )
    return np.interp(np.linspace(0, count[-1], int(np.ceil(count[-1])) + 1), count, rough)


def fitted(travelled, steady, roller, material):
    """The `Memory` whose half-length and stiffness fit one transient best, by least squares over time.

    travelled : of this roller over a layer of this Viscoelastic material, from steady motion or from rest
    steady : F_ss(velocity), of the same unit as its resistance; the model knows no speed beyond that of `travelled`
    """
    branches = getattr(material, "branches", ())
    if not branches:
        raise ValueError(f"`material` must be Viscoelastic to remember, got {material!r}")
    if roller.indentation is None:
        raise ValueError(f"a `roller` is fitted at an `indentation`, got `{roller.target[0]}`")
    hertz, fastest = np.sqrt(roller.radius * roller.indentation), float(np.abs(travelled.velocity).max())
    shape = _shape(branches, fastest / (SHORTEST * hertz))
    course = CubicHermiteSpline(travelled.time, travelled.position, travelled.velocity)
    weight, wanted = np.gradient(travelled.time), travelled.resistance - steady(travelled.velocity)

    def best(half_length):
        memory = Memory(steady, 1.0, Columns(roller.radius, half_length, branches), shape)
        time = instants(course, travelled.time[-1], memory.columns)
        m = memory.columns.resistance(time, course(time), float(travelled.velocity[0]))
        lacking = memory.lacking(np.interp(travelled.time, time, m), travelled.velocity)
        stiffness = float((weight * lacking) @ wanted / ((weight * lacking) @ lacking))
        return replace(memory, stiffness=stiffness), wanted - stiffness * lacking

    found = minimize_scalar(
        lambda half_length: weight @ best(half_length)[1] ** 2,
        bounds=(SHORTEST * hertz, LONGEST * hertz),
        method="bounded",
        options={"xatol": CLOSE * hertz},
    )
    memory, miss = best(float(found.x))
    return replace(memory, error=float(np.abs(miss).max() / np.abs(travelled.resistance).max()))


def _shape(branches, fastest):
    """m_ss of columns of b = R = 1 as a map over speeds up to a fastest one."""
    columns = Columns(1.0, 1.0, branches)
    slowest = min(SLOW / columns.slowest, fastest / 2)
    return sampled(lambda speed: (columns.steady(speed), None), slowest, fastest, STEADY)
