"""Resistance at slowly varying speed by the engine "fem": its derivative dF_ss/dv and its added mass M.

In coordinates of the roller the internal variable of a creep branch follows (see `compliance`)

    z + theta (dz/dt - v dz/dx) = w,    u = J_0 w + sum J_k z_k,

with the displacement w of the elastic layer. For a small acceleration a, d/dt = a d/dv and z = z_ss + a z_1. With the
operator m of the length v theta, z_ss = m w_ss,

    z_1 = m (w_1 - theta dz_ss/dv),    u = C w - a g,    g = sum J_k theta_k m_k dz_k/dv.

A roller under a slow acceleration therefore has the contact of steady motion on a surface with the initial displacement
-a g. M follows from two such contacts, dF_ss/dv and dz_ss/dv from a slightly lower and a slightly higher speed. All
these contacts have the same position relative to their meshes, which are that of the steady contact shifted and
stretched along x. On a mesh at rest, edges that cross nodes cause errors of the derivatives ten times those of F_ss.
"""

from dataclasses import replace
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from compact.engines.fem import compliance, contact_problem
from compact.engines.fem import engine as fem_engine
from compact.engines.fem.compliance import NodalField, SurfaceCompliance
from compact.engines.fem.contact_problem import ContactSolution, Discretisation, RollingProblem
from compact.material.laws import Elastic
from compact.mesh import DEFAULT_ERROR, RowMesh
from compact.numerics import Array
from compact.resistance import ResistanceExpansion
from compact.rolling_contact import Layer, Roller

SPEED_STEP = 1e-3  # [-], relative change of the speed in the central difference
DISPLACEMENT_STEP = 1e-3  # [-], largest initial displacement over the indentation in the central difference
MESH_ITERATIONS = 3  # [-], solves of a contact and shifts of its mesh
ERROR_FACTOR = 2.0  # [-], error estimate over the difference from the refined solution
MIN_ERROR = 1e-3  # [-], of the larger of |M| and |tau dF_ss/dv|, where the difference is small by chance


def expand_resistance(
    layer: Layer,
    roller: Roller,
    material: Elastic,
    speed: float,
    *,
    mesh: RowMesh | None = None,
    tolerance: float = DEFAULT_ERROR,
    estimate: bool = True,
) -> ResistanceExpansion:
    """Expand the resistance of a roller on a linear layer to first order in the acceleration.

    On a mesh fitted to the contact the errors of dF_ss/dv and M are below 0.07 % up to an instantaneous modulus of 20
    times the relaxed one. The error of M refers to the larger of |M| and tau dF_ss/dv.

    Parameters
    ----------
    layer : Layer
        Layer of any height, base and plies.
    roller : Roller
        Roller of any profile, frictionless or sliding.
    material : Elastic or Viscoelastic
        Material of the layer.
    speed : float
        Speed of the roller along x [m/s], not 0.
    mesh : RowMesh, optional
        Mesh of the layer; one fitted to the contact unless given.
    tolerance : float
        Relative error of F_ss for which a mesh is chosen [-].
    estimate : bool
        Estimate the error of M from a solution on the refined mesh.

    Raises
    ------
    ValueError
        If the roller turns with friction: the slip depends on the velocity of the surface, which the expansion lacks.
    RuntimeError
        If a contact is not found.
    """
    fem_engine.require_linear_range(layer, roller, material, speed, mesh, tolerance)
    problem = RollingProblem(layer, roller, material, speed)
    if problem.turns_with_friction:
        raise ValueError(
            "M is available without stick and slip only, got `rolling` "
            f"'{roller.rolling}' with `friction` {roller.friction!r}; use 'sliding' or no friction"
        )
    branches = getattr(material, "branches", ())
    if not branches:
        result = fem_engine.roll(layer, roller, material, speed, mesh=mesh, tolerance=tolerance, estimate=False)
        return ResistanceExpansion(speed, result.resistance, slope=0.0, added_mass=0.0, error=0.0, relaxation_time=0.0)
    time = max(time for _, time in branches)
    with threadpool_limits(1):  # the matrices are small; threads cost more than they save
        discretisation = None
        if mesh is None:  # a mesh that fits the contact at its own speed
            similar = fem_engine.spectral_estimate(problem)
            discretisation = fem_engine.refined_discretisation(problem, 1, tolerance, similar)
        discretisation = discretisation or fem_engine.initial_discretisation(problem, mesh, tolerance)
        resistance, slope, added_mass = contact_problem.expand_window(
            discretisation, partial(_expansion, problem, discretisation)
        )
        error = None
        if estimate:
            terms = discretisation.terms + fem_engine.EXTRA_TERMS
            finer = replace(discretisation, mesh=discretisation.mesh.refined(), terms=terms)
            refined = contact_problem.expand_window(finer, partial(_expansion, problem, finer))[2]
            error = ERROR_FACTOR * abs(added_mass - refined) + MIN_ERROR * max(abs(refined), time * abs(slope))
    return ResistanceExpansion(speed, resistance, slope, added_mass, error, time)


