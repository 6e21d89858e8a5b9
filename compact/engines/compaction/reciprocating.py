"""A roller on its way over a layer whose mesh stays with the mix: one balanced step after the other, any way.

The tractions that the roller carries stay with it: before a step they go along the surface with the roller, and with
them the change of the displacement, as they were when it came to the node one element before.

A roller that travels over compacting mix along a motion law: there and back, through v = 0, over what it pressed.

    position x_0, x_1, ...: each step a balanced increment of the whole layer,  Newton's method of `equilibrium`

The mesh stays with the mix, as long as the stroke and what lies beyond its ends, and the roller rolls over it: no state
is ever carried, so that going back needs nothing of its own. Tractions stay with the roller and go along the surface by
whole elements. Mix that knows no rate answers the path alone, not the time it takes; with the rate effect pc follows
the mean |v| of each step. A roller that stands waits without effect.

Steps are half elements, as far as the points of an element lie apart, which is how the mix steps in the balance that
`compaction` solves at once; after a turn they begin at the 16th part of an element. The error told is the change from
steps twice as long, on the same mesh. Besides, the forces rise and fall a little within each element, as its nodes meet
the roller: on 6 elements a contact by 1.3 % of the resistance and 0.3 % of the load to either side of their mean.

Friction
    A roller that turns grips the mix by Coulomb's law, slip being what a node moves along its surface in a step, and
    its angle follows from its torque (`turning`). Where it turns back nothing jumps: all sticks until slip begins anew.
    A roller that slides drags the mix by f p whichever way it goes; at v = 0 that is anything between, and so is a
    torque that turns with the travel. There the time stands twice, before and after. The drag then moves the mix at
    once, while the roller stands, and what slip takes may fall by that work.

Envelope: 2 mm deep in 0.1 m, 6 elements a contact, mean load and resistance within 0.5 % of steady rolling after three
heights of travel; 0.4 s of processor time a step, 65 s there and back over 0.12 m, half as much again with the error.
Free with friction 0.3 within 0.4 % and 0.8 %, on 8 elements 0.25 % and 0.5 %, at the same cost. A layer that slips is
refused, and so is a load instead of an indentation.

Feed
    Between two strokes the roller is taken off, and fresh mix spread on a flat layer of rows as they lie in the middle
    of the stroke; the roller comes down to its indentation below the new surface. The ends of the stroke, about as long
    as the contact, are taken as its middle. The layer grows by what it is fed less what is pressed. That is how
    `passes` goes from pass to pass, which judges it.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from threadpoolctl import threadpool_limits

from compact.engines.compaction.engine import require_compactable
from compact.engines.compaction.incremental_rolling import PENALTY, SOFTER, THIN
from compact.engines.compaction.newton import Balancer, NotBalancedError
from compact.engines.compaction.results import drawn, left
from compact.engines.compaction.roller_contact import RollerSurface, RollingSurface
from compact.engines.compaction.roller_frame import Frame, LayerState, stroke_mesh, transferred
from compact.engines.stroke_schedule import PLACE_TOLERANCE, STEP_LENGTH, stroke_schedule
from compact.numerics.validation import require_finite, require_integers, require_nonnegative
from compact.rolling_contact import TransientResult, require_torque_allowed

PRESSING = 6  # steps of a roller that comes down
RESIDUAL = 1e-4  # of the nodal forces
ENTERED = 0.01  # of the largest pressure, by which that of a node may miss what was given on
GIVEN_ON = 10  # times in a step at most; one in ten steps on thick mix leaves more, which the next ones make up


@dataclass(frozen=True)
class RollerState:
    """Where a roller is and what the layer does to it: as `CompactionTransientResult` has it."""

    position: float
    lowest: float
    load: float
    resistance: float
    leading: float
    trailing: float
    angle: float
    given: float
    rubbed: float
    kept: float


class Trip:
    """A roller on its way over one layer, at first where it just touches it, at x = `low`.

    way : `Strokes`;  element, length : of the mesh along x, and about that of the contact [m]
    fed : what lies there, a `LayerState` or None for fresh mix of a `height`;  place : x of the roller [m]
    torque : on a roller that turns, + the way it travels [N]
    """

    def __init__(self, way, roller, law, height, *, torque, element, length, finite, fed, place):
        self.low, self.span, self.element = way.low, way.span, element
        self.turns = roller.rolling in ("free", "driven") and roller.friction > 0
        # along +x: traction over pressure where all slides, sum of the tractions where the roller turns
        self.friction = roller.friction if roller.rolling == "sliding" else 0.0
        self.pull = -(torque or 0.0) / roller.radius
        mesh = stroke_mesh(height, length, element, round(way.span / element))
        self.frame = frame = Frame(mesh, law, "bonded", length, fed=fed, finite=finite)
        nodes = frame.nodes[frame.surface] + [way.low, 0.0]
        penalty = PENALTY * law.unloading_modulus / min(element, height / THIN)
        given = {"profile": roller.profile, "offset": float(place)}
        given |= {"grip": roller.friction, "sheared": np.zeros(len(nodes))} if self.turns else {}
        kind = RollingSurface if self.turns else RollerSurface
        self.face = kind(nodes, frame.weights, roller.radius, height, penalty, np.zeros(len(nodes)), **given)
        self.balancer = Balancer(frame.solid, frame.surface, RESIDUAL)
        self.condition, self.past, self.iterations = frame.at_rest(), [], 0
        self.push = self.face.pressed(self.condition.displacement[frame.surface])
        self.angle, self.given, self.rubbed, self.kept = 0.0, 0.0, 0.0, 0.0

    def take_over(self, march):
        """Be at `low` as a steady `March` is, which has x = 0 under the roller."""
        frame = self.frame
        x, old = frame.nodes[frame.surface, 0], march.frame.nodes[march.frame.surface, 0]
        pressure, shear = (np.interp(x, old, of, left=0.0, right=0.0) for of in (march.push.pressure, march.push.shear))
        self.condition = transferred(march.condition, march.frame, frame)
        face = self._facing(1.0).carrying(pressure, shear, march.push.creep)
        self.face = replace(face, lowest=march.steps[-1].lowest).starting(self.condition.displacement[frame.surface])
        self.push = self.face.push(self.condition.displacement[frame.surface])

    def press(self, lowest, rate_factor, every=1):
        """Come down in steps, or in `every` second one."""
        for height in np.linspace(self.face.lowest, lowest, PRESSING + 1)[every::every]:
            self.go(self.face.offset, height, rate_factor)

    def go(self, x, lowest, rate_factor):
        """Step to a place and a height, pc being larger by the rate factor meanwhile."""
        self._go(x, lowest, rate_factor, np.sign(x - self.face.offset))

    def turn_round(self, sign, rate_factor):
        """Take the friction and the torque of a way along `sign` x before it is gone."""
        self._go(self.face.offset, self.face.lowest, rate_factor, sign)

    def _go(self, x, lowest, rate_factor, sign):
        way, before = x - self.face.offset, self.face.forces(self.push)
        tractions, change = self._foreseen(way)
        face = self._facing(sign).carrying(*tractions, self.push.creep)
        face = face.starting(self.condition.displacement[self.frame.surface]).at(lowest, x)
        self.frame.solid.rate_factor = rate_factor
        balance = self._balanced(face, self.condition.displacement + change)
        self._refuse_skid(face, balance.push)
        push, change = balance.push, balance.after.displacement - self.condition.displacement
        turned = way + push.ahead if self.turns else 0.0
        load, resistance = np.add(before, face.forces(push)) / 2
        rubbed = self._rubbed(face, balance, change, way, turned)
        self.angle += turned / face.radius
        self.given += resistance * way - load * (lowest - self.face.lowest) - sign * self.pull * turned - rubbed
        self.rubbed += rubbed
        self.kept += self.frame.solid.area @ (balance.after.work - self.condition.work)
        self.past = [*self.past[1 - round(1 / STEP_LENGTH) :], (x, way, (push.pressure, push.shear), change)]
        self.condition, self.push, self.iterations = balance.after, push, self.iterations + balance.iterations
        self.face = face.carrying(push.pressure, push.shear, push.creep)

    def _facing(self, sign):
        """The face of a roller that goes along `sign` x, or comes down for 0."""
        return replace(self.face, **({"pull": sign * self.pull} if self.turns else {"friction": sign * self.friction}))

    @property
    def set_valued(self):
        """Whether the roller drags or is turned one way or the other, and at rest anything between."""
        return bool(self.friction or self.pull)

    @property
    def stand(self):
        """The `RollerState` now."""
        x = self.face.place[:, 0] + self.condition.displacement[self.frame.surface, 0] - self.face.offset
        touching, edges = np.flatnonzero(self.push.pressure > 0), (np.nan, np.nan)
        if len(touching):
            first, last = touching[[0, -1]]
            edges = float(x[last] + x[last + 1]) / 2, float(x[first - 1] + x[first]) / 2
        forces = self.face.forces(self.push)
        works = self.given, self.rubbed, self.kept
        return RollerState(self.face.offset, self.face.lowest, *forces, *edges, self.angle, *works)

    @property
    def left(self):
        """`LayerState` of what lies in the middle of the way."""
        middle = int(np.searchsorted(self.frame.row_x, self.span / 2))
        return left(self.frame, self.condition, middle)[0]

    @property
    def fields(self):
        """meshio mesh of the fields, as `compacted.fields` has them, in the places of the motion."""
        mesh = drawn(self.frame, self.condition)
        mesh.points[:, 0] += self.low
        return mesh

    def _foreseen(self, way):
        """Tractions and change of the displacement in a step: as one element before, or as the tractions were last."""
        x, sign = self.face.offset + way, np.sign(way)
        shift, tractions = way, (self.push.pressure, self.push.shear)
        change = np.zeros_like(self.condition.displacement)
        for place, gone, pressed, moved in self.past:
            if way and abs(x - place - sign * self.element) + abs(way - gone) < PLACE_TOLERANCE * self.element:
                shift, tractions, change = sign * self.element, pressed, self._moved[sign] @ moved
        change.ravel()[self.frame.held] = 0.0
        nodes = self.face.place[:, 0]
        return [np.interp(nodes - shift, nodes, traction) for traction in tractions], change

    @cached_property
    def _moved(self):
        """Fields of the nodes moved on by an element, by the sign of the way."""
        (x, y), probes = self.frame.nodes.T, self.frame.solid.basis.probes
        low, high = x.min(), x.max()
        return {sign: probes(np.array([np.clip(x - sign * self.element, low, high), y])) for sign in (1.0, -1.0)}

    def _balanced(self, face, guess):
        """The `Balance` of a step: the roller's pressures are given on until the mix does not enter it."""
        iterations = 0
        for _ in range(GIVEN_ON):
            balance = self._pressed(face, guess)
            iterations += balance.iterations
            push = balance.push
            if face.missed(push) <= ENTERED * push.pressure.max():
                break
            face, guess = face.carrying(push.pressure, push.shear, push.creep), balance.after.displacement
        return replace(balance, iterations=iterations)

    def _pressed(self, face, guess):
        """The `Balance` with the pressures carried, of a softer roller if need be."""
        try:
            return self.balancer.balanced(self.condition, face, guess)
        except NotBalancedError:
            self.balancer.factor = None
        try:
            soft = replace(face, penalty=SOFTER * face.penalty)
            return self.balancer.balanced(self.condition, soft, self.condition.displacement)
        except NotBalancedError as reason:
            load, resistance = self.face.forces(self.push)
            raise RuntimeError(
                f"no balance on the way from {self.face.offset:.6g} to {face.offset:.6g} m, lowest generatrix "
                f"{face.lowest:.6g} m: {reason}; reached: load {load:.6g} N/m, resistance {resistance:.6g} N/m"
            ) from reason

    def _refuse_skid(self, face, push):
        """A torque beyond what friction holds slips all over, and nothing tells how fast."""
        if self.turns and face.pull and face.asked(push) >= 1:
            raise RuntimeError(
                f"the roller skids at {face.offset:.6g} m: {face.asked(push):.3g} times the friction limit asked"
            )

    def _rubbed(self, face, balance, change, way, turned):
        """Work that slip of the mix along the roller takes, whose surface has `turned` back under its axle [J/m]."""
        surface = self.frame.surface
        slip = np.array([way, 0.0]) - change[surface]
        along = np.sum(face.tangent(balance.after.displacement[surface]) * slip, axis=1) - turned
        return face.weight * (self.push.shear + balance.push.shear) / 2 @ along


