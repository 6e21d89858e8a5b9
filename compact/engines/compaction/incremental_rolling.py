"""The roller rolls on: one element of travel after the other, each a balanced increment, until nothing changes.

Before a step all mix is carried towards the rear by one element (`Frame`); then the roller, back in its place, presses
it again. The first guess is that the mix moves as it did in the step before, seen from the roller. A drag against
leaving that motion keeps a bow wave of perfectly plastic mix from trembling, and is gone when the motion is steady. The
tractions that the roller carries stay with the roller. Steadiness is told by the decay of what still changes (`tail`).
"""

from dataclasses import dataclass, replace

import numpy as np

from compact.engines.compaction.newton import Balancer, NotBalancedError
from compact.engines.compaction.roller_contact import RollerSurface, RollingSurface

PENALTY = 0.15  # of the unloading modulus over the step, or over the THIN-th part of the height if that is less
THIN = 20
SLOWEST = 0.97  # ratio of successive changes of a tail that may still be called decaying
SOFTER = 0.1  # times the penalty where an increment finds no balance
DRAG = 0.02  # of the elastic stiffness; without it a high wave takes five times the iterations
HALVINGS = 3  # of a step of the roller that finds no balance


@dataclass(frozen=True)
class Step:
    """One step of the march.

    travel, lowest : so far, and of the lowest generatrix above the base [m];  load, resistance : [N/m]
    exit_density_ratio : mean of the column of mix that leaves;  peak_pressure : [Pa]
    iterations, residual : of Newton's method, and what is left over the forces without drag
    wave : rise of the surface above the fed height [m]
    """

    travel: float
    lowest: float
    load: float
    resistance: float
    exit_density_ratio: float
    peak_pressure: float
    iterations: int
    residual: float
    wave: float


def tail(values, window):
    """Limit of a series that decays, and what is left until it, by the means of its last three windows.

    With means a, b, c and r = (c - b)/(b - a) the rest is (c - b) r/(1 - r) beyond the last window; a series that does
    not decay has r near 1 and far to go.
    """
    if len(values) < 3 * window:
        return values[-1], np.inf
    a, b, c = np.reshape(values[-3 * window :], (3, window)).mean(axis=1)
    if c == b:
        return values[-1], 0.0
    ratio = min(abs((c - b) / (b - a)), SLOWEST) if b != a else SLOWEST
    limit = c + (c - b) * ratio / (1 - ratio)
    return float(limit), float(abs(limit - values[-1]) + np.ptp(values[-window:]) * ratio)


