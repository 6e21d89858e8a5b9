"""Motion laws that ask least of a drive against a resistance, by sequential linear or quadratic programs.

    least  J = sum_j w_j J_j  of H = m a + R(v, a) and P = H v,  the worst over samples of R, or a quantile

The law is a spline (`lawspace`) within linear limits (`limits`); `criteria` has the J_j and their tangents. A step goes
where the tangents are least, inside a trust region; it is taken only where J itself falls, else the region shrinks.

The result tells its `gap`: by how much the tangents at the result would let *any* law within the limits do better,
relative. Where H is linear in v and a and no power is asked for, J is convex, its tangents bound it from below, and the
gap is a duality gap: no law of the space is better by more. Elsewhere it measures how stationary the result is.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy import sparse

from compact.motion.limits import MARGIN, Conflict, ConstraintSet, InfeasibleError, space_of
from compact.motion.objectives import OBJECTIVES, PEAKS, Nodes, state
from compact.numerics.convex_programs import LinearConstraints, minimise_linear, minimise_quadratic

PIECES = {1: 128, 2: 64, 3: 48}  # of a law in C1, C2, C3: the doubling before gains about 1e-3, 1e-4, 1e-4
PIECES_OF_A_CAM = 64  # its bounds are on the travel, which depends on all unknowns before it
PIECES_OF_A_PROFILE = 48  # of a roller's cam, which takes steps where others take none; the doubling gains 1e-3
NODES = np.array([0.0, (1 - (3 / 7) ** 0.5) / 2, 0.5, (1 + (3 / 7) ** 0.5) / 2, 1.0])  # Lobatto's, ends included
WEIGHTS = np.array([9.0, 49.0, 64.0, 49.0, 9.0]) / 180
FINE = 33  # places of a piece where peaks are looked for between the nodes
HIGHER = 1e-5  # relative, by which a peak between nodes is missed
ROUNDS = 8  # of adding such peaks to the nodes: 2 to 4 are taken
COARSEST = 16  # pieces to begin with, or some more, halved until there are as many as asked
MOST = 60  # steps on one set of pieces
STATIONARY = 1e-5  # largest gap of a result
CLOSED = 1e-9  # fall, relative, that is no more worth a step
SMALLEST = 1e-9  # share of the unknowns' size below which the trust region holds nothing
NEAR = 1e-6  # of the worst sample, relative, within which others lend their curvature
PRICE = 10.0  # of a curvature twice the allowed, in J of the first law; ten times that while it does not suffice
LITTLE = 1e-4  # relative, of a radius that is no more worth a search
DEAREST = 1e5  # times J
TAKEN, POOR, GOOD = 0.02, 0.25, 0.75  # of the promised fall: a step is taken, the region shrinks, the region grows


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked: weights of criteria by name, mass [kg], samples of the resistance, limits held on a space.

    `least` is what J of each sample is counted in, 1 for all but in a search of least regret; `more` are phases beside
    the nodes that peaks are watched at.
    """

    held: ConstraintSet
    weights: dict
    mass: float
    resistances: tuple[Callable, ...]
    quantile: float = 1.0
    least: tuple[float, ...] = ()
    more: tuple[float, ...] = ()
    price: float = 1.0

    @cached_property
    def nodes(self):
        """`Nodes` of every piece, and `more` phases that peaks are watched at."""
        space, weights = self.held.space, np.outer(np.diff(self.held.space.breaks), WEIGHTS).ravel()
        rows = (np.concatenate([space.values(k, NODES), space.rows_at(k, np.array(self.more))]) for k in range(3))
        return self._nodes(*rows, np.append(weights, np.zeros(len(self.more))))

    @cached_property
    def _fine(self):
        space = self.held.space
        rows = (space.values(k, np.linspace(0, 1, FINE)) for k in range(3))
        return self._nodes(*rows, np.repeat(np.diff(space.breaks), FINE) / FINE)

    def _nodes(self, place, speed, change, weights):
        held, mean = self.held, self.held.stroke / self.held.duration
        return Nodes(held.stroke * place, mean * speed, mean / held.duration * change, held.duration * weights, mean)

    def between(self, unknowns):
        """Phases where a peak is higher between the nodes than at any of them, the highest of each piece.

        A peak is that of the parabola through three of the `FINE` places.
        """
        found, space = [], self.held.space
        watched = (self._watched(nodes, unknowns) for nodes in (self._fine, self.nodes))
        for (fine, least), (coarse, _) in zip(*watched, strict=True):
            values = fine.reshape(-1, FINE)
            left, top, right = values[:, :-2], values[:, 1:-1], values[:, 2:]
            bend, tilt = 2 * top - left - right, right - left
            bend[(top < left) | (top < right) | (bend <= 0)] = np.inf
            tops = np.where(np.isfinite(bend), top + tilt**2 / (8 * bend), 0.0)
            pieces, i = np.arange(len(tops)), tops.argmax(axis=1)
            high = tops[pieces, i] > max(coarse.max(), least) * (1 + HIGHER)
            u = (i + 1 + (tilt / (2 * bend))[pieces, i]) / (FINE - 1)
            found += list((space.breaks[:-1] + np.diff(space.breaks) * u)[high])
        return tuple(found)

    def _watched(self, nodes, unknowns):
        """(values of shape (nodes,), least that counts) of what peaks are looked for in."""
        peaks = [PEAKS[name] for name in self.weights if name in PEAKS]
        for resistance in self.resistances if peaks else ():
            here = state(nodes, unknowns, self.mass, resistance)
            yield from ((np.abs(peak(here)), 0.0) for peak in peaks)
        if self.held.pitch:
            yield from ((row, 1 - MARGIN) for row in self.held.pitch.crowded(nodes, unknowns))

    def tangents(self, unknowns):
        """`Tangent`s of every criterion, a list for each sample of the resistance."""
        states = [state(self.nodes, unknowns, self.mass, resistance) for resistance in self.resistances]
        found = [[OBJECTIVES[name](one) for name in self.weights] for one in states]
        if pitch := self.held.pitch:
            crowding = (pitch.excess if self.weights else pitch.tangent)(self.nodes, unknowns)
            found = [[*of_sample, crowding] for of_sample in found]
        return found

    def value(self, unknowns):
        """J of a law."""
        return self.kept(self.tangents(unknowns))[1]

    def weights_of(self, k):
        """Weights of the criteria against sample k."""
        weights = [weight / (self.least[k] if self.least else 1.0) for weight in self.weights.values()]
        return [*weights, self.price] if self.held.pitch else weights

    def kept(self, tangents):
        """(samples that the quantile counts, those of least J; the value of the worst of them)."""
        weights = [self.weights_of(k) for k in range(len(tangents))]
        sums = [sum(w * t.value for w, t in zip(*pair, strict=True)) for pair in zip(weights, tangents, strict=True)]
        order = np.argsort(sums, kind="stable")[: max(1, int(np.ceil(self.quantile * len(sums) - 1e-9)))]
        return order, sums[order[-1]]


