"""One increment of a layer under the roller: Newton's method on the balance of its nodes.

    forces of the roller - forces of the layer = 0    on the free unknowns

An increment of associated, hardening mix minimises a convex energy, so a step along Newton's direction is cut until the
residual along that direction has shrunk. The factorised tangent is kept, from one increment to the next too, as long as
it shrinks the residual well; where steps stay short a share of the elastic stiffness is added to it.

A layer that flows with hardly any stiffness, as a bow wave does, may be held by drag: a share of the elastic forces of
its departure from the motion foreseen. Drag is none where the motion goes on as it was.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

RESIDUAL = 1e-6  # of the nodal forces
ITERATIONS = 60
WELL = 0.3  # ratio of successive residuals up to which a factorised tangent is kept
ALONG = 0.3  # of the residual along the direction may be left by a step that goes too far
CUTS = 8
SHORT = 0.2  # a step below this asks for elastic stiffness
FIRST_SHARE = 0.005  # of the elastic stiffness


class NotBalancedError(RuntimeError):
    """An increment found no balance; the smallest residual reached is in its message."""


def unbalanced(sizes):
    """Clause of a message about the forces that stay unbalanced after the iterations of the residuals `sizes`."""
    return f"after {len(sizes)} iterations {min(sizes):.1e} of the forces stay unbalanced"


@dataclass(frozen=True, eq=False)
class Balance:
    """A balanced increment: the `Condition` after it, the `Push` of the roller, residual over forces, iterations.

    The residual is that without drag.
    """

    after: object
    push: object
    residual: float
    iterations: int


class Balancer:
    """Balances increments of one `Solid` under one row of surface `nodes`, and remembers the factorised tangent."""

    def __init__(self, solid, nodes, residual=RESIDUAL):
        self.solid, self.nodes, self.residual = solid, np.asarray(nodes, dtype=int), residual
        self.factor, self.factorised = None, 0

    def balanced(self, before, face, displacement, drag=0.0):
        """The `Balance` from a `Condition`, near a displacement foreseen whose held unknowns are final.

        drag : share of the elastic stiffness that resists departures from the displacement foreseen
        face : `Face` or anything whose `push` answers displacements of the nodes

        The search starts from the displacement before where elements fold over in the one foreseen.

        Raises NotBalancedError with the smallest residual reached.
        """
        trial, share, history = self._first(before, face, displacement, drag), 0.0, []
        for iteration in range(ITERATIONS):
            history.append(trial.size)
            if trial.size <= self.residual:
                return Balance(trial.motion.after, trial.push, trial.unbalanced, iteration)
            stalled = iteration > 0 and history[-1] > WELL * history[-2]
            fresh = self.factor is None or stalled
            if fresh:
                self._factorise(trial, share)
            direction = self.factor(trial.residual)
            length, moved = _searched(trial, direction)
            if moved is None and not fresh:  # an old tangent may point uphill
                self.factor = None
                continue
            if moved is None or length < SHORT:
                share, self.factor = max(4 * share, FIRST_SHARE), None
                if share > 10:
                    break
            elif length == 1:
                share = share / 4 if share > FIRST_SHARE / 20 else 0.0
            trial = moved or trial
        raise NotBalancedError(f"no balance: {unbalanced(history)}")

    def _first(self, before, face, foreseen, drag):
        """The `_Trial` at the displacement foreseen, or before the increment where elements fold over there."""
        held, start = self.solid.held, before.displacement.copy()
        start.ravel()[held] = foreseen.ravel()[held]
        for displacement in (foreseen, start):
            trial = _tried(self, before, face, displacement, drag, foreseen)
            if trial is not None:
                return trial
        raise NotBalancedError("no balance: elements of the layer fold over before the first iteration")

    def _factorise(self, trial, share):
        blocks = trial.stiffness()
        if share + trial.drag:
            blocks = blocks + (share + trial.drag) * self.elastic_blocks
        try:
            self.factor = self.solid.factorised(blocks, self.nodes, trial.push.stiffness)
        except RuntimeError as error:
            raise NotBalancedError(f"no balance: {error}") from error
        if trial.push.coupling is not None:
            self.factor = _coupled(self.factor, *(self._free(part) for part in trial.push.coupling))
        self.factorised += 1

    def _free(self, values):
        """Values at the surface nodes, shape (n, 2), on the free unknowns in their order."""
        spread = np.zeros((self.solid.basis.N, 2))
        spread[self.nodes] = values
        return spread.ravel()[self.solid.order]

    @cached_property
    def elastic_blocks(self):
        """Of the mix at rest, shape (elements, 16, 16)."""
        rest = self.solid.at_rest()
        return self.solid.moved(rest, rest.displacement).blocks

    def elastic_forces(self, displacement):
        """That the nodes of an elastic layer would bear, shape (N, 2)."""
        unknowns = self.solid.unknowns
        forces = np.matmul(self.elastic_blocks, displacement.ravel()[unknowns][..., None])
        return np.bincount(unknowns.ravel(), forces.ravel(), displacement.size).reshape(-1, 2)


class _Trial:
    """A displacement, what the layer and the roller answer to it, and what is left on the free unknowns."""

    def __init__(self, balancer, before, face, displacement, drag, foreseen):
        self.balancer, self.before, self.face, self.drag, self.foreseen = balancer, before, face, drag, foreseen
        solid = balancer.solid
        self.motion = solid.moved(before, displacement, tangent=False)
        self.push = face.push(displacement[balancer.nodes])
        forces = self.motion.forces
        pushed = np.zeros_like(forces)
        pushed[balancer.nodes] = self.push.forces
        scale = max(np.linalg.norm(forces), np.linalg.norm(pushed)) or 1.0
        self.residual = (pushed - forces).ravel()[solid.order]
        self.unbalanced = np.linalg.norm(self.residual) / scale
        if drag:
            self.residual = self.residual - drag * balancer.elastic_forces(displacement - foreseen).ravel()[solid.order]
        self.size = np.linalg.norm(self.residual) / scale
        if not np.isfinite(self.size):
            raise FloatingPointError("the layer folds over")

    def stiffness(self):
        """Blocks of the elements, the tangent found again with the same displacement."""
        return self.balancer.solid.moved(self.before, self.motion.after.displacement).blocks

    def along(self, length, direction):
        """The trial a step further, or None where elements would fold over or the mix does not follow."""
        displacement = self.motion.after.displacement.copy()
        displacement.ravel()[self.balancer.solid.order] += length * direction
        return _tried(self.balancer, self.before, self.face, displacement, self.drag, self.foreseen)


def _tried(*given):
    """The `_Trial` of these arguments, or None where elements fold over or the mix does not follow."""
    try:
        with np.errstate(invalid="raise", divide="raise", over="raise"):
            return _Trial(*given)
    except (FloatingPointError, RuntimeError, ValueError):
        return None


def _coupled(factor, column, row):
    """Solver of a matrix and column x row more, from the solver of the matrix, by Sherman and Morrison."""
    answer = factor(column)
    part = answer / (1 + row @ answer)

    def solve(residual):
        plain = factor(residual)
        return plain - (row @ plain) * part

    return solve


def _searched(trial, direction):
    """Length of the step and the trial there: the residual along the direction must shrink; None where none does."""
    start = direction @ trial.residual
    if start <= 0:
        return 0.0, None
    length = 1.0
    for _ in range(CUTS):
        moved = trial.along(length, direction)
        if moved is not None:
            left = direction @ moved.residual
            if -ALONG * start <= left <= start or moved.size < WELL * trial.size:
                return length, moved
            length *= np.clip(start / (start - left), 0.1, 0.7) if left < 0 else 0.25  # the secant
        else:
            length /= 4
    return length, None