class March:
    """A roller on its way through a `Frame`: one `advance` after the other, each a balanced increment.

    at_once : its last step is a steady balance, found at once
    highest : height above the lowest generatrix [m] that the bow wave may reach
    progress : called with a line of text after each step
    sought : height of the lowest generatrix [m] where such a balance was sought in vain, or None
    """

    def __init__(
        self,
        frame,
        radius,
        *,
        profile="deformed",
        friction=0.0,
        torque=None,
        residual=1e-4,
        highest=np.inf,
        progress=None,
    ):
        self.frame, self.highest, self.progress = frame, highest, progress
        self.change, self.at_once, self.sought = 0.0, False, None
        law, height = frame.solid.law, frame.mesh.height
        penalty = PENALTY * law.unloading_modulus / min(frame.step, height / THIN)
        nodes = frame.surface
        given = frame.nodes[nodes], frame.weights, radius, height, penalty, np.zeros(len(nodes)), profile
        self.face = (
            RollerSurface(*given, friction)
            if torque is None
            else RollingSurface(*given, grip=friction, pull=-torque / radius)
        )
        self.balancer = Balancer(frame.solid, nodes, residual)
        self.condition, self.push, self.steps = frame.at_rest(), None, ()

    def advance(self, lowest, drag=DRAG):
        """One element of travel, the lowest generatrix at a height [m] at its end; the `Step` it made."""
        arrived = self.frame.carried(self.condition)
        guess = self._foreseen(arrived.displacement)
        face = self._starting(self.face, arrived).at(lowest)
        try:
            balance = self.balancer.balanced(arrived, face, guess, drag)
        except NotBalancedError:
            balance = self._gently(arrived, guess, lowest)
        self.change, self.at_once = balance.after.displacement - arrived.displacement, False
        return self._taken(balance, lowest)

    def settled(self, balance, lowest):
        """The `Step` that goes on in a steady `Balance`, found at once."""
        after = balance.after
        self.change, self.at_once = after.displacement - self.frame.carried(after).displacement, True
        return self._taken(balance, lowest)

    def limit(self, name):
        """What a number of the steps tends to, and what is left until it."""
        values = [getattr(step, name) for step in self.steps]
        return (values[-1], 0.0) if self.at_once else tail(values, self.window)

    def _gently(self, arrived, guess, lowest):
        """The same step with a softer roller, for which carried pressures soon make up, then in parts of the step."""
        soft, self.balancer.factor = replace(self.face, penalty=self.face.penalty * SOFTER), None
        try:
            return self.balancer.balanced(arrived, self._starting(soft, arrived).at(lowest), guess)
        except NotBalancedError:
            return self._in_parts(arrived, soft, lowest)

    def _in_parts(self, condition, face, lowest):
        """The same travel in halves, quarters, ... of the step."""
        start = face.lowest
        for halving in range(1, HALVINGS + 1):
            parts, iterations, moved, there = 2**halving, 0, condition, face.at(start, -self.frame.step)
            try:
                for k in range(1, parts + 1):
                    there = there.starting(moved.displacement[self.frame.surface])
                    there = there.at(start + (lowest - start) * k / parts, self.frame.step * (k / parts - 1))
                    balance = self.balancer.balanced(moved, there, moved.displacement)
                    moved, iterations = balance.after, iterations + balance.iterations
                return replace(balance, iterations=iterations)
            except NotBalancedError as error:
                reason = error
        depth, reached = 1e3 * (self.frame.mesh.height - lowest), "the roller has not moved yet"
        if self.steps:
            last = self.steps[-1]
            reached = f"at travel {last.travel:.3g} m load {last.load:.0f} N/m, bow wave {1e3 * last.wave:.3g} mm high"
        raise RuntimeError(
            f"step {len(self.steps) + 1} of the march at depth {depth:.4g} mm finds {reason}; reached: {reached}"
        )

    def _starting(self, face, arrived):
        """A face where it stood before the step, one element back on the mix that has been carried."""
        return face.at(face.lowest, -self.frame.step).starting(arrived.displacement[self.frame.surface])

    @property
    def window(self):
        """Steps over which tails are averaged: of travel a third of the layer's height, or of the contact if longer."""
        return max(4, int(np.ceil(max(self.frame.mesh.height, self.frame.length) / (3 * self.frame.step))))

    def take_over(self, other, condition):
        """Go on where another march is, its `Condition` already on this mesh."""
        x, old = (march.frame.nodes[march.frame.surface, 0] for march in (self, other))
        pressure, shear = (np.interp(x, old, values) for values in (other.push.pressure, other.push.shear))
        self.condition, self.steps = condition, other.steps[-1:]
        self.at_once, self.sought = other.at_once, other.sought
        self.face = self.face.carrying(pressure, shear, other.push.creep).at(self.steps[-1].lowest)
        self.change = condition.displacement - self.frame.carried(condition).displacement

    def _foreseen(self, arrived):
        """The displacement if the mix moves as it did in the step before, seen from the roller."""
        guess = arrived + self.change
        held = self.frame.held
        guess.ravel()[held] = arrived.ravel()[held]
        return guess

    def _taken(self, balance, lowest):
        self.condition, self.push = balance.after, balance.push
        self.face = self.face.carrying(self.push.pressure, self.push.shear, self.push.creep).at(lowest)
        travel = self.steps[-1].travel if self.steps else 0.0
        step = Step(
            travel + self.frame.step,
            lowest,
            *self.forces(),
            self.frame.exit_mean(balance.after.state.density_ratio),
            float(self.pressure.max()),
            balance.iterations,
            balance.residual,
            float(self.places[:, 1].max() - self.frame.mesh.height),
        )
        self.steps += (step,)
        if self.progress is not None:
            self.progress(
                f"{round(self.frame.length / self.frame.step)} increments a contact, step {len(self.steps)}: "
                f"travel {step.travel:.3g} m, bow wave {1e3 * step.wave:.3g} mm, {step.residual:.1e} of the forces "
                "unbalanced"
            )
        return step

    def forces(self):
        """Load and resistance [N/m]."""
        return self.face.forces(self.push)

    @property
    def places(self):
        """Where the surface nodes are now [m], shape (n, 2)."""
        surface = self.frame.surface
        return self.frame.nodes[surface] + self.condition.displacement[surface]

    @property
    def pressure(self):
        """Of the roller on the surface as it is now [Pa]."""
        return self._traction(self.push.pressure)

    @property
    def shear(self):
        """Traction along the roller on the surface as it is now [Pa], + ahead."""
        return self._traction(self.push.shear)

    def _traction(self, nodal):
        """On the surface as it is now, linear between corners, since nodes scatter about what they have in common."""
        forces, x = self.face.weight * nodal, self.frame.nodes[self.frame.surface, 0]
        hats = forces[::2].copy()
        hats[:-1] += forces[1::2] / 2
        hats[1:] += forces[1::2] / 2
        traction = np.interp(x, x[::2], hats / np.gradient(x[::2]))
        if self.face.profile != "deformed":
            return traction
        return traction / np.hypot(*(np.gradient(part, x) for part in self.places.T))