class _Model:
    """The tangents of a task about a law as a program: changes d, the top T that is made least, parts >= 0 of it."""

    def __init__(self, task, unknowns, tangents):
        self.size = len(unknowns)
        self.rows, self.values, self.entries, self.height = [], [], [], 0
        self.width = self.size + 1
        kept, worst = task.kept(tangents)
        self.scale = abs(worst) or 1.0
        weights = {k: [weight / self.scale for weight in task.weights_of(k)] for k in kept}
        for k in kept:
            tops = [self._top(tangent, weight) for tangent, weight in zip(tangents[k], weights[k], strict=True)]
            self._below(np.zeros((1, self.size)), [0.0], [(0, top, 1.0) for top in tops] + [(0, self.size, -1.0)])
        self.curvature = self._bend(tangents, kept, weights)
        self.program = self._with_limits(task.held.program, unknowns)

    def _below(self, rows, values, entries):
        """rows d + entries of the other unknowns <= values."""
        self.rows.append(rows)
        self.values.append(values)
        self.entries += [(self.height + row, column, value) for row, column, value in entries]
        self.height += len(values)

    def _new(self, count):
        self.width += count
        return range(self.width - count, self.width)

    def _top(self, tangent, weight):
        """A new unknown that is not less than a weighted tangent."""
        (top,), count = self._new(1), len(tangent.values)
        if tangent.shares is None:
            self._below(weight * tangent.rows, -weight * tangent.values, [(i, top, -1.0) for i in range(count)])
            return top
        parts = self._new(count)
        nothing = np.zeros((count, self.size))
        self._below(weight * tangent.rows, -weight * tangent.values, [(i, part, -1.0) for i, part in enumerate(parts)])
        self._below(nothing, np.zeros(count), [(i, part, -1.0) for i, part in enumerate(parts)])
        shared = [(0, part, share) for part, share in zip(parts, tangent.shares, strict=True)]
        self._below(nothing[:1], [0.0], [*shared, (0, top, -1.0)])
        return top

    def _bend(self, tangents, kept, weights):
        """Mean curvature of the samples that are about as bad as the worst."""
        near = [k for k in kept if sum(w * t.value for w, t in zip(weights[k], tangents[k], strict=True)) > 1 - NEAR]
        bends = [
            weight * tangent.curvature / max(len(near), 1)
            for k in near
            for tangent, weight in zip(tangents[k], weights[k], strict=True)
            if tangent.curvature is not None
        ]
        return sum(bends) if bends else None

    def _with_limits(self, limits, unknowns):
        more = self.width - self.size
        entries = np.array(self.entries).T
        right = sparse.coo_array((entries[2], entries[:2].astype(int)), shape=(self.height, self.width))
        left = sparse.csr_array(np.concatenate(self.rows))
        left.resize((self.height, self.width))
        wide = limits.inequality_matrix.copy()
        wide.resize((wide.shape[0], self.width))
        room = limits.inequality_bounds - limits.inequality_matrix @ unknowns
        return LinearConstraints(
            np.column_stack([limits.equality_matrix, np.zeros((len(limits.equality_matrix), more))]),
            limits.equality_values - limits.equality_matrix @ unknowns,
            sparse.csr_array(sparse.vstack([wide, left + right])),
            np.concatenate([room, *self.values]),
        )

    def least(self, radius=np.inf, curved=True):
        """(change of the unknowns, none by more than the radius; J that the tangents promise after it)."""
        cost = np.zeros(self.width)
        cost[self.size] = 1.0
        box = np.full(self.width, np.inf)
        box[: self.size] = radius
        if self.curvature is None or not curved:
            found = minimise_linear(cost, self.program, box)
            if found is None:
                raise RuntimeError("HiGHS finds no law within limits that the law before kept")
            return found[: self.size], self.scale * found[self.size]
        curvature = np.zeros((self.width, self.width))
        curvature[: self.size, : self.size] = self.curvature
        found = minimise_quadratic(curvature, cost, self.program, box)
        change = found[: self.size]
        return change, self.scale * (found[self.size] + change @ self.curvature @ change / 2)