INCREMENTS = 6  # elements per contact length sqrt(2 R depth)
NUMBERS = (
    "position",
    "lowest",
    "load",
    "resistance",
    "leading",
    "trailing",
    "angle",
    "given",
    "rubbed",
    "kept",
)  # of a `RollerState`


@dataclass(frozen=True, eq=False, kw_only=True)
class CompactionTransientResult(TransientResult):
    """A `TransientResult` over compacting mix.

    Where mix is fed, or friction or torque turns round, the time of the turn stands twice, before and after.

    stroke : number of the stroke, from 1, shape (n,)
    lowest : height of the lowest generatrix [m], shape (n,)
    angle : by which the roller has turned [rad], + as it rolls along +x; 0 of one that does not turn, shape (n,)
    given : work of the roller, int resistance dx - int load dlowest + int torque dangle, without what slip takes
        [J/m], shape (n,)
    rubbed : work that slip takes [J/m], shape (n,)
    kept : work that the mix took up meanwhile, int J sigma : d strain [J/m], shape (n,)
    left : `LayerState` of what lies in the middle of the stroke after each
    iterations : of Newton's method, all of them
    """

    stroke: np.ndarray
    lowest: np.ndarray
    angle: np.ndarray
    given: np.ndarray
    rubbed: np.ndarray
    kept: np.ndarray
    left: tuple[LayerState, ...]
    iterations: int

    @property
    def work_residual(self):
        """Largest difference of work given and kept over the most that was given."""
        return float(np.abs(self.given - self.kept).max() / np.abs(self.given).max())

    @property
    def density_ratio(self):
        """Mean over the height in the middle of the stroke, after each."""
        return tuple(lies.density_ratio for lies in self.left)


