"""Contact of one roller in steady motion on one mesh, at a prescribed indentation, load or peak pressure.

    u = C(v) S f + u0,    n.u = d under the pressure,    target(indentation) = prescribed value

S is the compliance of the elastic layer (`compliance`), C(v) its retardation by the material at the speed
(`convected_memory`). The contact at an indentation is that of `contact`, with its shear where the roller turns. The
secant method in logarithms finds the indentation of a prescribed load or peak pressure.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from compact.engines.fem.compliance import SurfaceCompliance, stretch_derivative, surface_compliance
from compact.engines.fem.contact import (
    BeyondWindowError,
    ContactPatch,
    Edges,
    FrictionCondition,
    Indenter,
    ShearSolution,
    UnresolvedError,
    beyond_circle_message,
    solve_contact_patch,
    solve_stick_slip,
    with_peak_pressures,
)
from compact.engines.fem.convected_memory import steady_creep_operator
from compact.engines.halfplane import pressure_exponent
from compact.material.laws import Elastic
from compact.mesh import RowMesh
from compact.numerics import Array
from compact.rolling_contact import Layer, Roller

WINDOW = 1.3  # [-], half-width of the loaded zone over that of the estimated contact
WINDOW_GROWTH = 1.5  # [-], of a loaded zone that does not contain the contact
MAX_WINDOWS = 8  # [-], loaded zones
SECANT_TOLERANCE = 1e-9  # [-], of a prescribed load or peak pressure
STICK_SECANT_TOLERANCE = 1e-6  # [-], the same with stick and slip, whose shear converges to 1e-7
MAX_SECANTS = 20  # [-], contacts solved for a prescribed load or peak pressure
INITIAL_POWER = 1.2  # [-], of load or peak pressure in the indentation, before two contacts are known
MAX_LOG_STEP = 1.0  # [-], of the log of the indentation

Found = TypeVar("Found")


@dataclass(frozen=True)
class RollingProblem:
    """Roller in steady motion over a linear layer.

    Parameters
    ----------
    speed : float
        Speed along x [m/s].
    torque : float
        Torque on a roller that turns, per unit length, positive in the sense of rolling along the travel [N].
    """

    layer: Layer
    roller: Roller
    material: Elastic
    speed: float
    torque: float = 0.0

    @property
    def direction(self) -> float:
        """Direction of travel, 1 along +x or -1."""
        return float(np.sign(self.speed))

    @property
    def traction_ratio(self) -> float:
        """Shear traction on the mix along +x over pressure where the whole contact slides [-]."""
        return self.direction * self.roller.friction if self.roller.rolling == "sliding" else 0.0

    @property
    def turns_with_friction(self) -> bool:
        """True if the contact has zones of stick and slip."""
        return self.roller.rolling in ("free", "driven") and self.roller.friction > 0

    @property
    def needs_shear(self) -> bool:
        """True if forces along x act on the surface."""
        return self.traction_ratio != 0 or self.turns_with_friction or self.roller.profile == "deformed"

    def indenter(self, indentation: float) -> Indenter:
        """Roller at an indentation [m]."""
        exponent = float(pressure_exponent(self.material.poisson, self.traction_ratio))
        return Indenter(self.roller.radius, indentation, self.roller.profile, self.traction_ratio, exponent)

    @property
    def friction(self) -> FrictionCondition:
        """Friction with the sum of the shear traction under the torque."""
        force = -self.direction * self.torque / self.roller.radius / self.material.youngs_modulus
        return FrictionCondition(self.roller.friction, force, self.direction)

    @property
    def target_tolerance(self) -> float:
        """Relative tolerance of a prescribed load or peak pressure [-]."""
        return STICK_SECANT_TOLERANCE if self.turns_with_friction else SECANT_TOLERANCE


@dataclass(frozen=True, eq=False)
class ContactSolution:
    """Contact of an indenter on a surface, in units of the relaxed modulus."""

    surface: SurfaceCompliance
    indenter: Indenter
    patch: ContactPatch
    shear: ShearSolution | None = None

    @property
    def resultant(self) -> Array:
        """Force (x, y) on the mix [m], shape (2,)."""
        patch = self.patch
        along = patch.direction[0] - self.indenter.slope(patch.x) * patch.direction[1]
        force = np.array([patch.integral(patch.pressure * part) for part in (along, patch.direction[1])])
        return force if self.shear is None else force + self.shear.resultant

    @property
    def forces(self) -> Array:
        """Forces on all surface nodes [m], shape (2, n)."""
        forces = np.zeros((2, len(self.surface.x)))
        forces[:, self.surface.loaded] = self.patch.forces
        if self.shear is not None:
            forces[:, self.surface.loaded] += self.shear.forces
        return forces

    @property
    def is_beyond_circle(self) -> bool:
        """True if the contact includes points where the roller has a vertical tangent or lies above its centre."""
        patch, indenter = self.patch, self.indenter
        if indenter.profile == "circle":
            return bool(np.abs(patch.x).max() >= indenter.radius)
        return indenter.profile == "deformed" and bool((patch.direction - patch.shear)[1].max() >= 0)


@dataclass(frozen=True)
class Discretisation:
    """Mesh and pressure terms for a contact, with an initial guess of it.

    Parameters
    ----------
    half_width : float
        Half-width of the contact for which the mesh is fine [m].
    indentation : float
        Initial guess of the indentation [m].
    terms : int
        Pressure terms.
    edges : (float, float), optional
        Initial guess of the trailing and leading edge in x [m].
    """

    mesh: RowMesh
    half_width: float
    indentation: float
    terms: int
    edges: Edges | None = None


def solve_contact(
    problem: RollingProblem, discretisation: Discretisation, tolerance: float = SECANT_TOLERANCE
) -> ContactSolution:
    """Solve a steady contact in a loaded zone that is wide enough, its load or peak pressure within a tolerance [-]."""
    mesh = discretisation.mesh
    return expand_window(
        discretisation,
        lambda window: solve_at_target(problem, steady_surface(problem, mesh, window), discretisation, tolerance),
    )


def expand_window(discretisation: Discretisation, solve: Callable[[float], Found]) -> Found:
    """Call `solve(window)` with a growing half-width of the loaded zone [m] until the zone contains the contact.

    `solve` raises `BeyondWindowError` where the zone is too small.
    """
    window = WINDOW * discretisation.half_width
    for _ in range(MAX_WINDOWS):
        try:
            return solve(window)
        except BeyondWindowError as beyond:
            window, reason = WINDOW_GROWTH * window, beyond
    raise UnresolvedError(f"the contact extends beyond a loaded zone of {window:.3g} m to either side: {reason}")


def steady_surface(problem: RollingProblem, mesh: RowMesh, window: float) -> SurfaceCompliance:
    """Compliance of the viscoelastic layer in steady motion, loaded within a half-width `window` [m] of the mesh."""
    surface = elastic_surface(problem, mesh, window)
    return surface.retarded(steady_creep_operator(surface.x, problem.material, problem.speed))


def elastic_surface(
    problem: RollingProblem, mesh: RowMesh, window: float, stretch_rate: bool = False
) -> SurfaceCompliance:
    """Compliance of the elastic layer of unit modulus, or its derivative by the log of a stretch along x."""
    behind = 0 if problem.speed > 0 or problem.layer.base == "bonded" else 1
    condense = stretch_derivative if stretch_rate else surface_compliance
    return condense(mesh, problem.material.poisson, problem.layer, window, problem.needs_shear, behind)


def solve_at_target(
    problem: RollingProblem,
    surface: SurfaceCompliance,
    discretisation: Discretisation,
    tolerance: float = SECANT_TOLERANCE,
    initial_guess: ContactSolution | None = None,
) -> ContactSolution:
    """Solve the contact with the prescribed indentation, load or peak pressure of the roller.

    A relative tolerance [-] is `STICK_SECANT_TOLERANCE` at least with stick.
    """
    if problem.roller.indentation is not None:
        return solve_at_indentation(problem, surface, problem.roller.indentation, discretisation, initial_guess)
    tolerance = max(tolerance, problem.target_tolerance)
    modulus, (name, value) = problem.material.youngs_modulus, problem.roller.target
    logs: list[float] = []
    errors: list[float] = []
    history: tuple = ()
    contact, beyond, log = initial_guess, None, np.log(discretisation.indentation)
    for _ in range(MAX_SECANTS):
        found = solve_at_indentation(problem, surface, float(np.exp(log)), discretisation, contact)
        history += found.patch.history
        if found.is_beyond_circle:  # the resultant needs the slope of the circle
            beyond, log = found, (log + logs[-1]) / 2 if logs else log - 1
            continue
        contact = found
        logs.append(log)
        reached = -modulus * contact.resultant[1] if name == "load" else modulus * contact.patch.peak
        errors.append(float(np.log(reached / value)))
        if abs(errors[-1]) < tolerance:
            return replace(contact, patch=replace(contact.patch, history=history))
        slope = INITIAL_POWER if len(logs) == 1 else (errors[-1] - errors[-2]) / (logs[-1] - logs[-2])
        log = log - np.clip(errors[-1] / slope, -MAX_LOG_STEP, MAX_LOG_STEP)
    if beyond is not None:
        raise RuntimeError(beyond_circle_message(beyond.patch.edges, problem.roller.radius))
    nearest = int(np.argmin(np.abs(errors)))
    raise UnresolvedError(
        f"`{name}` {value:.6g} is not reached in {len(logs)} secant steps; the nearest is "
        f"{np.expm1(errors[nearest]):+.1e} off, at an indentation of {1e3 * np.exp(logs[nearest]):.4g} mm"
    )


def solve_at_indentation(
    problem: RollingProblem,
    surface: SurfaceCompliance,
    indentation: float,
    discretisation: Discretisation,
    initial_guess: ContactSolution | None = None,
) -> ContactSolution:
    """Solve the contact at an indentation, with its shear where the roller turns with friction.

    Parameters
    ----------
    problem : RollingProblem
        Layer, roller and speed.
    surface : SurfaceCompliance
        Compliance of the surface.
    indentation : float
        Indentation [m].
    discretisation : Discretisation
        Mesh and terms of the pressure.
    initial_guess : ContactSolution, optional
        Solution of a neighbouring contact.

    Returns
    -------
    ContactSolution
    """
    indenter, terms = problem.indenter(indentation), discretisation.terms
    patch, shear = (None, None) if initial_guess is None else (initial_guess.patch, initial_guess.shear)
    if problem.turns_with_friction:
        patch = patch or solve_contact_patch(surface, indenter, terms, None, discretisation.edges)
        contact = solve_stick_slip(surface, indenter, terms, problem.friction, patch, shear)
        return ContactSolution(surface, indenter, *contact)
    patch = solve_contact_patch(surface, indenter, terms, patch, discretisation.edges)
    return ContactSolution(surface, indenter, with_peak_pressures(surface, indenter, patch))
