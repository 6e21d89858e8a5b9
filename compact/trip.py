"""A roller on its way over a layer whose mesh stays with the mix: one balanced step after the other, any way.

The tractions that the roller carries stay with it: before a step they go along the surface with the roller, and with
them the change of the displacement, as they were when it came to the node one element before.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from compact.compacted import drawn, left
from compact.equilibrium import Balancer, NotBalancedError
from compact.frame import Frame, stroke_mesh, transferred
from compact.march import PENALTY, SOFTER, THIN
from compact.pressing import Face
from compact.strokes import SAME, STEP
from compact.turning import TurningFace

PRESSING = 6  # steps of a roller that comes down
RESIDUAL = 1e-4  # of the nodal forces
ENTERED = 0.01  # of the largest pressure, by which that of a node may miss what was given on
GIVEN_ON = 10  # times in a step at most; one in ten steps on thick mix leaves more, which the next ones make up


@dataclass(frozen=True)
class Stand:
    """Where a roller is and what the layer does to it: as `CompactionTravelled` has it."""

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
    fed : what lies there, a `Fed` or None for fresh mix of a `height`;  place : x of the roller [m]
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
        kind = TurningFace if self.turns else Face
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
        self.past = [*self.past[1 - round(1 / STEP) :], (x, way, (push.pressure, push.shear), change)]
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
        """The `Stand` now."""
        x = self.face.place[:, 0] + self.condition.displacement[self.frame.surface, 0] - self.face.offset
        touching, edges = np.flatnonzero(self.push.pressure > 0), (np.nan, np.nan)
        if len(touching):
            first, last = touching[[0, -1]]
            edges = float(x[last] + x[last + 1]) / 2, float(x[first - 1] + x[first]) / 2
        forces = self.face.forces(self.push)
        works = self.given, self.rubbed, self.kept
        return Stand(self.face.offset, self.face.lowest, *forces, *edges, self.angle, *works)

    @property
    def left(self):
        """`Fed` of what lies in the middle of the way."""
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
            if way and abs(x - place - sign * self.element) + abs(way - gone) < SAME * self.element:
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