def simulate_reciprocating(
    layer,
    roller,
    material,
    motion,
    *,
    torque=None,
    feed=0.0,
    fed=None,
    start=None,
    strain="finite",
    increments=INCREMENTS,
    instants=(),
    estimate=True,
):
    """A roller at a given indentation that travels over compacting mix, a `CompactionTransientResult`.

    At first the roller stands pressed into mix that lies flat, or comes in steady motion from a `start`.

    Parameters
    ----------
    layer : Layer, bonded; its height is that of the mix before the first stroke
    roller : Roller with an `indentation`, every profile; "sliding" with the traction f p on the mix along the travel,
        "free" or "driven", which stick and slip
    material : Compaction
    motion : with `position` and `velocity` of time and `duration` [s], as `Motion` and `Cycle`
    torque : on a roller that is free or driven, per unit length, + turning it the way it travels [N]; without it a
        free roller has none
    feed : height of fresh mix that is spread before every stroke but the first [m]
    fed : `LayerState` of an earlier pass, as of `compaction.roll`; without it fresh mix
    start : CompactionContactResult over the same layer, towards which the motion begins
    strain : "finite" or "small"
    increments : elements per contact length, each travelled in two steps
    instants : times whose fields are kept as `frames`, each at the nearest end of a step [s]
    estimate : whether to tell the error, from steps twice as long; half as much work again

    Raises RuntimeError with the place reached where no balance is found or the torque makes the roller skid.
    """
    way = stroke_schedule(motion)
    _refuse(layer, roller, material, way, feed, strain, fed, start)
    require_torque_allowed(roller, torque)
    require_integers(increments=increments)
    require_finite(instants=instants)
    length = float(np.sqrt(2 * roller.radius * roller.indentation))
    element = way.span / np.ceil(way.span * increments / length * (1 - PLACE_TOLERANCE))
    job = _Job(layer, roller, torque, material, way, element, length, feed, fed, start, strain == "finite")
    with threadpool_limits(1):
        done = job.done(1, instants)
        rough = job.done(2) if estimate else None
    return _result(way, done, rough)


