"""A cart behind a spring against a resistance that remembers: the equation of motion and the columns, side by side.

    m x'' = pull - T(G(v) + D(t)),    G = F_ss(v) - k m_ss(v),    D = k m(t),    T(W) = W + guide friction under W

`memory.Columns` give m(t) from the way of the cart, and m acts back on the cart, most stiffly while it turns: to go
round and round over a whole cycle, the motion under the last D and then D of that motion, need not converge for springs
that are soft beside the columns, on which a cart swings. It is done over one window after another, each an instant of
the columns. D is straight over a window; its value at the end is found by secants, each trial with the arcs of
`dynamics` and so with stops, sticking and the limits of a standing cart exact: T gives the force of time against either
way. What a cart does to m within a window is as weak as the square of the window, so that two or three trials do. Of
F_ss and m_ss only F_ss may jump at v = 0: that is friction and stays in G.

The periodic regime has a second seam, the columns: Newton's method for the cart starts from columns that have followed
the motion found before, until that changes nothing more.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from compact import dynamics, imprint
from compact.cart import balance
from compact.dynamics import ARC, DONE, EVALUATIONS, TOO_FAST, Arcs, advance, clock, reached, room
from compact.dynamics import begun as set_off
from compact.imprint import copied, pressed
from compact.memory import instants
from compact.polynomials import Pieces, pieces
from compact.regime import ARCS, CLOSED, FAILURES, TABLE, WIDENINGS, WIDER, Problem, Work
from compact.resisted import BACK, MIX, THERE, WHOLE, Resistance, looked_up
from compact.rigid_drive import CREEP
from compact.ringing import compiling, shifted

TRIALS = 30  # of the force at the end of a window; 2 or 3 are usual
MET = 0.1  # of the tolerance by which a cycle has to close: so well the force is met
SEAMS = 60  # rounds of the columns of the periodic regime; 2 or 3 are usual, dozens near a resonance
ROOM = 4.0  # times the largest force over the stiffness: how far beyond the stroke there are columns
MOST_COLUMNS = 1_000_000  # [-]; each takes 8 B and as much for each branch, and the columns are copied for each cycle
SHORT = 1e-9  # of a cycle: so near to a join of the law there is no instant
AWAY, UNMET = 10, 11  # how `march` may end beside `integrate`
MORE_FAILURES = FAILURES | {
    AWAY: "it swings much farther than its largest force stretches the spring; give more damping",
    UNMET: f"{TRIALS} trials do not meet the force of the mix; the spring may be too soft for so light a cart",
}

compiled = compiling(__file__, dynamics.__file__, imprint.__file__)


class Guides(NamedTuple):
    """Reactions front + front_lever W, rear + rear_lever W of the guide wheels on the way there and back; friction."""

    friction: float
    front: np.ndarray
    front_lever: np.ndarray
    rear: np.ndarray
    rear_lever: np.ndarray


def guides_of(cart):
    """`Guides` of a cart that is pushed straight."""
    columns = []
    for way in (1, -1):
        found = balance(cart, 0.0, np.array([0.0, 1.0]), way)
        front, rear = found.front_reaction, found.rear_reaction
        columns.append((front[0], front[1] - front[0], rear[0], rear[1] - rear[0]))
    return Guides(float(cart.guide_friction), *np.array(columns).T.copy())


@compiled
def pushed(guides, row, met):
    """T(W) [N] on one way."""
    way = 1.0 if row == THERE else -1.0
    front = guides.front[row] + guides.front_lever[row] * met
    rear = guides.rear[row] + guides.rear_lever[row] * met
    return met + way * guides.friction * (abs(front) + abs(rear))


@compiled
def given_at(guides, mix, velocity, force):
    """D(t) = `force` as the rows of a `Resistance` take it: T(G + D) - T(G) on each way, and D itself."""
    rows = np.empty(3)
    rows[MIX] = force
    for row, way in ((THERE, 1.0), (BACK, -1.0)):
        met = way * looked_up(mix, max(way * velocity, 0.0), WHOLE)[0]
        rows[row] = pushed(guides, row, met + force) - pushed(guides, row, met)
    return rows


class Track(NamedTuple):
    """A cart on its way: what does not change within a march.  stiffness : k of the memory;  close : to which D is
    met [N];  trials : of a window, at most;  mix : G over |v|"""

    guides: Guides
    mix: Pieces
    stiffness: float
    close: float
    trials: int


@compiled
def march(spring, law, resistance, track, columns, state, tolerance, arcs, places):
    """Arcs from a state through windows, the pieces of a law: (how it ended, arcs, evaluations, trials, state, time).

    columns : an `Imprint`, which goes along;  arcs : `room`;  places : of the cart at the ends of the windows
    """
    n, work, trials = 0, 0, 0
    there, back, knots, added, pace, _ = resistance
    places[0] = law.coefficients[0, 0] - state.stretch
    force, rise = track.stiffness * pressed(columns, places[0], 0.0, False), 0.0
    for i in range(len(law.coefficients)):
        window, span = Pieces(law.breaks[i : i + 2], law.coefficients[i : i + 1]), law.breaks[i + 1] - law.breaks[i]
        low, high = columns.first, columns.first + columns.spacing * (len(columns.w) - 1)
        begun, free, end = given_at(track.guides, track.mix, state.velocity, force), _after(arcs, n), state
        guess, last_guess, last_miss, found = force + rise * span, 0.0, 0.0, 0.0
        for trial in range(track.trials):
            given = np.empty((3, 2))
            given[:, 0] = begun
            given[:, 1] = (given_at(track.guides, track.mix, end.velocity, guess) - begun) / span
            now = Resistance(there, back, knots, added, pace, given)
            journey = set_off(state)
            ended = advance(spring, window, now, journey, tolerance, free, np.iinfo(np.int64).max)
            count, end, time = journey.counts[ARC], reached(journey), clock(window, journey)
            work, trials = work + journey.counts[EVALUATIONS], trials + 1
            if ended != DONE:
                return ended, n, work, trials, end, time
            place = window.coefficients[0].sum() - end.stretch
            if not low + columns.half_length < place < high - columns.half_length:
                return AWAY, n, work, trials, end, time
            found = track.stiffness * pressed(columns, place, span, False)
            miss = found - guess
            if abs(miss) <= track.close:
                break
            slope = (miss - last_miss) / (guess - last_guess) if trial > 0 else -1.0
            last_guess, last_miss = guess, miss
            guess -= miss / slope
        else:
            return UNMET, n, work, trials, end, time
        pressed(columns, place, span, True)
        n, places[i + 1], rise, force, state = n + count, place, (guess - force) / span, guess, end
    return DONE, n, work, trials, state, law.breaks[-1]


@compiled
def _after(arcs, n):
    """The room that is left after n arcs."""
    return Arcs(
        arcs.start[n:], arcs.span[n:], arcs.length[n:], arcs.law[n:], arcs.stretch[n:], arcs.ring[n:], arcs.slip[n:],
        arcs.side[n:], arcs.zone[n:], arcs.given[n:],
    )  # fmt: skip


@dataclass
class MemoryWork(Work):
    """Beside `Work`: trials of windows; `seams`: what each round of the columns left open [N]."""

    trials: int = 0
    seams: list = field(default_factory=list)


class RememberingProblem(Problem):
    """A `Problem` of `regime` whose mix remembers: its courses take the columns along."""

    remembers = True

    def __init__(self, cart, drive, cycle, memory, tolerance):
        self.memory, self.guides = memory, guides_of(cart)
        super().__init__(cart, replace(drive, first_order=False), cycle, memory.prompt, tolerance)
        self.work = MemoryWork()
        self.law = _windows(self.law, np.append(instants(cycle.position, cycle.period, memory.columns), self.middle))
        way = self.law(self.law.breaks)
        largest = max(self.scale, np.abs(memory.steady(self.fastest * np.linspace(CREEP, 1, 65))).max())
        spacing = memory.columns.spacing
        swing = np.ceil((ROOM * largest / drive.stiffness + drive.backlash) / spacing) * spacing
        columns = (np.ptp(way) + 2 * swing) / spacing
        if columns > MOST_COLUMNS:
            raise ValueError(
                f"`stiffness` {drive.stiffness:g} N/m lets the cart swing {swing:.2g} m beyond the stroke: "
                f"{columns:.2g} columns of the mix, at most {MOST_COLUMNS} are followed; give a stiffer spring or "
                "less backlash"
            )
        self.columns = memory.columns.imprint(way.min() - swing, way.max() + swing, way[0] - self.at_rest.stretch)
        at = int(np.searchsorted(self.law.breaks, self.middle))
        self.begun, self.places = None, {True: way[at:], False: way[: at + 1]}

    def _tabulate(self):
        super()._tabulate()
        self.mix = pieces(self.memory.prompt, self.resistance.there.breaks[1:], TABLE * self.tolerance)

    def course(self, law, state, roughly=1.0):
        """(`Arcs`, end state) through windows, from the columns of the middle where it begins there, else from those
        that the last course left; the range of speeds widens as need be."""
        late = bool(law.breaks[0] > 0)
        begun, places = self.begun[0] if late else self.columns, np.empty(len(law.breaks))
        if late:
            self.begun = begun, state
        close = MET * CLOSED * self.tolerance
        track = Track(self.guides, self.mix, float(self.memory.stiffness), close, TRIALS)
        for _ in range(WIDENINGS):
            arcs, columns = room(ARCS + len(places), law.coefficients.shape[1] - 1), copied(begun)
            ended, n, evaluations, trials, end, time = march(
                self.spring, law, self.resistance, track, columns, state, roughly * self.tolerance, arcs, places
            )
            self.work.courses += 1
            self.work.arcs += n
            self.work.evaluations += evaluations
            self.work.trials += trials
            if ended == DONE:
                self.columns, self.places[late] = columns, places
                return Arcs(*(column[:n].copy() for column in arcs)), end
            if ended != TOO_FAST:
                break
            self.fastest *= WIDER
            self._tabulate()
            track = track._replace(mix=self.mix)
        raise RuntimeError(
            f"the cart was followed to {time:g} s of {law.breaks[-1]:g} s in {n} arcs, speed {end.velocity:g} m/s, "
            f"and no further: {MORE_FAILURES[ended]}"
        )

    def periodic(self):
        """(`Arcs`, state at the start) of the cycle that comes back after it with its columns."""
        self.begun = self._followed(), None
        for _ in range(SEAMS):
            found = super().periodic()
            followed = self._followed()
            self.work.seams.append(self._apart(self.begun[0], followed))
            if self.work.seams[-1] <= self.tolerance:
                return found
            self.begun = followed, self.begun[1]
        raise RuntimeError(
            f"no periodic regime of what the mix remembers found in {SEAMS} rounds: the last ones changed the force by "
            f"{', '.join(f'{seam:.1g}' for seam in self.work.seams[-3:])} N, {self.tolerance:.1g} N was asked"
        )

    def _followed(self):
        """The columns in the middle of the way there, after as many cycles of the last motion as they remember."""
        at, breaks = len(self.places[False]) - 1, self.law.breaks
        time = np.append(breaks[at:], breaks[1 : at + 1] + breaks[-1])
        columns = copied(self.columns)
        self.memory.settled(columns, time, np.append(self.places[True], self.places[False][1:]))
        return columns

    def _apart(self, one, other):
        """How far two prints let the force differ, at most [N]: k b^2/R times the difference of what holds p back."""
        held = np.abs(one.shares @ (one.z - other.z)).max()
        return float(self.memory.stiffness * one.half_length**2 / one.radius * held)

    def _steady(self, early):
        """State in the middle of the way there: that of the last round, at first that without swinging."""
        return super()._steady(early) if self.begun[1] is None else self.begun[1]


def _windows(law, times):
    """The pieces of a law cut at times [s] too."""
    breaks = np.union1d(law.breaks, times)
    keep = np.append(np.diff(breaks) > SHORT * breaks[-1], True) | np.isin(breaks, law.breaks)
    breaks = breaks[keep]
    at = np.clip(np.searchsorted(law.breaks, breaks[:-1], side="right") - 1, 0, len(law.coefficients) - 1)
    width = np.diff(law.breaks)[at]
    rows = [
        shifted(law.coefficients[i], (start - law.breaks[i]) / whole, span / whole)
        for i, start, span, whole in zip(at, breaks[:-1], np.diff(breaks), width, strict=True)
    ]
    return Pieces(breaks, np.array(rows))