class Optimum(NamedTuple):
    """The curve s(z), a PPoly, and how it was found.

    value : the criterion; peaks between the nodes are met to 3e-4, of laws without a near jump to 1e-5
    gap : what the tangents would let any law do better, relative
    refinement : what the last doubling of pieces gained, relative, or nan
    steps : convex steps taken
    """

    curve: object
    value: float
    gap: float
    refinement: float
    steps: int


def search(task, unknowns):
    """(unknowns, J, steps): sequential convex steps from a law within the limits to one that is stationary.

    Raises RuntimeError, with the gap reached, after `MOST` steps.
    """
    radius, tangents = np.inf, task.tangents(unknowns)
    value = task.kept(tangents)[1]
    if value == 0:
        raise ValueError("every law asks for nothing: give a mass or a resistance that the criterion meets")
    for steps in range(MOST):
        model = _Model(task, unknowns, tangents)
        while True:
            change, promised = model.least(radius)
            there = task.tangents(unknowns + change)
            reached = task.kept(there)[1]
            if value - promised <= CLOSED * abs(value) or radius < SMALLEST * np.abs(unknowns).max():
                return (unknowns + change, reached, steps) if reached <= value else (unknowns, value, steps)
            fall = (value - reached) / (value - promised)
            longest = np.abs(change).max()
            if fall < POOR:
                radius = longest / 4
            elif fall > GOOD and longest > 0.99 * radius:
                radius *= 2
            if fall > TAKEN:
                break
        unknowns, tangents, value = unknowns + change, there, reached
    raise RuntimeError(
        f"no stationary law after {MOST} steps: {value:g} reached, {value - promised:g} less promised; `method` casadi "
        "may find one"
    )