@dataclass(eq=False)
class _Done:
    """What strokes have given: (stroke, time, `RollerState`) of each step, `LayerState` of each stroke, frames, and the `Trip`s."""

    steps: list
    left: list
    frames: list
    trips: list


@dataclass(frozen=True, eq=False)
class _Job:
    """What is asked of `simulate_reciprocating`, and the lengths of an element and of the contact."""

    layer: object
    roller: object
    torque: float | None
    material: object
    way: object
    element: float
    length: float
    feed: float
    fed: LayerState | None
    start: object
    finite: bool

    def done(self, every, instants=()):
        """The `_Done` of all strokes, in steps or in `every` second one."""
        done, trip = _Done([], [], [], []), None
        for stroke in range(self.way.count):
            times, places = self.way.steps(stroke, self.element, every)
            rates = [self.material.rate_factor(speed) for speed in np.diff(places) / np.diff(times)]
            wanted = self.way.nearest(stroke, times, instants)
            anew = trip is None or self.feed > 0
            trip = self._begun(done, places[0], rates[0], every) if anew else trip
            if trip.set_valued:
                if anew:
                    done.steps.append((stroke, times[0], trip.stand))
                trip.turn_round(np.sign(places[1] - places[0]), rates[0])
            for k, (time, place) in enumerate(zip(times, places, strict=True)):
                if k:
                    trip.go(place, trip.face.lowest, rates[k - 1])
                if k or anew or trip.set_valued:
                    done.steps.append((stroke, time, trip.stand))
                if k in wanted:
                    done.frames.append((float(time), trip.fields))
            done.left.append(trip.left)
        return done

    def _begun(self, done, place, rate, every):
        """The `Trip` before a stroke: over what was left and is fed now, over the first layer or from the start."""
        fed = done.left[-1].under(self.feed, self.material) if done.left else self.fed
        height = self.layer.height if fed is None else fed.height
        given = {"torque": self.torque, "element": self.element, "length": self.length, "finite": self.finite}
        trip = Trip(self.way, self.roller, self.material, height, fed=fed, place=place, **given)
        if done.trips:
            trip.given, trip.kept = done.trips[-1].given, done.trips[-1].kept
        done.trips.append(trip)
        if self.start is not None and not done.left:
            trip.take_over(self.start.march)
        else:
            trip.press(height - self.roller.indentation, rate, every)
        return trip


