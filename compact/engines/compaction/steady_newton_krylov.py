"""Steady rolling at once: the displacement under which a layer and a roller balance while the mix streams through.

    R(u, pressure) = forces of the layer(states(u)) - forces of the roller = 0,    pressure gap = skin, nearly 0

The states follow from the displacement by one sweep along the rows (`flow`; Dang Van and Maitournam 1993), from point
to point. Newton's method solves for all at once: GMRES with the exact derivative along the rows, preconditioned by the
stiffness with the mix upstream frozen. A skin on the roller rounds the corner between touching and not, at which
nodes would go to and fro; it is thinned once the balance is found. The shear of a roller that turns follows from the
slip of the motion and one creep (`turning.Slip`). A step is cut until the residual, measured as the displacement that
it makes with the mix upstream frozen, has shrunk: forces alone weigh the stiff, short waves too much. Where no cut
helps, a share of the elastic stiffness is added.

It needs a displacement to start from: a neighbour, a march that is roughly steady, or mix as soft as in `stiffening`.

A cold start of steady rolling: the balance of a layer so soft that it hardly yields, stiffened to the one asked for.

    R(u, share E_u) = 0,    share from SOFTEST yield pressures over E_u to 1

A soft layer under the roller is found from rest, like any contact. As its modulus of unloading rises, the mix keeps
more of what it was pressed to, and the bow wave grows to its height; the strain that is not elastic changes ever less.
Each balance is foreseen along the line through the last two, over the logarithm of the share. Nothing is marched, and
no wave must fill.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres

from compact.engines.compaction.finite_strain_solid import SUBSTEPS, Condition
from compact.engines.compaction.newton import Balance, NotBalancedError, unbalanced
from compact.engines.compaction.roller_contact import STICKING, RollingSurface
from compact.engines.compaction.streamline_integration import StreamlineIntegrator, StreamlineState, changes
from compact.material import cap_plasticity

RESIDUAL = 1e-6  # of the forces of the roller
ITERATIONS = 60  # twice as many where the balance is not one on the way to another
PATIENCE = 20  # iterations, after which less than the forces of the roller must be left of such a one
PRODUCTS = 150  # of GMRES in one iteration; 30 to 90 are usual
LINEAR = 3e-2  # of the residual may be left by GMRES
CUTS = 8
NOTHING = 1e-9  # of the modulus times a step, a force
LITTLE = 0.1  # of what a step promises it must keep
SKIN = 0.1  # of the fed mix's yield pressure, that a node half in contact bears while the balance is sought
SHARP = 3e-3  # the same once it is found: nodes that touch are then within 1e-6 of the depth
STIFF = 1e3  # modulus over step, against which the gap of a touching node is kept closed
FIRST_SHARE = 1e-3  # of the elastic stiffness, where no cut of a step helps
MOST = 1.0
MISSES = 3  # in a row, after which it gives up
UNITY = np.array([1.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Trial:
    """A displacement with the pressures of the touchable nodes, and what follows.

    gradients, stress : of the points;  face, slip : of the touchable nodes;  unit : `Push` of pressures of 1
    open_ : by which pressures and gaps of nodes miss the skin [Pa]
    residual : layer less roller, shape (N, 2);  size : of it and of the gaps, over the forces of the roller
    """

    displacement: np.ndarray
    pressure: np.ndarray
    gradients: np.ndarray
    flow: StreamlineState
    stress: np.ndarray
    face: object
    slip: object
    unit: object
    open_: np.ndarray
    residual: np.ndarray
    size: float


class Steady:
    """A layer in a `Frame` under a `Face` in steady motion; `progress` is called with a line after each iteration."""

    def __init__(self, frame, face, substeps=SUBSTEPS, progress=None):
        self.frame, self.solid, self.progress = frame, frame.solid, progress
        solid = frame.solid
        self.stream = StreamlineIntegrator(solid.law, frame.fed.state, solid.rate_factor, solid.finite, substeps)
        face = face.at(face.lowest, -frame.step).starting(np.zeros_like(face.place)).at(face.lowest)
        self.touchable = np.flatnonzero(np.abs(face.place[:, 0] - face.offset) < face.radius * (1 - 1e-9))
        kept = {name: getattr(face, name)[self.touchable] for name in ("place", "weight", "carried")}
        self.nodes = frame.surface[self.touchable]
        self.whole, self.carried = face, kept.pop("carried")
        self.one = replace(face, **kept, penalty=0.0, carried=np.ones(len(self.nodes)))
        self.came = frame.from_upstream(self.nodes)
        yields = solid.law.yield_pressure(float(frame.fed.state.max_density_ratio[-1])) * solid.rate_factor
        self.closing, self.yields = yields * 2 * face.radius / frame.step**2, yields
        self.skin = SKIN * yields
        self.products = 0

    def balanced(self, displacement, share=0.0, residual=None):
        """The `Balance` near a displacement and the pressures that the face carries.

        share : of the elastic stiffness added at first, which keeps to a neighbour's solution
        residual : of the forces of the roller that may be left, RESIDUAL

        Raises NotBalancedError with what was reached.
        """
        misses, history, smooth = 0, [], None
        trial = self._trial(displacement, self.carried)
        for iteration in range(ITERATIONS if residual else 2 * ITERATIONS):
            history.append(trial.size)
            if self.progress is not None:
                self.progress(
                    f"{round(self.frame.length / self.frame.step)} increments a contact, direct solution, iteration "
                    f"{iteration + 1}: {trial.size:.1e} of the forces unbalanced"
                )
            if trial.size <= (residual or RESIDUAL):
                if residual or smooth:
                    return self._balance(trial, iteration)
                smooth, self.skin = trial, SHARP * self.yields
                trial = self._trial(trial.displacement, trial.pressure)
            if iteration == PATIENCE and trial.size > 1 and not residual:
                break
            length, moved = _Linear(self, trial, share).searched()
            if moved is None:
                share, misses = min(max(8 * share, FIRST_SHARE), MOST), misses + 1
                if misses == MISSES:
                    break
                continue
            share, misses, trial = _next_share(share, length), 0, moved
        if smooth:  # the edges of the contact do not come to rest at one node
            return self._balance(smooth, iteration)
        raise NotBalancedError(f"no steady balance: {unbalanced(history)}")

    def _balance(self, trial, iterations):
        push = self._push(trial)
        deepest = np.delete(push.gap, self.touchable).min(initial=0.0)
        if deepest < 0:
            raise NotBalancedError(f"mix from beyond the roller is carried {-deepest:.2g} m into it")
        numbers, points = trial.flow.numbers, self.frame.points
        state = cap_plasticity.MaterialPoint(
            points(numbers[..., :4]), *(points(numbers[..., k]) for k in (4, 5)), points(trial.flow.plastic_work)
        )
        after = Condition(trial.displacement, state, points(trial.flow.work))
        return Balance(after, push, trial.size, iterations)

    def _push(self, trial):
        """Of all surface nodes; the pressure of those that do not touch is none."""
        touching = trial.pressure > self.closing * trial.unit.gap
        carried, surface = np.zeros(len(self.whole.place)), self.frame.surface
        carried[self.touchable] = np.where(touching, trial.pressure, 0.0)
        here, before = trial.displacement[surface], self.frame.from_upstream(surface) @ trial.displacement
        face, slip = self.whole.at_once(here, before, carried)
        push = replace(face, carried=carried, penalty=0.0).pressed(here)
        return push if slip is None else replace(push, creep=slip.creep)

    def _trial(self, displacement, pressure):
        """The `Trial` of a displacement and pressures; raises NotBalancedError where elements fold over."""
        try:
            with np.errstate(invalid="raise", divide="raise", over="raise"):
                return self._evaluated(displacement, pressure)
        except (FloatingPointError, RuntimeError) as error:  # of numpy, and of the streamlines
            raise NotBalancedError("no steady balance: elements of the layer fold over") from error

    def _evaluated(self, displacement, pressure):
        displacement = self.frame.passed(displacement)
        gradients = self.solid.gradient(displacement)
        flow = self.stream.along(self.frame.rows(gradients))
        stress = self.frame.points(flow.numbers[..., :4])
        face, slip = self.one.at_once(displacement[self.nodes], self.came @ displacement, pressure)
        unit = face.pressed(displacement[self.nodes])
        residual = self._assembled(_piola(gradients, stress, self.solid.finite))
        pushed = unit.forces * pressure[:, None]
        residual[self.nodes] -= pushed
        closed = self.closing * unit.gap
        open_ = (pressure + closed - np.hypot(pressure - closed, 2 * self.skin)) / 2
        size = np.hypot(np.linalg.norm(residual.ravel()[self.solid.order]), np.linalg.norm(open_ * face.weight))
        size /= max(np.linalg.norm(pushed), NOTHING * self.solid.law.unloading_modulus * self.frame.step)
        return Trial(displacement, pressure, gradients, flow, stress, face, slip, unit, open_, residual, float(size))

    def _assembled(self, piola):
        """Forces of the nodes under stresses on the reference, shape (N, 2)."""
        solid = self.solid
        stress = (piola * solid.area[:, None]).reshape(*solid.basis.dx.shape, 2, 2)
        nodal = np.matmul(solid.slopes, stress.transpose(0, 1, 3, 2)).sum(axis=1)
        nodes = solid.basis.element_dofs.T.ravel()
        return np.stack([np.bincount(nodes, nodal[..., i].ravel(), solid.basis.N) for i in range(2)], axis=-1)

    @cached_property
    def gradient_matrix(self):
        """Gradients of the points by the unknowns of their elements, shape (elements, points, 4, 16)."""
        slopes = self.solid.slopes.transpose(0, 1, 3, 2)
        matrix = np.zeros((*slopes.shape[:2], 4, 16))
        matrix[:, :, 0:2, 0::2] = matrix[:, :, 2:4, 1::2] = slopes
        return matrix

    @cached_property
    def elastic_blocks(self):
        """Of the mix at rest, shape (elements, 16, 16)."""
        rest = self.solid.at_rest()
        return self.solid.moved(rest, rest.displacement).blocks


class _Linear:
    """The equations of one iteration of Newton's method, with a share of the elastic stiffness added."""

    def __init__(self, steady, trial, share):
        self.steady, self.trial, self.share = steady, trial, share
        frame, solid, unit = steady.frame, steady.solid, trial.unit
        self.slopes = steady.stream.derivatives(frame.rows(trial.gradients), trial.flow)
        here, face = trial.displacement[steady.nodes], trial.face
        self.normal = replace(face, friction=0.0).pressed(here).forces / face.weight[:, None]
        self.pulled = (face.weight * trial.pressure)[:, None] * face.tangent(here)
        stiffest = STIFF * solid.law.unloading_modulus / frame.step
        apart = trial.pressure - steady.closing * unit.gap
        apart = apart / np.hypot(apart, 2 * steady.skin)
        self.free = np.maximum(1 - apart, 2 * steady.closing / stiffest)  # 0 where a node touches, 2 where it does not
        self.near = (1 + apart) * steady.closing
        self.stiff = self.near / self.free
        self.rest = self._apart(trial) - 2 * trial.open_
        closing = self.stiff[:, None, None] * unit.forces[:, :, None] * self.normal[:, None, :]
        self.added = unit.stiffness * trial.pressure[:, None, None] + closing
        self.factor = solid.factorised(self._blocks(), steady.nodes, self.added)

    def searched(self):
        """Length of the step and the `Trial` there; None where no cut of it does."""
        steady, trial = self.steady, self.trial
        change, pressure, start, promised = self._step()
        length = 1.0
        for _ in range(CUTS):
            try:
                moved = steady._trial(trial.displacement + length * change, trial.pressure + length * pressure)
            except RuntimeError:
                moved = None
            if moved is not None and np.linalg.norm(self._local(moved)) < (1 - LITTLE * length * promised) * start:
                return length, moved
            length /= 2
        return 0.0, None

    def _step(self):
        """Changes of displacement and pressures, size of the residual, and the part of it that a whole step takes."""
        steady, trial = self.steady, self.trial
        wanted = self._local(trial)
        operator = LinearOperator((wanted.size,) * 2, matvec=lambda x: self.factor(self._product(x)), dtype=float)
        found, _ = gmres(operator, wanted, rtol=LINEAR, restart=PRODUCTS, maxiter=1)
        change = self._spread(found)
        pressure = self._missing(trial) - self.stiff * np.sum(self.normal * change[steady.nodes], axis=1)
        left = self.factor(self._product(found) - self._elastic(change)) - wanted
        start = np.linalg.norm(wanted)
        return change, pressure, start, max(1 - np.linalg.norm(left) / start, 0.0)

    def _local(self, trial):
        """The displacement that a residual makes with the mix upstream frozen."""
        nodes, missing = self.steady.nodes, self._missing(trial)
        residual = -trial.residual
        residual[nodes] += trial.unit.forces * missing[:, None]
        if trial.slip is not None:
            still = np.zeros((len(nodes), 2))
            residual[nodes] += self.pulled * self._gripped(missing, still, still)[:, None]
        return self.factor(residual.ravel()[self.steady.solid.order])

    def _missing(self, trial):
        """Pressure by which contact would be closed where it is open, as if nodes stayed as near to it."""
        return (self.rest - self._apart(trial)) / self.free

    def _apart(self, trial):
        return self.free * trial.pressure + self.near * trial.unit.gap

    def _gripped(self, pressure, displacement, before):
        """Changes of friction with those of the pressure, and of displacements of the nodes."""
        trial = self.trial
        return trial.slip.change(trial.face, trial.pressure, pressure, displacement, before)

    def _product(self, found):
        """Forces by the free unknowns, with all that happens downstream."""
        steady = self.steady
        steady.products += 1
        change = self._spread(found)
        gradients = steady.solid.gradient(change)
        numbers = changes(self.slopes, steady.frame.rows(gradients))
        stress = steady.frame.points(numbers[..., :4])
        forces = steady._assembled(self._piola_change(gradients, stress))
        here = change[steady.nodes]
        forces[steady.nodes] += np.einsum("nij,nj->ni", self.added, here)
        if self.trial.slip is not None:
            pressure = -self.stiff * np.sum(self.normal * here, axis=1)
            forces[steady.nodes] -= self.pulled * self._gripped(pressure, here, steady.came @ change)[:, None]
        return forces.ravel()[steady.solid.order] + self._elastic(change)

    def _spread(self, found):
        change = np.zeros(2 * self.steady.solid.basis.N)
        change[self.steady.solid.order] = found
        return self.steady.frame.passed(change.reshape(-1, 2))

    def _elastic(self, change):
        if not self.share:
            return 0.0
        solid = self.steady.solid
        forces = np.matmul(self.steady.elastic_blocks, change.ravel()[solid.unknowns][..., None])
        return self.share * np.bincount(solid.unknowns.ravel(), forces.ravel(), change.size)[solid.order]

    def _piola_change(self, gradients, stress):
        trial, finite = self.trial, self.steady.solid.finite
        change = _piola(trial.gradients, stress, finite)
        return change + _piola(gradients - UNITY, trial.stress, True) if finite else change

    def _blocks(self):
        """Stiffness of the elements with the mix upstream frozen."""
        steady, matrix = self.steady, self.steady.gradient_matrix
        by_gradient = steady.frame.points(self.slopes[..., :4, 10:])
        moduli = np.empty((len(by_gradient), 4, 4))
        for k, gradient in enumerate(np.eye(4)):
            moduli[:, :, k] = self._piola_change(np.broadcast_to(gradient, (len(moduli), 4)), by_gradient[:, :, k])
        weighted = moduli.reshape(*matrix.shape[:2], 4, 4) * steady.solid.basis.dx[..., None, None]
        count = len(matrix)
        turned = np.matmul(weighted, matrix).reshape(count, -1, 16)
        blocks = np.matmul(matrix.reshape(count, -1, 16).transpose(0, 2, 1), turned)
        return blocks + self.share * steady.elastic_blocks if self.share else blocks


