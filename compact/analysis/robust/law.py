"""Robust motion law: the law with the least worst peak of drive force or power over a range of drives and resistances.

    minimise over laws  max over drives i  max over t  |H_i(t)|  or  |H_i(t) y'(t)|

Each drive is an elastic drive of the range with one of the resistances, simulated with sticking and memory
(`drive_pool`). Linear programs around the histories of the worst drives give a direction (`program`); a
part of the way is taken without a test, since the worst peak rises before it falls, and the best law by simulation is
kept. A trust region with slopes by differences follows; a slope is kept while it predicts the gain. Drives that were
not in the pool then judge the law. A resonance is a few percent of the stiffness wide: with each resistance it is
sought about the worst drive. While one exceeds the worst peak told, the worst ones join the pool.

The number is that of simulations; the duality gap is that of the linear programs. The law holds in its range alone:
outside it the peak rises steeply, so that the range belongs to the number.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import qmc

from compact.analysis.robust.drive_pool import DrivePool, PassTable, pass_table, travel_table
from compact.analysis.robust.program import LawSpace, ProgramStep, Row
from compact.machine.cart import Cart, Resistance
from compact.motion.laws import LAWS
from compact.motion.limits import Limits
from compact.motion.profile import MotionProfile, law
from compact.numerics import Array, IntArray
from compact.numerics.validation import require_fields, require_known, require_positive

ROBUST_OBJECTIVES = ("robust_peak_force", "robust_peak_power")
# Stiffnesses of a pool at each damping ratio: the least damped decide, with sharp worst stiffnesses
STIFFNESSES = (80, 40, 24, 16, 12)
POOL = 600  # [-], drives of a search over all resistances, about; with many resistances each takes fewer stiffnesses
FIRST_DRIVES, MORE_DRIVES, MOST_DRIVES = 12, 6, 60  # [-], of a program: at the start, of each step, at most
SEARCH_STEPS, POLISH_STEPS = 32, 8  # [-], programs without a test, and of the trust region
MOVE, LATE_MOVE = 0.4, 0.13  # [-], of the way to the optimum of a program; in the last third
POLISH_DRIVES = 24  # [-], worst ones, whose slopes are those of differences
HIGH = 0.7  # [-], of the worst peak; drives below it do not judge the steps of a trust region
DIFFERENCE = 2e-3  # [-], of the largest unknown
FIRST_RADIUS = 0.05  # [-], of the largest unknown: trust region
SHRINKS = 4  # [-], of the trust region in one step
LEAST_GAIN = 1e-3  # [-], of the worst peak, below which the trust region ends
FRESH_DRIVES, FRESH_SEED = 1000, 1  # [-], of a round
OTHER_DAMPING = 4  # [-], one fresh drive of so many is not least damped
FRESH_TOLERANCE = 0.01  # [-], by which a fresh drive may exceed the pool; half of what is promised
FRESH_ROUNDS = 6  # [-], in which fresh drives join the pool
SUSPECTS = 300  # [-], known drives that judge with fresh ones that exceed the pool
NEAR = np.exp(np.linspace(-0.075, 0.075, 11))  # [-], stiffnesses over that of a drive whose resonance is sought
JOINING = 80  # [-], worst drives of a round that join the pool
INNER = 64  # [-], points inside a range of resistances, with which fresh drives judge
BOUNDING = 20  # [-], one drive of so many bounds the worst peak of a published law from below
GAIN = 0.97  # [-], of the worst peak of the best published law; a law above gains nothing


@dataclass(frozen=True)
class PlantRange:
    """Range of a plant: elastic drives, log-uniform, and resistances.

    Parameters
    ----------
    stiffness : tuple of float
        Least and largest k [N/m], > 0.
    damping_ratio : tuple of float
        Least and largest c/(2 sqrt(k m)) [-], > 0.
    resistances : sequence of callable
        Force of the mix [N]: samples of what is unknown, such as the corners and the centre of force and distance of
        fresh mix. Each is a `StrokeResistance` of equal headings, or a resistance as of `simulate_elastic`.
    inner : sequence of callable
        Resistances between the samples, with which fresh drives judge the law; see `between`.
    """

    stiffness: tuple[float, float]
    damping_ratio: tuple[float, float]
    resistances: Sequence[Resistance]
    inner: Sequence[Resistance] = ()

    def __post_init__(self) -> None:
        require_fields(self, positive="stiffness damping_ratio")

    def grid(self, counts: Sequence[int] = STIFFNESSES) -> Array:
        """Return (k, damping ratio), shape (drives, 2): a number of stiffnesses at each of even damping ratios."""
        ratios = np.geomspace(*self.damping_ratio, len(counts))
        columns = zip(counts, ratios, strict=True)
        grid = [np.column_stack([np.geomspace(*self.stiffness, n), np.full(n, z)]) for n, z in columns]
        return np.unique(np.concatenate(grid), axis=0)  # a known value counts once


@dataclass(frozen=True)
class Effort:
    """Size of a search.

    Attributes
    ----------
    counts : tuple of int
        Stiffnesses of the pool at each of even damping ratios from the least.
    steps, polish : int
        Linear programs of the search, and of the trust region.
    published : tuple of str
        Names of `LAWS` to compare with; those with a jump of the velocity are left out.
    """

    counts: tuple[int, ...] = STIFFNESSES
    steps: int = SEARCH_STEPS
    polish: int = POLISH_STEPS
    published: tuple[str, ...] = tuple(name for name in LAWS if name != "crank")


@dataclass(frozen=True)
class WorstDrive:
    """Largest peak of a law and where it is.

    Attributes
    ----------
    peak : float
        Peak drive force [N] or power [W].
    stiffness, damping_ratio : float
        k [N/m] and damping ratio [-].
    resistance : int
        Index of the resistance; the inner ones follow the samples.
    """

    peak: float
    stiffness: float
    damping_ratio: float
    resistance: int


@dataclass(frozen=True)
class RobustLaw:
    """A robust law and what it was judged by.

    Attributes
    ----------
    motion : MotionProfile
        The law.
    objective : str
        One of `ROBUST_OBJECTIVES`.
    worst : WorstDrive
        Over pool, grid and fresh drives, with all resistances.
    mean : float
        Mean peak over the same drives [N] or [W].
    plants : PlantRange
        Range in which it holds; outside it the peak rises steeply.
    gap : float
        Largest duality gap of the linear programs [-].
    published : str
        The published law with the least worst peak over the same drives.
    published_worst : WorstDrive
        Its worst peak.
    drives : int
        Number of drives that judged both.
    """

    motion: MotionProfile
    objective: str
    worst: WorstDrive
    mean: float
    plants: PlantRange
    gap: float
    published: str
    published_worst: WorstDrive
    drives: int

    @property
    def ratio(self) -> float:
        """Worst peak over that of the best published law [-]."""
        return self.worst.peak / self.published_worst.peak

    @property
    def worst_resistance(self) -> Resistance:
        """Resistance of the worst drive."""
        return (*self.plants.resistances, *self.plants.inner)[self.worst.resistance]

    @property
    def gains(self) -> bool:
        """True if the worst peak is below that of the best published law by more than the search scatters."""
        return self.ratio < GAIN


def robust_law(
    cart: Cart,
    plants: PlantRange,
    stroke: float,
    duration: float,
    limits: Limits,
    *,
    objective: str = "robust_peak_force",
    effort: Effort | None = None,
) -> RobustLaw:
    """Find the motion law with the least worst peak over a range of drives and resistances.

    Parameters
    ----------
    cart : Cart
        Cart of mass > 0, without end springs.
    plants : PlantRange
        Drives and resistances.
    stroke, duration : float
        Travel [m] and time [s] of one pass; the return stroke is its mirror image, without dwells.
    limits : Limits
        Limits of the law; the acceleration is continuous, also through the turn.
    objective : str
        "robust_peak_force" or "robust_peak_power".
    effort : Effort, optional
        Size of the search; a minute by default.

    Returns
    -------
    RobustLaw

    Raises
    ------
    InfeasibleError
        If no law satisfies the limits.
    """
    require_known("objective", objective, ROBUST_OBJECTIVES)
    require_positive(mass=cart.mass, stroke=stroke, duration=duration)
    if cart.end_springs is not None:
        raise ValueError("`cart` must have no end springs, whose force is no part of the programs")
    effort = effort or Effort()
    space = LawSpace(limits, stroke, duration, cart.mass)
    fastest = float(space.table(space.start).velocity.max())
    samples = len(plants.resistances)
    tables = tuple(travel_table(cart, each, stroke, fastest) for each in (*plants.resistances, *plants.inner))
    counts = [math.ceil(min(1.0, POOL / (sum(effort.counts) * samples)) * count) for count in effort.counts]
    search = _Search(space, DrivePool.of(cart.mass, plants.grid(counts), tables, range(samples)))
    search.descend(effort.steps - effort.steps // 3, MOVE)
    search.descend(effort.steps // 3, LATE_MOVE)
    if objective == "robust_peak_power":
        search.power = True  # `polish` finds that of the best law
    search.polish(effort.polish)
    judges = DrivePool.of(cart.mass, plants.grid(effort.counts), tables, range(samples))
    judges, peaks = _face_fresh_drives(search, plants, judges, effort.polish // 2)
    name, rivals = _best_published(search, judges, effort.published)
    motion = space.motion(search.best, objective.replace("_", "-"))
    worst, rival = _worst_of(judges, peaks), _worst_of(judges, rivals)
    return RobustLaw(motion, objective, worst, float(peaks.mean()), plants, search.gap, name, rival, len(peaks))


def between(low: ArrayLike, high: ArrayLike, count: int = INNER) -> Array:
    """Return points that fill a box evenly, shape (count, dimensions), always the same ones.

    Examples
    --------
    >>> between([0.9, 0.10], [1.1, 0.12], 2).round(4).tolist()
    [[1.0, 0.1067], [0.95, 0.1133]]
    """
    ends = np.asarray(low, float), np.asarray(high, float)
    shares = qmc.Halton(len(ends[0]), scramble=False).fast_forward(1).random(count)
    return np.asarray(ends[0] + shares * (ends[1] - ends[0]))


def _face_fresh_drives(
    search: "_Search", plants: PlantRange, judges: DrivePool, polish: int
) -> tuple[DrivePool, Array]:
    """Let drives that are not in the pool judge the law; the worst of them join it. All judges and their peaks.

    While fresh drives exceed the peak of the pool, only the worst known ones judge the next law.
    """
    random = np.random.default_rng(FRESH_SEED)
    peaks, states = search.judge(search.space.table(search.best), judges)
    for _ in range(FRESH_ROUNDS):
        fresh, table = _fresh_drives(plants, judges, random), search.space.table(search.best)
        found, others = search.judge(table, fresh)
        limit = search.value * (1 + FRESH_TOLERANCE)
        which = _falling(peaks)[: len(peaks) if found.max() <= limit else SUSPECTS]
        peaks[which], states[which] = search.judge(table, judges.take(which), states[which])
        judges, states, peaks = judges.joined(fresh), np.concatenate([states, others]), np.concatenate([peaks, found])
        near = _neighbours(plants, judges, peaks)
        found, others = search.judge(table, near)
        tops = np.arange(0, len(found), len(NEAR)) + np.argmax(found.reshape(-1, len(NEAR)), axis=1)
        judges, states = judges.joined(near.take(tops)), np.concatenate([states, others[tops]])
        peaks = np.concatenate([peaks, found[tops]])
        if peaks.max() <= limit:
            return judges, peaks
        inside = set(map(tuple, search.drives.drives.tolist()))
        outside = [i for i in _falling(peaks) if tuple(judges.drives[i].tolist()) not in inside]
        search.drives = search.drives.joined(judges.take(outside[:JOINING]))
        search.polish(polish)
    return judges, search.judge(search.space.table(search.best), judges, states)[0]


def _fresh_drives(plants: PlantRange, pool: DrivePool, random: np.random.Generator) -> DrivePool:
    """Drives of a range with the resistances of a pool, one at random in each of even parts of the stiffnesses."""
    resistances = len(pool.tables)
    parts = math.ceil(FRESH_DRIVES / resistances)
    shares = random.uniform(size=(2, resistances, parts))
    shares[0] = (shares[0] + np.arange(parts)) / parts
    shares[1, :, np.arange(parts) % OTHER_DAMPING > 0] = 0.0  # the least damped decide, and no random one is
    ranges = zip((plants.stiffness, plants.damping_ratio), shares, strict=True)
    columns = [(low * (high / low) ** share).ravel() for (low, high), share in ranges]
    return pool._replace(drives=np.column_stack([*columns, np.repeat(np.arange(resistances), parts)]))


def _neighbours(plants: PlantRange, judges: DrivePool, peaks: Array) -> DrivePool:
    """Drives of a range with stiffnesses near that of the worst judge with each of the resistances, in turn."""
    order = _falling(peaks)
    _, first = np.unique(judges.drives[order, 2], return_index=True)
    near = judges.take(np.repeat(order[first], len(NEAR)))
    near.drives[:, 0] = np.clip(near.drives[:, 0] * np.tile(NEAR, len(first)), *plants.stiffness)
    return near


def _falling(peaks: Array) -> IntArray:
    """Places of peaks from the largest; equal ones in their order."""
    return np.argsort(-peaks, kind="stable")


def _worst_of(pool: DrivePool, peaks: Array) -> WorstDrive:
    """Drive of a pool with the largest peak."""
    i = int(np.argmax(peaks))
    stiffness, ratio, which = pool.drives[i].tolist()
    return WorstDrive(float(peaks[i]), stiffness, ratio, int(which))


@dataclass
class _Search:
    """Search for a robust law: the pool, the drives of the program, and the best law by simulation."""

    space: LawSpace
    drives: DrivePool
    power: bool = False
    best: Array = field(init=False)
    value: float = np.inf
    gap: float = 0.0
    _program: list[int] = field(default_factory=list)
    _rows: set[Row] = field(default_factory=set)
    _responses: dict[tuple[float, float], Array] = field(default_factory=dict)
    _slopes: dict[int, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.best = self.space.start

    def histories(self, drives: DrivePool, table: PassTable, states: Array | None = None) -> tuple[Array, Array]:
        """H or H y' of each drive, and its states, a start for a similar law."""
        forces = drives.simulate(table, states)
        return forces.powers(table) if self.power else forces.forces, forces.states

    def judge(self, table: PassTable, drives: DrivePool, states: Array | None = None) -> tuple[Array, Array]:
        """Peak of a law on each of some drives, and the states of the drives."""
        histories, states = self.histories(drives, table, states)
        return np.abs(histories).max(axis=1), states

    def descend(self, steps: int, move: float) -> None:
        """Move a part of the way to the optimum of each program, without a test; the best law is kept."""
        unknowns, states = self.best, None
        for step in range(steps + 1):
            histories, states = self.histories(self.drives, self.space.table(unknowns), states)
            peaks = np.abs(histories).max(axis=1)
            if peaks.max() < self.value:
                self.best, self.value = unknowns, float(peaks.max())
            if step < steps:
                drives = self._choose(peaks)
                slopes = [self._response(i) for i in drives]
                unknowns = unknowns + move * self._solve(unknowns, drives, histories, slopes).change

    def polish(self, steps: int) -> None:
        """Move within a trust region with slopes by differences of simulations, while the worst peak falls."""
        histories, states = self.histories(self.drives, self.space.table(self.best))
        radius, peaks = FIRST_RADIUS * float(np.abs(self.best).max()), np.abs(histories).max(axis=1)
        self._rows, self.value, high = set(), float(peaks.max()), np.flatnonzero(peaks > HIGH * peaks.max())
        for _ in range(steps):
            before, order = self.value, _falling(np.abs(histories).max(axis=1))
            drives = order[:MOST_DRIVES].tolist()
            highest, lower = drives[:POLISH_DRIVES], [] if self.power else drives[POLISH_DRIVES:]
            fresh = [i for i in highest if i not in self._slopes]
            self._slopes.update(zip(fresh, self._differences(fresh, histories, states), strict=True))
            slopes = [self._slopes[i] for i in highest] + [self._response(i) for i in lower]  # resistance frozen
            for _ in range(SHRINKS):
                step = self._solve(self.best, highest + lower, histories, slopes, radius)
                histories, states = self._try(self.best + step.change, highest + lower, high, histories, states)
                if self.value < before:
                    break
                radius /= 3.0
            if self.value < before - (before - step.value) / 2:
                radius *= 2.0
            else:  # the slopes have become wrong
                self._slopes.clear()
            if self.value > before * (1 - LEAST_GAIN) and fresh == highest:
                return

    def _try(
        self, unknowns: Array, first: list[int], then: IntArray, histories: Array, states: Array
    ) -> tuple[Array, Array]:
        """Keep a law whose worst peak is lower on some drives, first, and on others then; histories and states."""
        table = self.space.table(unknowns)
        for which in (np.array(first), then):
            moved, there = self.histories(self.drives.take(which), table, states[which])
            if (value := float(np.abs(moved).max())) >= self.value:
                return histories, states
        self.best, self.value, histories, states = unknowns, value, histories.copy(), states.copy()
        histories[then], states[then] = moved, there
        return histories, states

    def _choose(self, peaks: Array) -> list[int]:
        """Drives of the next program: those of the last one and the worst others."""
        others = [i for i in _falling(peaks).tolist() if i not in set(self._program)]
        self._program += others[: MORE_DRIVES if self._program else FIRST_DRIVES]
        self._program = sorted(self._program, key=lambda i: -peaks[i])[:MOST_DRIVES]
        return self._program

    def _response(self, i: int) -> Array:
        """Slopes of H of a drive, its resistance frozen."""
        spring = float(self.drives.drives[i, 0]), float(self.drives.damping[i])
        if spring not in self._responses:
            self._responses[spring] = np.tile(self.space.response(*spring), (self.drives.sides, 1))
        return self._responses[spring]

    def _differences(self, drives: list[int], histories: Array, states: Array) -> Array:
        """Slopes of the histories of some drives by differences of simulations, within the equalities."""
        chosen, states = self.drives.take(drives), states[drives]
        directions, size = self.space.free_directions, DIFFERENCE * float(np.abs(self.best).max())
        changes = []
        for direction in directions.T:
            moved, _ = self.histories(chosen, self.space.table(self.best + size * direction), states)
            changes.append((moved - histories[drives]) / size)
        return np.moveaxis(np.array(changes), 0, -1) @ directions.T

    def _solve(
        self, unknowns: Array, drives: list[int], histories: Array, slopes: list[Array], radius: float = np.inf
    ) -> ProgramStep:
        """Solve the program of some drives; rows that bind are kept by the number of the drive."""
        place = {drive: i for i, drive in enumerate(drives)}
        rows = {(place[drive], t, sign) for drive, t, sign in self._rows if drive in place}
        step = self.space.minimise(unknowns, histories[drives], slopes, rows, radius)
        self._rows = {(drives[i], t, sign) for i, t, sign in step.rows}
        self.gap = max(self.gap, step.gap)
        return step


def _best_published(search: _Search, drives: DrivePool, names: Sequence[str]) -> tuple[str, Array]:
    """Name and peaks of the published law with the least worst peak; a part of the drives bounds each from below."""
    laws = [law(name, search.space.stroke, search.space.duration) for name in names]
    tables = {each.name: pass_table(each) for each in laws if each.smoothness() >= 1}
    some = drives.take(np.arange(0, len(drives.drives), BOUNDING))
    bounds = {name: search.judge(table, some)[0].max() for name, table in tables.items()}
    best, peaks, order = "", np.array([np.inf]), np.arange(len(drives.drives))
    for name in sorted(bounds, key=lambda name: bounds[name]):
        found, parts = np.zeros(len(order)), iter(np.array_split(order, min(BOUNDING, len(order))))
        while max(bounds[name], found.max()) < peaks.max() and (part := next(parts, None)) is not None:
            found[part] = search.judge(tables[name], drives.take(part))[0]
        if max(bounds[name], found.max()) < peaks.max():
            # drives that are hard on one law are hard on others
            best, peaks, order = name, found, _falling(found)
    return best, peaks