def _result(way, done, rough):
    """The `CompactionTransientResult`, with the error that steps twice as long tell."""
    stroke, time, stands = zip(*done.steps, strict=True)
    numbers = {name: np.array([getattr(stand, name) for stand in stands]) for name in NUMBERS}
    return CompactionTransientResult(
        time=np.array(time),
        velocity=way.motion.velocity(np.array(time)),
        stroke=np.array(stroke) + 1,
        left=tuple(done.left),
        frames=tuple(done.frames),
        iterations=sum(trip.iterations for trip in done.trips),
        error=None if rough is None else _error(done, rough),
        steps=len(done.steps) + (len(rough.steps) if rough else 0),
        **numbers,
    )


def _error(done, rough):
    """Largest difference of the resistance where both have been, over the largest resistance."""
    fine, coarse = ({(stroke, time): stand.resistance for stroke, time, stand in run.steps} for run in (done, rough))
    return max(abs(fine[where] - coarse[where]) for where in coarse) / max(map(abs, fine.values()))


def _refuse(layer, roller, material, way, feed, strain, fed, start):
    if roller.indentation is None:
        raise ValueError(f"a roller that travels keeps its height: give its `indentation`, got its {roller.target[0]}")
    require_compactable(layer, roller, material, 1.0, strain, None, fed)
    if layer.base != "bonded":
        raise ValueError(f"`base` must be 'bonded': nothing holds the ends of a layer that slips, got {layer.base!r}")
    if not way.span > 0:
        raise ValueError(f"`motion` must move the roller, got one that stays at {way.low!r} m")
    require_nonnegative(feed=feed)
    if feed and not roller.indentation < feed * (1 - material.fed_density_ratio):
        least = roller.indentation / (1 - material.fed_density_ratio)
        raise ValueError(f"`feed` must be more than {least:.4g} m to leave mix short of full density, got {feed!r} m")
    if start is not None:
        _refuse_start(start, layer, roller, way, fed)


def _refuse_start(start, layer, roller, way, fed):
    same = start.layer == layer and start.march.frame.given is fed
    if not same or abs(start.indentation - roller.indentation) > PLACE_TOLERANCE * roller.indentation:
        raise ValueError("`start` must have rolled over the same `layer` and `fed` mix at the same `indentation`")
    if start.speed < 0 or way.places[1] < way.places[0]:
        raise ValueError("`start` must roll along +x, and the `motion` begin that way")
