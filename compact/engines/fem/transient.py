"""Roller of varying speed on an elastic or viscoelastic layer.

The mesh moves with the roller, the internal variables z_k belong to points X of the layer (see `convected_memory`):

    theta_k dz_k/dt + z_k = w(X - s(t), t),    u = J_0 w + sum J_k z_k,

with the position s(t) of the roller and the displacement w of the elastic layer in coordinates of the roller. Over a
time step w is linear in time at each x, and the convolution is integrated along s(t) itself:

    z_k <- exp(-T/theta_k) z_k + int exp(-(T - t)/theta_k) [(1 - t/T) w_old + (t/T) w_new](X - s(t)) dt/theta_k

The part of u that does not depend on w_new is the initial displacement of the surface, the other part its compliance.
Each step is one contact on the layer that was condensed once. Steady motion is exact for any step length.
The method is of second order; the step length follows from the deviation of the forces from their linear extrapolation.

A roller that turns with friction has zones of stick and slip. Coulomb's law holds for the slip velocity at the end of a
step (`stick_slip.FrictionCondition`), which is exact in steady motion and otherwise of first order. Tractions are
continuous at a reversal, except under sliding or a prescribed torque; the time then occurs twice.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from threadpoolctl import threadpool_limits

from compact.engines.fem import convected_memory
from compact.engines.fem.contact_patch import BeyondWindowError, solve_contact_patch
from compact.engines.fem.contact_problem import (
    ContactSolution,
    Discretisation,
    RollingProblem,
    elastic_surface,
    expand_window,
    solve_at_target,
    steady_surface,
)
from compact.engines.fem.discretisation import initial_discretisation
from compact.engines.fem.engine import require_linear_range
from compact.engines.fem.fields import transient_frames
from compact.engines.fem.stick_slip import FrictionCondition, solve_stick_slip
from compact.engines.fem.surface import SurfaceCompliance, shape_matrix
from compact.engines.stroke_schedule import smooth_intervals
from compact.material.laws import Elastic
from compact.mesh import DEFAULT_ERROR, RowMesh
from compact.numerics import Array
from compact.numerics.validation import require_finite, require_positive
from compact.rolling_contact import Layer, PrescribedMotion, Roller, TransientResult, require_torque_allowed

TIME_TOLERANCE = 1e-3  # [-], of int p |x| dx/R; error of the resistance by the time steps
POINTS_PER_WIDTH = 40  # [-], points of the layer, and instants of the motion, per half-width
MIN_INSTANTS = 4  # [-], instants of the motion in a step
MAX_TRAVEL = 2.0  # [-], travel in a step over the half-width
INITIAL_STEP = 0.02  # [-], over the shortest retardation time, after a discontinuity of the motion
MIN_STEP = 1e-3  # [-], over the same; shorter steps resolve the mesh only
TIME_ROUNDING = 1e-9  # [-], of the duration, within which two instants coincide
MAX_STEP_GROWTH, MIN_STEP_GROWTH = 2.0, 0.25  # [-], ratio of successive steps
STEP_SAFETY = 0.9  # [-], step over the one estimated to reach the tolerance


def simulate_transient(  # noqa: PLR0913 - the four physical inputs, and keywords of output and accuracy
    layer: Layer,
    roller: Roller,
    material: Elastic,
    motion: PrescribedMotion,
    *,
    torque: float | None = None,
    instants: Sequence[float] = (),
    frames: Sequence[float] = (),
    mesh: RowMesh | None = None,
    tolerance: float = DEFAULT_ERROR,
    time_tolerance: float = TIME_TOLERANCE,
    estimate: bool = True,
) -> TransientResult:
    """Simulate the motion of a roller at a constant indentation over a linear layer.

    Before t = 0 the roller is in steady motion at its initial velocity, or at rest on the relaxed layer.

    Parameters
    ----------
    layer : Layer
        Layer of any height, base and plies.
    roller : Roller
        Roller with an `indentation`, of any profile. A "sliding" one exerts the traction f p along the travel; a "free"
        or "driven" one has zones of stick and slip. On a frictionless base it must have no friction and a vertical gap.
    material : Elastic or Viscoelastic
        Material of the layer.
    motion : PrescribedMotion
        Position and velocity over the duration.
    torque : float, optional
        Torque on a free or driven roller per unit length [N], positive in the sense of rolling along the travel.
    instants : sequence of float
        Times at which steps end [s].
    frames : sequence of float
        Times at which the fields inside the layer are computed [s].
    mesh : RowMesh, optional
        Mesh of the layer, as of `engine.roll`.
    tolerance : float
        Relative error for which a mesh is chosen [-].
    time_tolerance : float
        Error of the resistance by the time steps, relative to int p |x| dx/R [-].
    estimate : bool
        Estimate the error by the time steps from steps twice as long, for half the work again.

    Raises
    ------
    RuntimeError
        If a contact is not found.

    Examples
    --------
    >>> from compact.material.laws import Viscoelastic
    >>> from compact.motion.profile import law
    >>> from compact.rolling_contact import Layer, Roller
    >>> mix = Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),))
    >>> stroke = law("quintic", stroke=0.1, duration=1.0)
    >>> result = simulate_transient(Layer(0.22), Roller(0.11, indentation=0.003), mix, stroke)
    >>> f"{result.resistance.max():.0f} N/m at most, error by the time steps {100 * result.error:.1f} %"
    '505 N/m at most, error by the time steps 0.1 %'
    """
    require_linear_range(layer, roller, material, 1.0, mesh, tolerance)
    require_positive(time_tolerance=time_tolerance)
    _require_times_within(motion, (*instants, *frames))
    _require_transient_range(layer, roller)
    require_torque_allowed(roller, torque)
    problem = RollingProblem(layer, roller, material, float(np.sign(_initial_velocity(motion))), torque or 0.0)
    reversible = roller.friction > 0 and roller.rolling != "frictionless"
    breaks = smooth_intervals(motion, turns=reversible)
    instants, frames = _snapped(instants, breaks), _snapped(frames, breaks)
    with threadpool_limits(1):  # the matrices are small; threads cost more than they save
        previous = _problem_before(problem, motion)
        discretisation = initial_discretisation(previous, mesh, tolerance)

        def integrate(window: float) -> tuple[TransientProblem, list[TransientState], list[TransientState] | None]:
            start, transient = _initial_state(problem, previous, discretisation, window, motion, time_tolerance)
            states = _integrate_adaptively(transient, start, breaks, sorted({*breaks, *instants, *frames}))
            coarse = _integrate_at(transient, start, breaks, _every_second(states, breaks)) if estimate else None
            return transient, states, coarse

        transient, states, coarse = expand_window(discretisation, integrate)
        result = _transient_result(states, coarse, problem, motion)
        if not frames:
            return result
        velocity, mesh = _initial_velocity(motion), discretisation.mesh
        meshes = transient_frames(layer, material, mesh, states, transient.positions, velocity, frames)
    return replace(result, frames=meshes)


@dataclass(frozen=True, eq=False)
class TransientProblem:
    """Data common to all time steps.

    Parameters
    ----------
    problem : RollingProblem
        Layer, roller and material; its speed is the direction of travel, 1 or -1, or 0 while the roller is at rest.
    terms : int
        Pressure terms.
    half_width : float
        Half-width of the contact [m].
    tolerance : float
        Error of the resistance by the time steps, relative to int p |x| dx/R [-].
    """

    surface: SurfaceCompliance
    problem: RollingProblem
    terms: int
    creep: convected_memory.CreepFunction
    motion: PrescribedMotion
    half_width: float
    tolerance: float

    @property
    def jumps_at_reversal(self) -> bool:
        """True if the tractions are discontinuous at a reversal, by sliding or by a torque."""
        problem = self.problem
        return bool(problem.traction_ratio or (problem.turns_with_friction and problem.torque))

    @property
    def shortest_time(self) -> float:
        """Shortest retardation time; the duration of the motion for an elastic layer [s]."""
        return min(self.creep.times, default=self.motion.duration)

    def friction(self, velocity: float, interval: float, previous: Array) -> FrictionCondition | None:
        """Friction condition of a roller that turns, for its velocity [m/s] and a step [s]; None of any other.

        `previous` is the displacement before the step at the surface nodes of the step [m], shape (2, n).
        """
        if not self.problem.turns_with_friction:
            return None
        direction = self.problem.speed or 1.0
        force = self.problem.tangential_force(direction)
        return FrictionCondition(self.problem.roller.friction, force, direction, velocity, 1 / interval, previous)

    def positions(self, begin: float, end: float) -> Array:
        """Positions [m] at even instants between two times [s], close enough for the contact, shape (n + 1,)."""
        rough = self.motion.position(np.linspace(begin, end, 2 * POINTS_PER_WIDTH + 1))
        count = max(MIN_INSTANTS, int(np.ceil(np.abs(np.diff(rough)).sum() * POINTS_PER_WIDTH / self.half_width)))
        return self.motion.position(np.linspace(begin, end, count + 1))


@dataclass(frozen=True, eq=False)
class TransientState:
    """State of the motion at one instant.

    Parameters
    ----------
    time, position : float
        Time [s] and position of the roller [m].
    displacement : ndarray
        Elastic displacement w of the surface nodes [m], shape (2, n).
    places, internal : ndarray
        Points of the layer, shape (m,), and internal variables z_k there, shape (k, 2, m) [m].
    angle : float
        Rotation of a roller that turns [rad].
    """

    time: float
    position: float
    contact: ContactSolution
    displacement: Array
    places: Array
    internal: Array
    angle: float = 0.0

    @property
    def forces(self) -> Array:
        """Forces on the surface nodes over the relaxed modulus [m], shape (2, n)."""
        return self.contact.forces

    @property
    def moments(self) -> Array:
        """Forces on the nodes times |x|/R [m], shape (2, n)."""
        return self.contact.forces * np.abs(self.contact.surface.x) / self.contact.indenter.radius


def _problem_before(problem: RollingProblem, motion: PrescribedMotion) -> RollingProblem:
    """Steady problem before t = 0; for a roller at rest the relaxed layer without traction."""
    if problem.speed:
        return replace(problem, speed=_initial_velocity(motion))
    material, roller = problem.material, replace(problem.roller, rolling="frictionless")
    return RollingProblem(problem.layer, roller, Elastic(material.youngs_modulus, material.poisson), 1.0)


def _initial_state(
    problem: RollingProblem,
    previous: RollingProblem,
    discretisation: Discretisation,
    window: float,
    motion: PrescribedMotion,
    tolerance: float,
) -> tuple[TransientState, TransientProblem]:
    """State at t = 0 and the data of all steps."""
    surface = elastic_surface(replace(problem, speed=problem.speed or 1.0), discretisation.mesh, window)
    creep = convected_memory.creep_function(problem.material)
    contact = solve_at_target(previous, steady_surface(previous, discretisation.mesh, window), discretisation)
    terms, half_width = discretisation.terms, discretisation.half_width
    transient = TransientProblem(surface, problem, terms, creep, motion, half_width, tolerance)
    places, position = _layer_points(transient), float(motion.position(np.zeros(1))[0])
    w = surface.displacement(contact.forces[:, surface.loaded])
    internal = convected_memory.steady_internal_variables(
        creep, surface.x, w, _initial_velocity(motion), places - position
    )
    return TransientState(0.0, position, contact, w, places, internal), transient


def _initial_velocity(motion: PrescribedMotion) -> float:
    return float(motion.velocity(np.zeros(1))[0])


def _layer_points(transient: TransientProblem) -> Array:
    """Points of the layer [m], dense where the roller passes and as far as the mesh extends, shape (m,)."""
    x, size = transient.surface.x, transient.half_width / POINTS_PER_WIDTH
    passed = transient.positions(0.0, transient.motion.duration)
    low, high = passed.min() - 2 * transient.half_width, passed.max() + 2 * transient.half_width
    dense = np.linspace(low, high, int(np.ceil((high - low) / size)) + 1)
    ahead = x[x > 2 * transient.half_width] + passed.max()
    behind = x[x < -2 * transient.half_width] + passed.min()
    return np.concatenate([behind, dense, ahead])


def _step(
    transient: TransientProblem, before: TransientState | None, now: TransientState, time: float
) -> TransientState:
    """State at a later time; the state before the present one, if any, extrapolates the edges."""
    x, interval = transient.surface.x, time - now.time
    step = convected_memory.internal_variable_step(transient.creep, transient.positions(now.time, time), interval)
    end = step.positions[-1]
    operator = transient.creep.instant * np.eye(len(x))
    known = convected_memory.retarded_displacement(step.shares, now.places, step.decayed(now.internal), x + end)
    for position, fraction, weight in zip(step.positions, step.fractions, step.shares @ step.weights, strict=True):
        N = shape_matrix(x, convected_memory.clipped_to_mesh(x, x + end - position))
        operator += weight * fraction * N
        known += weight * (1 - fraction) * now.displacement @ N.T
    velocity = (end - now.position) / interval
    friction = transient.friction(velocity, interval, _surface_displacement(transient, now))
    contact = _solve_step(transient, operator, known, _extrapolated(before, now, time), friction)
    w = transient.surface.displacement(contact.forces[:, transient.surface.loaded])
    internal = step.updated(x, now.places, now.internal, now.displacement, w)
    rolled = end - now.position + interval * _slip_velocity(transient, contact)
    angle = now.angle + rolled / transient.problem.roller.radius
    return TransientState(time, float(end), contact, w, now.places, internal, float(angle))


def _reversed_state(transient: TransientProblem, now: TransientState) -> TransientState:
    """State at the same instant with the sliding traction or the torque of the new direction."""
    x, creep = transient.surface.x, transient.creep
    known = convected_memory.retarded_displacement(creep.shares, now.places, now.internal, x + now.position)
    friction = transient.friction(0.0, 1.0, _surface_displacement(transient, now))
    contact = _solve_step(transient, creep.instant * np.eye(len(x)), known, now.contact, friction)
    angle = now.angle + _slip_velocity(transient, contact) / transient.problem.roller.radius
    w = transient.surface.displacement(contact.forces[:, transient.surface.loaded])
    return replace(now, contact=contact, displacement=w, angle=angle)


def _surface_displacement(transient: TransientProblem, now: TransientState) -> Array:
    """Displacement u of the surface nodes [m], shape (2, n)."""
    creep, x = transient.creep, transient.surface.x
    retarded = convected_memory.retarded_displacement(creep.shares, now.places, now.internal, x + now.position)
    return creep.instant * now.displacement + retarded


def _slip_velocity(transient: TransientProblem, contact: ContactSolution) -> float:
    """Peripheral speed of the roller in excess of its speed along +x [m/s]."""
    return 0.0 if contact.shear is None else contact.shear.creepage * (transient.problem.speed or 1.0)


def _solve_step(
    transient: TransientProblem,
    operator: Array,
    known: Array,
    initial_guess: ContactSolution,
    friction: FrictionCondition | None,
) -> ContactSolution:
    """Contact on a surface with the displacement `known` and the compliance by `operator` for the new forces."""
    surface = transient.surface.retarded(operator).with_initial(known)
    indenter = transient.problem.indenter(transient.problem.roller.target[1])
    # from scratch where the edges jump: at a reversal the roller nearly fits its own impression
    for patch, shear in ((initial_guess.patch, initial_guess.shear), (None, None)):
        try:
            if friction is None:
                shear, patch = None, solve_contact_patch(surface, indenter, transient.terms, patch)
            else:
                patch, shear = solve_stick_slip(surface, indenter, transient.terms, friction, patch, shear)
            return ContactSolution(surface, indenter, patch, shear)
        except BeyondWindowError:
            raise
        except RuntimeError as error:
            failure = error
    raise failure


def _extrapolated(before: TransientState | None, now: TransientState, time: float) -> ContactSolution:
    """Extrapolate the edges linearly for an initial guess of a contact."""
    patch = now.contact.patch
    if before is None:
        return now.contact
    share = (time - now.time) / (now.time - before.time)
    trailing, leading = (
        new + share * (new - old) for new, old in zip(patch.edges, before.contact.patch.edges, strict=True)
    )
    return replace(now.contact, patch=replace(patch, trailing=trailing, leading=leading))


def _step_error(
    transient: TransientProblem, before: TransientState | None, now: TransientState, later: TransientState
) -> float:
    """Estimate the error of the resistance due to w linear in time, over the tolerance.

    The mean deviation of a parabola from its chord over a step dt is dt^2/12 of its second derivative. Its deviation
    from the tangent of the previous step dt' is dt (dt + dt')/2 of it.
    """
    step, earlier = later.time - now.time, 0.0 if before is None else now.time - before.time
    predicted = 0.0 if before is None else (now.moments - before.moments) * step / earlier
    error = np.abs(later.moments - now.moments - predicted).sum() * step / (6 * (step + earlier))
    return error / (transient.tolerance * np.abs(later.moments).sum())


def _integrate_adaptively(
    transient: TransientProblem, start: TransientState, breaks: Sequence[float], stops: Sequence[float]
) -> list[TransientState]:
    """States at the ends of steps of adapted length; `stops` [s] include the breaks of the motion."""
    states, shortest = [start], MIN_STEP * transient.shortest_time
    for begin, end in pairwise(breaks):
        transient = _directed(transient, states, begin, end)
        before, step = None, INITIAL_STEP * transient.shortest_time
        while states[-1].time < end:
            now = states[-1]
            time = _end_of_step(transient, now.time, step, stops)
            tried = time - now.time
            try:
                later = _step(transient, before, now, time)
                error = _step_error(transient, before, now, later)
            except BeyondWindowError:
                raise
            except RuntimeError:
                if tried < 2 * shortest:
                    raise
                error = np.inf
            ratio = np.clip(STEP_SAFETY / np.sqrt(max(error, TIME_ROUNDING)), MIN_STEP_GROWTH, MAX_STEP_GROWTH)
            if error > 1 and tried > shortest:
                step = max(tried * min(ratio, STEP_SAFETY), shortest)
                continue
            step = max(tried * ratio, step if time in stops else shortest)
            before = now
            states.append(later)
    return states


def _directed(transient: TransientProblem, states: list[TransientState], begin: float, end: float) -> TransientProblem:
    """Problem with the direction of an interval; appends the state after a reversal if the tractions jump."""
    direction = float(np.sign(np.diff(transient.motion.position(np.array([begin, end])))[0])) or transient.problem.speed
    if direction == transient.problem.speed:
        return transient
    transient = replace(transient, problem=replace(transient.problem, speed=direction))
    if transient.jumps_at_reversal:
        states.append(_reversed_state(transient, states[-1]))
    return transient


def _end_of_step(transient: TransientProblem, begin: float, step: float, stops: Sequence[float]) -> float:
    """End of a step of about the given length [s] that passes no stop and travels `MAX_TRAVEL` half-widths at most."""
    stop = next(each for each in stops if each > begin + TIME_ROUNDING * stops[-1])
    end = min(begin + step, stop)
    longest = MAX_TRAVEL * transient.half_width * (1 + TIME_ROUNDING)
    while np.abs(np.diff(transient.positions(begin, end))).sum() > longest:
        end = begin + (end - begin) * STEP_SAFETY
    return stop if stop - end < TIME_ROUNDING * stops[-1] else end


def _integrate_at(
    transient: TransientProblem, start: TransientState, breaks: Sequence[float], times: Sequence[float]
) -> list[TransientState] | None:
    """States at prescribed times [s]; None where a contact is not found."""
    states = [start]
    for begin, end in pairwise(breaks):
        transient, before = _directed(transient, states, begin, end), None
        for time in times:
            if begin < time <= end:
                try:
                    later = _step(transient, before, states[-1], time)
                except BeyondWindowError:
                    raise
                except RuntimeError:
                    return None
                before = states[-1]
                states.append(later)
    return states


def _every_second(states: Iterable[TransientState], breaks: Sequence[float]) -> list[float]:
    """Select the times [s] of every second state of each interval between breaks, and of its end."""
    times = np.unique([each.time for each in states])
    chosen: list[float] = []
    for begin, end in pairwise(breaks):
        piece = times[(times > begin) & (times <= end)]
        chosen += [*piece[1:-1:2], piece[-1]]
    return chosen


def _snapped(times: Iterable[float], breaks: Sequence[float]) -> list[float]:
    """Move times [s] within rounding of a break to it."""
    nearest = [(time, breaks[int(np.argmin(np.abs(np.array(breaks) - time)))]) for time in times]
    rounding = TIME_ROUNDING * breaks[-1]
    return [each if abs(each - time) <= rounding else float(time) for time, each in nearest]


def _transient_result(
    states: Sequence[TransientState],
    coarse: Sequence[TransientState] | None,
    problem: RollingProblem,
    motion: PrescribedMotion,
) -> TransientResult:
    """Collect the result without frames; the error is the largest difference from a coarse solution."""
    modulus = problem.material.youngs_modulus
    forces = modulus * np.array([each.contact.resultant for each in states])
    edges = np.array([each.contact.patch.edges for each in states])
    time = np.array([each.time for each in states])
    error, steps = None, len(states) - 1
    if coarse is not None:
        fine = dict(zip(time.tolist(), forces[:, 0], strict=True))
        differences = [abs(modulus * each.contact.resultant[0] - fine[each.time]) for each in coarse]
        error = float(max(differences) / max(np.abs(forces[:, 0]).max(), 1e-3 * np.abs(forces[:, 1]).max()))
        steps += len(coarse) - 1
    return TransientResult(
        time=time,
        position=np.array([each.position for each in states]),
        velocity=motion.velocity(time),
        load=-forces[:, 1],
        resistance=forces[:, 0],
        leading=edges[:, 1],
        trailing=edges[:, 0],
        error=error,
        steps=steps,
        angle=np.array([each.angle for each in states]) if problem.turns_with_friction else None,
    )


def _require_times_within(motion: PrescribedMotion, instants: Sequence[float]) -> None:
    require_positive(duration=motion.duration)
    require_finite(instants=instants, position=motion.position(np.linspace(0, motion.duration, 2 * POINTS_PER_WIDTH)))
    outside = [time for time in instants if not 0 <= time <= motion.duration]
    if outside:
        raise ValueError(
            f"`instants` and `frames` must lie within the motion, 0 to {motion.duration:g} s, got {outside[0]!r} s"
        )


def _require_transient_range(layer: Layer, roller: Roller) -> None:
    if roller.indentation is None:
        raise ValueError(
            f"an unsteady motion needs a roller with an `indentation`, got `{roller.target[0]}`; give `indentation`"
        )
    if layer.base == "slip" and roller.friction > 0 and roller.rolling != "frictionless":
        raise ValueError(
            "an unsteady motion over a frictionless base needs a roller without friction, since nothing holds the "
            f"layer along x at a reversal; got `rolling` '{roller.rolling}' with `friction` {roller.friction!r}; use "
            "`base` 'bonded' or `rolling` 'frictionless'"
        )
    if layer.base == "slip" and roller.profile == "deformed":
        raise ValueError(
            "an unsteady motion over a frictionless base needs a vertical gap, got `profile` 'deformed'; use 'circle'"
        )