def _expansion(problem: RollingProblem, discretisation: Discretisation, window: float) -> tuple[float, float, float]:
    """Return (F_ss, dF_ss/dv, M) in a loaded zone of a half-width [m].

    All contacts are similar to the steady one, each on its mesh shifted and stretched so that the edges keep their
    elements; the compliance is expanded in the logarithm of the stretch.
    """
    mesh, (_, shares, times) = discretisation.mesh, compliance.creep_function(problem.material)
    steady = contact_problem.solve_at_target(
        problem, contact_problem.steady_surface(problem, mesh, window), discretisation
    )
    elastic, stretch_rate = (
        contact_problem.elastic_surface(problem, mesh, window, stretch_rate=rate) for rate in (False, True)
    )
    edges, start = steady.patch.edges, replace(discretisation, indentation=steady.indenter.indentation)

    def stretched(stretch: float) -> SurfaceCompliance:
        return replace(elastic, response=elastic.response + np.log(stretch) * stretch_rate.response)

    def solve(at: RollingProblem, initial: NodalField | None = None) -> ContactSolution:
        contact = steady
        for _ in range(MESH_ITERATIONS):
            stretch = np.subtract(*contact.patch.edges) / np.subtract(*edges)
            x = contact.patch.trailing + stretch * (elastic.x - edges[0])
            surface = replace(stretched(stretch), x=x, initial=initial)
            surface = surface.retarded(compliance.steady_creep_operator(x, at.material, at.speed))
            contact = contact_problem.solve_at_target(at, surface, start, initial_guess=contact)
        return contact

    def elastic_displacement(contact: ContactSolution) -> Array:  # w [m], shape (2, n)
        surface = stretched(np.ptp(contact.surface.x) / np.ptp(elastic.x))
        return surface.displacement(contact.forces[:, surface.loaded])

    def internal_variables(at: RollingProblem, contact: ContactSolution) -> Array:  # z_k [m], shape (branches, 2, n)
        w, x = elastic_displacement(contact), contact.surface.x
        return np.array([w @ compliance.retardation_operator(x, time * at.speed).T for time in times])

    slower, faster = (replace(problem, speed=problem.speed * (1 + side * SPEED_STEP)) for side in (-1, 1))
    before, after = solve(slower), solve(faster)
    speed_change, surface = faster.speed - slower.speed, steady.surface
    w, z = elastic_displacement(steady), internal_variables(problem, steady)
    z_change = internal_variables(faster, after) - internal_variables(slower, before)
    mesh_velocity = (after.surface.x - before.surface.x) / speed_change
    lengths = problem.speed * times[:, None, None]
    z_rate = z_change / speed_change - mesh_velocity * (z - w) / lengths  # at fixed x, since z - l dz/dx = w
    lag = sum(  # g [m s2/m]
        share * time * rate @ compliance.retardation_operator(surface.x, time * problem.speed).T
        for share, time, rate in zip(shares, times, z_rate, strict=True)
    )
    step = float(DISPLACEMENT_STEP * start.indentation / np.abs(lag[:, surface.loaded]).max())
    losing, gaining = (solve(problem, NodalField(surface.x, -acceleration * lag)) for acceleration in (-step, step))
    modulus = problem.material.youngs_modulus
    forces = [float(modulus * contact.resultant[0]) for contact in (steady, before, after, losing, gaining)]
    return forces[0], (forces[2] - forces[1]) / speed_change, (forces[4] - forces[3]) / (2 * step)