def _piola(gradients, stress, finite):
    """Stress on the reference, J sigma F^-T, (xx, xy, yx, yy); sigma itself of small strains."""
    xx, yy, _, xy = stress.T
    if not finite:
        return np.stack([xx, xy, xy, yy], axis=-1)
    Fxx, Fxy, Fyx, Fyy = (gradients + UNITY).T
    return np.stack([xx * Fyy - xy * Fxy, xy * Fxx - xx * Fyx, xy * Fyy - yy * Fxy, yy * Fxx - xy * Fyx], axis=-1)


def _next_share(share, length):
    if length == 1:
        return share / 4 if share > FIRST_SHARE / 100 else 0.0
    if length == 0.5:
        return share / 1.4
    return min(max(2 * share, FIRST_SHARE / 10), MOST) if length < 0.1 else share


SOFTEST = 13.0  # yield pressures of the fed mix
SOFTER = 4  # times half as soft, where that is not found from rest
FIRST = 1.5  # ratio of the first two shares
SHORTEST = 5e-3  # of the logarithm of the share, a step below which it gives up
QUICK, SLOW = 8, 14  # iterations within which a step may grow, and beyond which it shrinks
ROUGH = 3e-3  # residual on the way, and where it ends before the last balance
SHARPER = 0.85  # power of the share by which slip that is taken for sticking gets less