def gap(task, unknowns):
    """By how much the tangents would let any law within the limits do better, relative."""
    tangents = task.tangents(unknowns)
    value = task.kept(tangents)[1]
    _, promised = _Model(task, unknowns, tangents).least(curved=False)
    return max(0.0, (value - promised) / abs(value))


def _pieces(limits):
    if limits.cam is None:
        return PIECES[limits.continuous]
    of_cam = PIECES_OF_A_CAM if limits.cam.profile_radius is None else PIECES_OF_A_PROFILE
    return min(PIECES[limits.continuous], of_cam)


def _uncrowded(task, unknowns):
    """Unknowns of a law within the limits whose cam keeps the bound on its profile, from one that need not.

    Raises `limits.InfeasibleError` where the search for the least crowding finds none.
    """
    asked, most = task.held.limits.cam.profile_radius, -np.inf
    if task.held.pitch.crowded(task.nodes, unknowns).max() <= 1 - MARGIN:
        return unknowns
    task = replace(task, weights={})
    for _ in range(ROUNDS):
        unknowns, *_ = search(task, unknowns)
        before, most = most, task.held.pitch.reached(task.nodes, unknowns)
        if most >= asked:
            return unknowns
        higher = task.between(unknowns)
        if most <= 0 or (not higher and abs(most - before) <= LITTLE * most):
            break
        task = replace(task, more=task.more + higher, held=task.held.asking(most))  # it weighs convex parts and hollows
    raise InfeasibleError([Conflict("least radius of curvature of the roller's cam", "m", asked, most)], alone=True)


def _priced(task, unknowns):
    """(unknowns, J, steps, task) of a `search` at a price that makes no law worth a profile too curved."""
    if task.held.pitch is None:
        return *search(task, unknowns), task
    value = replace(task, price=0.0).value(unknowns)
    for price in np.geomspace(PRICE, DEAREST, 5):
        task = replace(task, price=price * abs(value))
        found = search(task, unknowns)
        if task.held.pitch.crowded(task.nodes, found[0]).max() <= 1 - MARGIN / 2:
            return *found, task
    raise RuntimeError(f"the profile of the cam is too curved for any price up to {task.price:g}")


def _by_ipopt(task, unknowns):
    """(unknowns, J, iterations, task) by casadi's IPOPT, J as of `search`."""
    from compact.motion.ipopt_reference import descent

    unknowns, _, taken = descent(task, unknowns)
    value = replace(task, price=0.0).value(unknowns)
    return unknowns, value, taken, replace(task, price=PRICE * abs(value))


METHODS = MappingProxyType({"steps": _priced, "casadi": _by_ipopt})


def optimum(limits, stroke, duration, weights, mass, resistances, quantile=1.0, pieces=None, least=(), method="steps"):
    """`Optimum` of a task: on few pieces first, which are then halved; `pieces` of run-up and run-down, see `PIECES`.

    method : of METHODS; of "casadi" the gap is told, and not asked to be small: it follows the resistance by a spline

    Raises `limits.InfeasibleError` where no law keeps the limits, RuntimeError where the search does not end.
    """
    pieces = pieces or _pieces(limits)
    rounds = max(0, int(np.log2(pieces / COARSEST)))
    before, curve, taken = np.nan, None, 0
    for halvings in range(rounds + 1):
        space = space_of(limits, pieces >> rounds, halvings)
        task = Task(ConstraintSet(limits, space, stroke, duration), weights, mass, resistances, quantile, least)
        try:
            start = task.held.calmest if curve is None else space.taken_over(curve)
            if task.held.pitch:
                start = _uncrowded(task, start)
        except InfeasibleError:  # finer pieces may do
            if halvings < rounds:
                continue
            raise
        unknowns, value, steps, task = METHODS[method](task, start)
        curve, refinement, before, taken = space.curve(unknowns), before / value - 1, value, taken + steps
    for _ in range(ROUNDS):
        higher = task.between(unknowns)
        if not higher:
            break
        task = replace(task, more=task.more + higher)
        unknowns, value, steps, task = METHODS[method](task, unknowns)
        taken += steps
    unknowns = task.held.closed(unknowns)
    left = gap(task, unknowns)
    if left > STATIONARY and method == "steps":
        raise RuntimeError(f"the search stopped at {value:g} after {taken} steps, not stationary: a gap of {left:.1e}")
    return Optimum(space.curve(unknowns), value, left, refinement, taken)
