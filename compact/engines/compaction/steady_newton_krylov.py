"""Direct steady solve: the displacement in equilibrium with the roller while the mix flows through the frame.

    R(u, pressure) = internal forces(states(u)) - contact forces = 0,    pressure gap = smoothing -> 0

The states follow from the displacement by integration along the streamlines (`streamline_integration`). A
Newton-Krylov method solves for displacement and pressure: GMRES uses the exact derivative along the rows, with the
stiffness of a frozen upstream state as preconditioner. The complementarity of pressure and gap is smoothed while the
iteration converges, since nodes at the corner would oscillate; then the smoothing is reduced. The shear of a rotating
roller follows from the slip of the steady motion and one creepage (`SteadySlip`). A line search decreases the residual,
measured as preconditioned displacement: the norm of the forces overweights stiff, short waves. If no step length
decreases it, a share of the elastic stiffness is added.

The initial guess is a neighbouring solution, a nearly steady state of incremental rolling, or the solution by
continuation in the stiffness ratio:

    R(u, ratio E_u) = 0,    stiffness ratio from SOFTEST_RATIO yield pressures over E_u to 1

A layer with a low unloading modulus E_u hardly yields, so that its equilibrium is found from scratch, like that of any
contact. As E_u rises, irreversible compaction increases and the bow wave grows to its height, while the inelastic
strain changes less and less. The predictor of every step is linear in the logarithm of the ratio. No incremental
rolling is needed, and no bow wave must build up over the travel.

References
----------
K. Dang Van and M. H. Maitournam, J. Mech. Phys. Solids 41 (1993) 1691-1710.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres

from compact.engines.compaction.finite_strain_solid import IDENTITY, SUBSTEPS, FloatArray, SolidState
from compact.engines.compaction.incremental_rolling import IncrementalRolling
from compact.engines.compaction.newton import Equilibrium, EquilibriumError, Progress, residual_clause
from compact.engines.compaction.roller_contact import (
    REGULARISATION_SLIP,
    ContactForces,
    ContactTractions,
    RollerSurface,
    RollingSurface,
    SteadySlip,
)
from compact.engines.compaction.roller_frame import RollerFrame
from compact.engines.compaction.streamline_integration import StreamlineIntegrator, StreamlineState, propagate_changes
from compact.material import cap_plasticity

RESIDUAL_TOLERANCE = 1e-6  # [-], residual over the contact forces
MAX_ITERATIONS = 60  # [-], Newton iterations of a continuation step; twice as many for a final solution
DIVERGENCE_ITERATION = 20  # [-], iteration at which a residual above the contact forces ends a final solution
MAX_KRYLOV_PRODUCTS = 150  # [-], of GMRES in one iteration; 30 to 90 are usual
LINEAR_TOLERANCE = 3e-2  # [-], of GMRES
MAX_STEP_CUTS = 8  # [-], step lengths tried by one line search
MIN_FORCE = 1e-9  # [-], scale of the contact forces over modulus times step
MIN_DECREASE = 0.1  # [-], decrease of the residual over that of the linearised problem that a step must reach
SMOOTHING = 0.1  # [-], pressure at the corner of the complementarity over the yield pressure of the fed mix
FINAL_SMOOTHING = 3e-3  # [-], of the final phase; the gap of touching nodes is then within 1e-6 of the depth
MAX_PENALTY = 1e3  # [-], penalty of touching nodes over modulus/step
FIRST_ELASTIC_SHARE = 1e-3  # [-], share of the elastic stiffness that is added first
MAX_ELASTIC_SHARE = 1.0  # [-], largest share of the elastic stiffness
MAX_FAILED_SEARCHES = 3  # [-], successive line searches without success that end the iteration
SOFTEST_RATIO = 13.0  # [-], first stiffness ratio of the continuation in yield pressures over the modulus
MAX_SOFTENINGS = 4  # [-], halvings of the first ratio if its equilibrium is not found
FIRST_RATIO_STEP = 1.5  # [-], ratio of the first two stiffness ratios
MIN_LOG_STEP = 5e-3  # [-], step of the logarithm of the ratio below which the continuation ends
FEW_ITERATIONS, MANY_ITERATIONS = 8, 14  # [-], Newton iterations below which a step grows, above which it shrinks
STEP_GROWTH, STEP_REDUCTION = 1.4, 1.3  # [-], factor and divisor of the step of the logarithm
CONTINUATION_TOLERANCE = 3e-3  # [-], residual over the contact forces during the continuation
REGULARISATION_EXPONENT = 0.85  # [-], of the stiffness ratio in the regularisation slip of the friction


@dataclass(frozen=True, eq=False)
class SteadyTrial:
    """A displacement and the pressures of the touchable nodes, with all that follows from them.

    Parameters
    ----------
    displacement : ndarray, shape (N, 2)
        Displacement of the nodes [m].
    pressure : ndarray, shape (n,)
        Pressure of the touchable nodes [Pa].
    gradients, stress : ndarray, shape (points, 4)
        Displacement gradients [-] and stresses [Pa] of the Gauss points.
    streamlines : StreamlineState
        Material states by rows.
    surface, slip : RollerSurface, SteadySlip or None
        Touchable nodes with their friction, and the slip that causes it.
    unit_contact : ContactForces
        Contact forces of a unit pressure.
    complementarity : ndarray, shape (n,)
        Violation of the smoothed complementarity of pressure and gap [Pa].
    residual : ndarray, shape (N, 2)
        Internal less contact forces [N/m].
    size : float
        Norm of residual and complementarity over that of the contact forces [-].
    """

    displacement: FloatArray
    pressure: FloatArray
    gradients: FloatArray
    streamlines: StreamlineState
    stress: FloatArray
    surface: RollerSurface
    slip: SteadySlip | None
    unit_contact: ContactForces
    complementarity: FloatArray
    residual: FloatArray
    size: float


class SteadySolver:
    """Newton-Krylov solver of steady rolling for a frame and a roller.

    Parameters
    ----------
    frame : RollerFrame
        Mesh with its inflow.
    surface : RollerSurface
        Roller; its multipliers are the initial guess of the tractions.
    progress : callable, optional
        Called with a line of text after each iteration.
    """

    def __init__(self, frame: RollerFrame, surface: RollerSurface, progress: Progress | None = None) -> None:
        self.frame, self.solid, self.progress = frame, frame.solid, progress
        solid = frame.solid
        self.integrator = StreamlineIntegrator(
            solid.material, frame.fed_layer.points, solid.rate_factor, solid.finite, SUBSTEPS
        )
        bottom = surface.bottom_height
        surface = surface.moved_to(bottom, -frame.step).begin_increment(np.zeros_like(surface.coordinates))
        surface = surface.moved_to(bottom)
        self.touchable = np.flatnonzero(
            np.abs(surface.coordinates[:, 0] - surface.position) < surface.radius * (1 - 1e-9)
        )
        kept = {name: getattr(surface, name)[self.touchable] for name in ("coordinates", "weights")}
        self.nodes = frame.surface_nodes[self.touchable]
        self.whole_surface, self.initial_pressure = surface, surface.multiplier_pressure[self.touchable]
        self.unit_surface = replace(surface, **kept, penalty=0.0, multiplier_pressure=np.ones(len(self.nodes)))
        self.upstream = frame.upstream_matrix(self.nodes)
        fed = float(frame.fed_layer.points.max_density_ratio[-1])
        self.yield_pressure = solid.material.yield_pressure(fed) * solid.rate_factor
        self.penalty = self.yield_pressure * 2 * surface.radius / frame.step**2
        self.smoothing = SMOOTHING * self.yield_pressure

    def solve(
        self, initial_guess: FloatArray, elastic_share: float = 0.0, tolerance: float | None = None
    ) -> Equilibrium:
        """Find the steady equilibrium.

        Parameters
        ----------
        initial_guess : ndarray, shape (N, 2)
            Displacement of the nodes [m].
        elastic_share : float
            Share of the elastic stiffness that is added at first [-]; it favours the solution near the guess.
        tolerance : float, optional
            Residual over the contact forces that ends a continuation step [-]. By default the smoothing is reduced
            and the residual decreased to RESIDUAL_TOLERANCE.

        Returns
        -------
        Equilibrium

        Raises
        ------
        EquilibriumError
            If the method does not converge.
        """
        failed_searches, residuals, smoothed = 0, [], None
        trial = self.evaluate(initial_guess, self.initial_pressure)
        for iteration in range(MAX_ITERATIONS if tolerance else 2 * MAX_ITERATIONS):
            residuals.append(trial.size)
            self._report_progress(iteration, trial)
            if trial.size <= (tolerance or RESIDUAL_TOLERANCE):
                if tolerance or smoothed:
                    return self.to_equilibrium(trial, iteration)
                smoothed, self.smoothing = trial, FINAL_SMOOTHING * self.yield_pressure
                trial = self.evaluate(trial.displacement, trial.pressure)
            if iteration == DIVERGENCE_ITERATION and trial.size > 1 and not tolerance:
                break
            length, next_trial = _NewtonStep(self, trial, elastic_share).search()
            if next_trial is not None:
                elastic_share, failed_searches, trial = _next_elastic_share(elastic_share, length), 0, next_trial
                continue
            elastic_share = min(max(8 * elastic_share, FIRST_ELASTIC_SHARE), MAX_ELASTIC_SHARE)
            failed_searches += 1
            if failed_searches == MAX_FAILED_SEARCHES:
                break
        if smoothed:  # the contact edges oscillate between two nodes without smoothing
            return self.to_equilibrium(smoothed, iteration)
        raise EquilibriumError(f"no steady equilibrium: {residual_clause(residuals)}")

    def _report_progress(self, iteration: int, trial: SteadyTrial) -> None:
        if self.progress is not None:
            self.progress(
                f"{round(self.frame.contact_length / self.frame.step)} increments per contact length, direct steady "
                f"solve, iteration {iteration + 1}: residual {trial.size:.1e}"
            )

    def to_equilibrium(self, trial: SteadyTrial, iterations: int) -> Equilibrium:
        """Convert a converged trial.

        Parameters
        ----------
        trial : SteadyTrial
            Trial with a small residual.
        iterations : int
            Newton iterations.

        Returns
        -------
        Equilibrium

        Raises
        ------
        EquilibriumError
            If a node from outside the touchable part penetrates the roller.
        """
        contact = self._contact_of_all_nodes(trial)
        penetration = -np.delete(contact.gap, self.touchable).min(initial=0.0)
        if penetration > 0:
            raise EquilibriumError(f"nodes beyond the roller penetrate it by {penetration:.2g} m")
        values, to_points = trial.streamlines.values, self.frame.to_points
        stress, density_ratio, densest = (
            to_points(values[..., :4]),
            to_points(values[..., 4]),
            to_points(values[..., 5]),
        )
        plastic_work = to_points(trial.streamlines.plastic_work)
        points = cap_plasticity.MaterialPoint(stress, density_ratio, densest, plastic_work)
        state = SolidState(trial.displacement, points, to_points(trial.streamlines.work))
        return Equilibrium(state, contact, trial.size, iterations)

    def _contact_of_all_nodes(self, trial: SteadyTrial) -> ContactForces:
        """Return the contact of all surface nodes; the pressure of nodes without contact is 0."""
        touching = trial.pressure > self.penalty * trial.unit_contact.gap
        pressure, nodes = np.zeros(len(self.whole_surface.coordinates)), self.frame.surface_nodes
        pressure[self.touchable] = np.where(touching, trial.pressure, 0.0)
        displacement = trial.displacement[nodes]
        upstream = self.frame.upstream_matrix(nodes) @ trial.displacement
        surface, slip = self.whole_surface.with_steady_friction(displacement, upstream, pressure)
        contact = replace(surface, multiplier_pressure=pressure, penalty=0.0).normal_contact(displacement)
        return contact if slip is None else replace(contact, creepage=slip.creepage)

    def evaluate(self, displacement: FloatArray, pressure: FloatArray) -> SteadyTrial:
        """Evaluate the residual of a displacement and pressures.

        Parameters
        ----------
        displacement : ndarray, shape (N, 2)
            Displacement of the nodes [m].
        pressure : ndarray, shape (n,)
            Pressure of the touchable nodes [Pa].

        Returns
        -------
        SteadyTrial

        Raises
        ------
        EquilibriumError
            If elements invert.
        """
        try:
            with np.errstate(invalid="raise", divide="raise", over="raise"):
                return self._evaluate(displacement, pressure)
        except (FloatingPointError, RuntimeError) as error:  # of numpy, and of the streamline integration
            raise EquilibriumError("no steady equilibrium: elements of the layer invert") from error

    def _evaluate(self, displacement: FloatArray, pressure: FloatArray) -> SteadyTrial:
        displacement = self.frame.with_steady_rear(displacement)
        gradients = self.solid.displacement_gradient(displacement)
        streamlines = self.integrator.integrate(self.frame.to_rows(gradients))
        stress = self.frame.to_points(streamlines.values[..., :4])
        nodal = displacement[self.nodes]
        surface, slip = self.unit_surface.with_steady_friction(nodal, self.upstream @ displacement, pressure)
        unit_contact = surface.normal_contact(nodal)
        residual = self.assemble(_piola_stress(gradients, stress, self.solid.finite))
        external = unit_contact.forces * pressure[:, None]
        residual[self.nodes] -= external
        penalised = self.penalty * unit_contact.gap
        complementarity = (pressure + penalised - np.hypot(pressure - penalised, 2 * self.smoothing)) / 2
        size = np.hypot(
            np.linalg.norm(residual.ravel()[self.solid.ordered_dofs]), np.linalg.norm(complementarity * surface.weights)
        )
        size /= max(np.linalg.norm(external), MIN_FORCE * self.solid.material.unloading_modulus * self.frame.step)
        return SteadyTrial(
            displacement=displacement,
            pressure=pressure,
            gradients=gradients,
            streamlines=streamlines,
            stress=stress,
            surface=surface,
            slip=slip,
            unit_contact=unit_contact,
            complementarity=complementarity,
            residual=residual,
            size=float(size),
        )

    def assemble(self, piola: FloatArray) -> FloatArray:
        """Assemble the internal forces of Piola stresses.

        Parameters
        ----------
        piola : ndarray, shape (points, 4)
            Stress on the reference configuration (xx, xy, yx, yy) [Pa].

        Returns
        -------
        ndarray, shape (N, 2)
            Internal forces of the nodes [N/m].
        """
        solid = self.solid
        stress = (piola * solid.point_areas[:, None]).reshape(*solid.basis.dx.shape, 2, 2)
        nodal = np.matmul(solid.shape_gradients, stress.transpose(0, 1, 3, 2)).sum(axis=1)
        nodes = solid.basis.element_dofs.T.ravel()
        return np.stack([np.bincount(nodes, nodal[..., i].ravel(), solid.basis.N) for i in range(2)], axis=-1)

    @cached_property
    def gradient_matrix(self) -> FloatArray:
        """Matrix from element displacements to gradients [1/m], shape (elements, points, 4, 16)."""
        gradients = self.solid.shape_gradients.transpose(0, 1, 3, 2)
        matrix = np.zeros((*gradients.shape[:2], 4, 16))
        matrix[:, :, 0:2, 0::2] = matrix[:, :, 2:4, 1::2] = gradients
        return matrix

    @cached_property
    def elastic_stiffness(self) -> FloatArray:
        """Stiffness of the undeformed elements [N/m2], shape (elements, 16, 16)."""
        return self.solid.elastic_element_stiffness()


class _NewtonStep:
    """Linearised equations of one Newton iteration, with a share of the elastic stiffness added."""

    def __init__(self, solver: SteadySolver, trial: SteadyTrial, elastic_share: float) -> None:
        self.solver, self.trial, self.elastic_share = solver, trial, elastic_share
        frame, solid, unit = solver.frame, solver.solid, trial.unit_contact
        self.derivatives = solver.integrator.derivatives(frame.to_rows(trial.gradients), trial.streamlines)
        displacement, surface = trial.displacement[solver.nodes], trial.surface
        frictionless = replace(surface, traction_ratio=0.0)
        self.normals = frictionless.normal_contact(displacement).forces / surface.weights[:, None]
        self.friction_forces = (surface.weights * trial.pressure)[:, None] * surface.tangents(displacement)
        max_penalty = MAX_PENALTY * solid.material.unloading_modulus / frame.step
        separation = trial.pressure - solver.penalty * unit.gap
        separation = separation / np.hypot(separation, 2 * solver.smoothing)  # 1 in contact, -1 without
        self.pressure_weight = np.maximum(1 - separation, 2 * solver.penalty / max_penalty)
        self.gap_weight = (1 + separation) * solver.penalty
        self.contact_stiffness = self.gap_weight / self.pressure_weight
        self.target = self._weighted_contact(trial) - 2 * trial.complementarity
        contact_blocks = self.contact_stiffness[:, None, None] * unit.forces[:, :, None] * self.normals[:, None, :]
        self.nodal_stiffness = unit.stiffness * trial.pressure[:, None, None] + contact_blocks
        self.precondition = solid.factorise(self._frozen_stiffness(), solver.nodes, self.nodal_stiffness)

    def search(self) -> tuple[float, SteadyTrial | None]:
        """Return the step length and the trial there; None if no length decreases the residual."""
        solver, trial = self.solver, self.trial
        change, pressure, start, predicted = self._solve()
        length = 1.0
        for _ in range(MAX_STEP_CUTS):
            try:
                candidate = solver.evaluate(trial.displacement + length * change, trial.pressure + length * pressure)
            except RuntimeError:
                candidate = None
            limit = (1 - MIN_DECREASE * length * predicted) * start
            if candidate is not None and np.linalg.norm(self._preconditioned_residual(candidate)) < limit:
                return length, candidate
            length /= 2
        return 0.0, None

    def _solve(self):
        """Return changes of displacement and pressure, size of the residual, and its predicted relative decrease."""
        trial = self.trial
        right_side = self._preconditioned_residual(trial)
        operator = LinearOperator(
            (right_side.size,) * 2, matvec=lambda x: self.precondition(self._multiply(x)), dtype=float
        )
        solution, _ = gmres(operator, right_side, rtol=LINEAR_TOLERANCE, restart=MAX_KRYLOV_PRODUCTS, maxiter=1)
        change = self._expand(solution)
        normal_change = np.sum(self.normals * change[self.solver.nodes], axis=1)
        pressure = self._pressure_correction(trial) - self.contact_stiffness * normal_change
        error = self.precondition(self._multiply(solution) - self._elastic_forces(change)) - right_side
        start = np.linalg.norm(right_side)
        return change, pressure, start, max(1 - np.linalg.norm(error) / start, 0.0)

    def _preconditioned_residual(self, trial: SteadyTrial) -> FloatArray:
        """Return the displacement that a residual causes with the upstream states frozen."""
        nodes, correction = self.solver.nodes, self._pressure_correction(trial)
        residual = -trial.residual
        residual[nodes] += trial.unit_contact.forces * correction[:, None]
        if trial.slip is not None:
            zero = np.zeros((len(nodes), 2))
            residual[nodes] += self.friction_forces * self._friction_change(correction, zero, zero)[:, None]
        return self.precondition(residual.ravel()[self.solver.solid.ordered_dofs])

    def _pressure_correction(self, trial: SteadyTrial) -> FloatArray:
        """Return the pressure change that satisfies the linearised complementarity at a constant gap."""
        return (self.target - self._weighted_contact(trial)) / self.pressure_weight

    def _weighted_contact(self, trial: SteadyTrial) -> FloatArray:
        return self.pressure_weight * trial.pressure + self.gap_weight * trial.unit_contact.gap

    def _friction_change(self, pressure, displacement, upstream):
        """Return the change of the traction ratio with changes of pressure and displacements."""
        trial = self.trial
        return trial.slip.friction_change(trial.surface, trial.pressure, pressure, displacement, upstream)

    def _multiply(self, vector: FloatArray) -> FloatArray:
        """Return the Jacobian, with all changes downstream, times a vector of the free degrees of freedom."""
        solver = self.solver
        change = self._expand(vector)
        gradients = solver.solid.displacement_gradient(change)
        values = propagate_changes(self.derivatives, solver.frame.to_rows(gradients))
        stress = solver.frame.to_points(values[..., :4])
        forces = solver.assemble(self._piola_change(gradients, stress))
        nodal = change[solver.nodes]
        forces[solver.nodes] += np.einsum("nij,nj->ni", self.nodal_stiffness, nodal)
        if self.trial.slip is not None:
            pressure = -self.contact_stiffness * np.sum(self.normals * nodal, axis=1)
            ratio = self._friction_change(pressure, nodal, solver.upstream @ change)
            forces[solver.nodes] -= self.friction_forces * ratio[:, None]
        return forces.ravel()[solver.solid.ordered_dofs] + self._elastic_forces(change)

    def _expand(self, vector: FloatArray) -> FloatArray:
        """Return the nodal displacements of a vector of the free degrees of freedom."""
        change = np.zeros(2 * self.solver.solid.basis.N)
        change[self.solver.solid.ordered_dofs] = vector
        return self.solver.frame.with_steady_rear(change.reshape(-1, 2))

    def _elastic_forces(self, change):
        """Return the forces of the added share of the elastic stiffness."""
        if not self.elastic_share:
            return 0.0
        solid = self.solver.solid
        forces = np.matmul(self.solver.elastic_stiffness, change.ravel()[solid.element_dofs][..., None])
        total = np.bincount(solid.element_dofs.ravel(), forces.ravel(), change.size)
        return self.elastic_share * total[solid.ordered_dofs]

    def _piola_change(self, gradients, stress):
        """Return the change of the Piola stress with changes of gradients and stresses."""
        trial, finite = self.trial, self.solver.solid.finite
        change = _piola_stress(trial.gradients, stress, finite)
        return change + _piola_stress(gradients - IDENTITY, trial.stress, True) if finite else change

    def _frozen_stiffness(self) -> FloatArray:
        """Return the stiffness of the elements with the upstream states frozen, shape (elements, 16, 16)."""
        solver, matrix = self.solver, self.solver.gradient_matrix
        by_gradient = solver.frame.to_points(self.derivatives[..., :4, 10:])
        tangent = np.empty((len(by_gradient), 4, 4))
        for k, gradient in enumerate(np.eye(4)):
            tangent[:, :, k] = self._piola_change(np.broadcast_to(gradient, (len(tangent), 4)), by_gradient[:, :, k])
        weighted = tangent.reshape(*matrix.shape[:2], 4, 4) * solver.solid.basis.dx[..., None, None]
        count = len(matrix)
        right = np.matmul(weighted, matrix).reshape(count, -1, 16)
        stiffness = np.matmul(matrix.reshape(count, -1, 16).transpose(0, 2, 1), right)
        return stiffness + self.elastic_share * solver.elastic_stiffness if self.elastic_share else stiffness


def _piola_stress(gradients, stress, finite):
    """Return J sigma F^-T (xx, xy, yx, yy) [Pa], shape (n, 4); sigma in small strain."""
    xx, yy, _, xy = stress.T
    if not finite:
        return np.stack([xx, xy, xy, yy], axis=-1)
    Fxx, Fxy, Fyx, Fyy = (gradients + IDENTITY).T
    return np.stack([xx * Fyy - xy * Fxy, xy * Fxx - xx * Fyx, xy * Fyy - yy * Fxy, yy * Fxx - xy * Fyx], axis=-1)


def _next_elastic_share(share: float, length: float) -> float:
    """Return the share of the elastic stiffness after a step of a length."""
    if length == 1:
        return share / 4 if share > FIRST_ELASTIC_SHARE / 100 else 0.0
    if length == 0.5:
        return share / 1.4
    return min(max(2 * share, FIRST_ELASTIC_SHARE / 10), MAX_ELASTIC_SHARE) if length < 0.1 else share


@dataclass(frozen=True, eq=False)
class _ContinuationStep:
    """Steady rolling at one stiffness ratio."""

    rolling: IncrementalRolling
    ratio: float


def continue_in_stiffness(
    create_rolling: Callable[[float], IncrementalRolling], bottom_height: float
) -> IncrementalRolling:
    """Solve steady rolling from scratch by continuation in the stiffness ratio.

    Parameters
    ----------
    create_rolling : callable
        Function of the stiffness ratio [-] that returns rolling at rest over mix of that unloading modulus.
    bottom_height : float
        Height of the lowest generatrix [m].

    Returns
    -------
    IncrementalRolling
        Steady rolling at stiffness ratio 1.

    Raises
    ------
    RuntimeError
        If the continuation ends at a lower stiffness ratio.
    """
    previous, step = None, np.log(FIRST_RATIO_STEP)
    current = _solve_softest(create_rolling, _softest_ratio(create_rolling(1.0).frame), bottom_height)
    while current.ratio < 1:
        ratio = min(current.ratio * np.exp(step), 1.0)
        rolling = create_rolling(ratio)
        try:
            _solve_at_ratio(rolling, _extrapolate(current, previous, ratio), bottom_height, ratio)
        except RuntimeError as error:
            step /= 2
            if step < MIN_LOG_STEP:
                raise RuntimeError(f"continuation ends at a stiffness ratio of {current.ratio:.3g}: {error}") from error
            continue
        iterations = rolling.steps[-1].iterations
        if iterations < FEW_ITERATIONS:
            step *= STEP_GROWTH
        elif iterations > MANY_ITERATIONS:
            step *= 1 / STEP_REDUCTION
        current, previous = _ContinuationStep(rolling, ratio), current
    rolling = current.rolling
    solver = SteadySolver(rolling.frame, rolling.surface.moved_to(bottom_height), rolling.progress)
    rolling.accept_steady(solver.solve(rolling.state.displacement), bottom_height)
    return rolling


def _solve_softest(create_rolling, ratio, bottom_height):
    """Return the first continuation step, with a lower ratio if necessary."""
    for _ in range(MAX_SOFTENINGS):
        rolling = create_rolling(ratio)
        try:
            _solve_at_ratio(rolling, _solve_frictionless(rolling, bottom_height), bottom_height, ratio)
        except RuntimeError as error:
            reason, ratio = error, ratio / 2
        else:
            return _ContinuationStep(rolling, ratio)
    raise RuntimeError(f"continuation does not start at a stiffness ratio of {2 * ratio:.2g}: {reason}")


def _softest_ratio(frame: RollerFrame) -> float:
    material = frame.solid.material
    densest = float(frame.fed_layer.points.max_density_ratio.max())
    yield_pressure = material.yield_pressure(densest) * frame.solid.rate_factor
    return min(SOFTEST_RATIO * float(yield_pressure) / material.unloading_modulus, 1.0)


def _extrapolate(current, previous, ratio):
    """Return displacement and tractions, linear in the logarithm of the ratio; the shear of the current step."""
    rolling, contact = current.rolling, current.rolling.contact
    displacement, pressure = rolling.state.displacement, contact.pressure
    if previous is not None:
        before = previous.rolling
        share = np.log(ratio / current.ratio) / np.log(current.ratio / previous.ratio)
        displacement = displacement + share * (displacement - before.state.displacement)
        pressure = np.maximum(pressure + share * (pressure - before.contact.pressure), 0.0)
    return displacement, ContactTractions(pressure, contact.shear, contact.creepage)


def _solve_at_ratio(rolling, prediction, bottom_height, ratio):
    """Solve the steady equilibrium at a stiffness ratio from predicted displacement and tractions."""
    displacement, tractions = prediction
    rolling.surface = rolling.surface.with_multipliers(tractions)
    surface = rolling.surface.moved_to(bottom_height)
    if isinstance(surface, RollingSurface):
        surface = replace(surface, regularisation=REGULARISATION_SLIP * ratio**-REGULARISATION_EXPONENT)
    solver = SteadySolver(rolling.frame, surface, rolling.progress)
    rolling.accept_steady(solver.solve(displacement, tolerance=CONTINUATION_TOLERANCE), bottom_height)


def _solve_frictionless(rolling, bottom_height):
    """Return displacement and tractions at rest, of a rotating roller in equilibrium without friction."""
    displacement, surface = rolling.state.displacement, rolling.surface
    if not isinstance(surface, RollingSurface):
        return displacement, ContactTractions(surface.multiplier_pressure, np.zeros_like(surface.multiplier_pressure))
    surface = replace(surface, friction=0.0, tangential_force=0.0).moved_to(bottom_height)
    solver = SteadySolver(rolling.frame, surface, rolling.progress)
    solution = solver.solve(displacement, tolerance=CONTINUATION_TOLERANCE)
    return solution.state.displacement, ContactTractions(solution.contact.pressure, solution.contact.shear, 0.0)