def stiffened(march_of, lowest):
    """A `March` that is steady with the lowest generatrix at a height [m], found at once.

    march_of : gives a march that has not begun, of mix with a share of its unloading modulus

    Raises RuntimeError with the share reached.
    """
    share, there, step = _softest(march_of(1.0).frame), None, np.log(FIRST)
    here = _from_rest(march_of, share, lowest)
    share = here[1]
    while share < 1:
        ahead = min(share * np.exp(step), 1.0)
        march = march_of(ahead)
        try:
            _settled(march, _foreseen(here, there, ahead), lowest, ahead)
        except RuntimeError as error:
            step /= 2
            if step < SHORTEST:
                raise RuntimeError(f"found up to {share:.3g} of the unloading modulus, then: {error}") from error
            continue
        iterations = march.steps[-1].iterations
        step *= 1.4 if iterations < QUICK else 1 / 1.3 if iterations > SLOW else 1.0
        here, there, share = (march, ahead), here, ahead
    march = here[0]
    march.settled(
        Steady(march.frame, march.face.at(lowest), progress=march.progress).balanced(march.condition.displacement),
        lowest,
    )
    return march


def _from_rest(march_of, share, lowest):
    """The first march and its share, softer where it must be."""
    for _ in range(SOFTER):
        try:
            return _settled(march_of(share), None, lowest, share)
        except RuntimeError as error:
            reason, share = error, share / 2
    raise RuntimeError(f"not found even with {2 * share:.2g} of the unloading modulus: {reason}")


