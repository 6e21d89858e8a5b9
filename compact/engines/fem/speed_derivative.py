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
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from compact.engines.fem import compliance
from compact.engines.fem import engine as fem
from compact.engines.fem.contact import Discretisation, RollingProblem
from compact.engines.spectral.galerkin_system import creep_function
from compact.material.laws import Elastic
from compact.mesh import DEFAULT_ERROR, RowMesh
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
    problem, mesh = fem.along_travel(layer, roller, material, speed, mesh, tolerance)
    if problem.turns_with_friction:
        raise ValueError(
            "M is available without stick and slip only, got `rolling` "
            f"'{roller.rolling}' with `friction` {roller.friction!r}; use 'sliding' or no friction"
        )
    branches = getattr(material, "branches", ())
    if not branches:
        result = fem.roll(layer, roller, material, speed, tolerance=tolerance, estimate=False)
        return ResistanceExpansion(speed, result.resistance, 0.0, 0.0, 0.0, 0.0)
    time, error = max(time for _, time in branches), None
    with threadpool_limits(1):  # the matrices are small; threads cost more than they save
        similar = fem.spectral_estimate(problem) if mesh is None else None
        grid = None if similar is None else fem.refined_discretisation(problem, 1, tolerance, similar)
        grid = grid or fem.initial_discretisation(problem, mesh, tolerance)
        resistance, slope, added_mass = fem.expand_window(grid, partial(_expansion, problem, grid))
        if estimate:
            grid = replace(grid, mesh=grid.mesh.refined(), terms=grid.terms + fem.EXTRA_TERMS)
            refined = fem.expand_window(grid, partial(_expansion, problem, grid))[2]
            error = ERROR_FACTOR * abs(added_mass - refined) + MIN_ERROR * max(abs(refined), time * abs(slope))
    return ResistanceExpansion(speed, float(np.sign(speed) * resistance), slope, added_mass, error, time)


def _expansion(problem: RollingProblem, grid: Discretisation, window: float) -> tuple[float, float, float]:
    """Return (F_ss, dF_ss/dv, M) in a loaded zone of a half-width [m].

    All contacts are similar to the steady one, each on its mesh shifted and stretched so that the edges keep their
    elements; the compliance is expanded in the logarithm of the stretch.
    """
    _, shares, times = creep_function(problem.material)
    elastic = fem.elastic_surface(problem, grid.mesh, window, stretch_rate=True)
    steady = fem.solve_at_target(problem, fem.retarded(problem, elastic), grid)
    edges, grid = steady.patch.edges, replace(grid, indentation=steady.pressed.indentation)

    def solve(speed: float, initial: compliance.Displacement = compliance.at_rest) -> tuple[Any, Any, Any, float]:
        """Return x [m], w [m] and z_k [m], shapes (n,), (2, n) and (branches, 2, n), and the resistance [N/m]."""
        at, contact = replace(problem, speed=speed), steady
        for _ in range(MESH_ITERATIONS):
            stretch = np.subtract(*contact.patch.edges) / np.subtract(*edges)
            x = contact.patch.edges[0] + stretch * (elastic.x - edges[0])
            surface = replace(elastic.stretched(stretch), x=x)
            contact = fem.solve_at_target(at, fem.retarded(at, replace(surface, initial=initial)), grid, contact)
        w = surface.displacement(contact.forces[:, elastic.loaded])
        z = np.array([w @ compliance.retardation_operator(x, time * speed).T for time in times])
        return x, w, z, float(problem.material.youngs_modulus * contact.resultant[0])

    slower, speed, faster = (problem.speed * (1 + side * SPEED_STEP) for side in (-1, 0, 1))
    (x, w, z, resistance), before, after = solve(speed), solve(slower), solve(faster)
    mesh_velocity, _, z_change, slope = ((b - a) / (faster - slower) for a, b in zip(before, after, strict=True))
    lengths = speed * times[:, None, None]
    z_rate = z_change - mesh_velocity * (z - w) / lengths  # at fixed x, since z - l dz/dx = w
    lag = sum(  # g [m s2/m]
        share * time * rate @ compliance.retardation_operator(x, time * speed).T
        for share, time, rate in zip(shares, times, z_rate, strict=True)
    )
    step = float(DISPLACEMENT_STEP * grid.indentation / np.abs(lag[:, elastic.loaded]).max())
    losing, gaining = (solve(speed, compliance.interpolant(x, -side * step * lag))[-1] for side in (-1.0, 1.0))
    return resistance, slope, (gaining - losing) / (2 * step)
