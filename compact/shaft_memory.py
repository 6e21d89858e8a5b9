"""A shaft whose carts meet a resistance that remembers: what they remember over a turn, and the turn under it, in turn.

    sum of carts: H with W = G(v) + D_i(phi),    G = F_ss(v) - k m_ss(v),    D_i = k m along x(phi), phi(t) of the turn

The angle fixes where a cart is; only when it is there follows from the shaft's speed, so that the columns feel the turn
through the time alone. A change of D changes phi'^2 by its work over the shaft's energy, and that D by about as much as
it changes the speed: rounds of turn and columns converge, as geometrically as the shaft runs evenly. D is a spline of
least squares over the angle, which leaves out the ripple of single columns; `misfit` says by how much.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import BSpline, CubicHermiteSpline, make_lsq_spline

from compact.memory import Memory, instants

ROUNDS = 60  # of turn and columns; 3 to 12 are usual
CLOSE = 10.0  # times the tolerance of the turn: so well the force closes, over its largest value
DEGREE, STRIDE = 5, 8  # of the spline, and instants from knot to knot
LEAST = 1e-300  # N: a force that is none
COMPARED = 2001  # angles at which two rounds are compared


@dataclass(frozen=True, eq=False)
class Recalled:
    """D of each cart [N], a spline over its own angle [rad].

    changes : largest change of D from round to round, over its largest value;  misfit : of the splines, over that
    """

    memory: Memory
    forces: tuple[BSpline, ...]
    misfit: float = 0.0
    changes: list = field(default_factory=list)

    def met(self, which, angle, velocity):
        """W [N] of a cart at its own angles and at its velocities."""
        return self.memory.prompt(velocity) + self.forces[which](angle)

    def breaks(self, angles):
        """Angles of the shaft at which a cart that is ahead by one of the angles passes a knot."""
        knots = [np.unique(force.t) - ahead for force, ahead in zip(self.forces, angles, strict=True)]
        return np.mod(np.concatenate(knots), 2 * np.pi)


def recalled(memory, cycle, angles, turned, tolerance):
    """(the last of turned(recalled), `Recalled`) once rounds change no more.

    angles : of each cart ahead [rad];  turned : gives the `Turning` under what is recalled, None at first: F_ss alone

    Raises RuntimeError where the rounds do not converge, with the changes reached.
    """
    turn, before, changes = turned(None), None, []
    period = float(turn.weights.sum())
    time = instants(lambda time: cycle.position(time / period * cycle.period), period, memory.columns)
    angle, position = 2 * np.pi * time / period, cycle.position(time / period * cycle.period)
    everywhere = np.linspace(0, 2 * np.pi, COMPARED)
    for _ in range(ROUNDS):
        found, misfit = zip(
            *(_force(memory, _times(turn, angle - ahead), position, angle) for ahead in angles), strict=True
        )
        values = np.array([force(everywhere) for force in found])
        largest = max(np.abs(values).max(), LEAST)
        if before is not None:
            changes.append(float(np.abs(values - before).max() / largest))
        before, known = values, Recalled(memory, found, max(misfit), changes)
        turn = turned(known)
        if changes and changes[-1] <= CLOSE * tolerance:
            return turn, known
    raise RuntimeError(
        f"shaft and memory do not meet in {ROUNDS} rounds: the last changed the force by "
        f"{', '.join(f'{change:.1g}' for change in changes[-3:])} of its largest value, {CLOSE * tolerance:.1g} was "
        "asked; give more flywheel"
    )


def _times(turn, angle):
    """Times [s] at which the shaft is at rising angles, which may lie in the turn before."""
    nodes, first = np.unique(turn.angle.ravel(), return_index=True)
    course = CubicHermiteSpline(nodes, turn.time.ravel()[first], 1 / turn.speed.ravel()[first])
    turns = np.floor(angle / (2 * np.pi))
    return course(angle - 2 * np.pi * turns) + turns * turn.weights.sum()


def _force(memory, time, position, angle):
    """D over the angle as a spline, and by how much that misses it over its largest value."""
    columns = memory.columns.imprint(position.min(), position.max(), position[0])
    m = memory.settled(columns, time, position)
    force = memory.stiffness * np.append(m[-1], m)
    inner = angle[STRIDE:-STRIDE:STRIDE]
    knots = np.concatenate([np.full(DEGREE + 1, angle[0]), inner, np.full(DEGREE + 1, angle[-1])])
    spline = make_lsq_spline(angle, force, knots, DEGREE)
    return spline, float(np.abs(spline(angle) - force).max() / max(np.abs(force).max(), LEAST))