def _softest(frame):
    law = frame.solid.law
    yields = law.yield_pressure(float(frame.fed.state.max_density_ratio.max())) * frame.solid.rate_factor
    return min(SOFTEST * float(yields) / law.unloading_modulus, 1.0)


def _foreseen(here, there, share):
    """Displacement and pressure on the line through the last two, and shear and creep of the last."""
    (last, at), push = here, here[0].push
    displacement, pressure = last.condition.displacement, push.pressure
    if there is not None:
        before, behind = there
        way = np.log(share / at) / np.log(at / behind)
        displacement = displacement + way * (displacement - before.condition.displacement)
        pressure = np.maximum(pressure + way * (pressure - before.push.pressure), 0.0)
    return displacement, pressure, push.shear, push.creep


def _settled(march, foreseen, lowest, share):
    """The march in its steady balance, and the share."""
    if foreseen is None:
        foreseen = _without_grip(march, lowest)
    displacement, *carried = foreseen
    march.face = march.face.carrying(*carried)
    face = march.face.at(lowest)
    if isinstance(face, RollingSurface):
        face = replace(face, sticking=STICKING * share**-SHARPER)
    march.settled(Steady(march.frame, face, progress=march.progress).balanced(displacement, residual=ROUGH), lowest)
    return march, share


def _without_grip(march, lowest):
    """The balance from rest, without the shear of a roller that turns."""
    still = march.condition.displacement
    if not isinstance(march.face, RollingSurface):
        return still, march.face.carried, None, None
    face = replace(march.face, grip=0.0, pull=0.0).at(lowest)
    found = Steady(march.frame, face, progress=march.progress).balanced(still, residual=ROUGH)
    return found.after.displacement, found.push.pressure, found.push.shear, 0.0
