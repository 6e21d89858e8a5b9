"""Steady rolling contact on a linear layer, solved for its half-width with a given number of modes.

The pressure on the unknown contact |x - centre| <= a is

    p = (E* a/2R) (1 - xi)^(1 - alpha) (1 + xi)^alpha sum b_k Q_{k-1}(xi),    cot(pi alpha) = f (1 - 2 nu)/(2 - 2 nu).

It vanishes at both edges with the exponents of the instantaneous response, 1/2 without friction. In contact the surface
has the slope of the roller, u' = -gap'. Tested with polynomials over the same edge powers this is a linear system for
the b_k, see `galerkin_system`, and one more row for the centre. The half-width follows from the prescribed indentation,
load or peak pressure by a secant method. Lengths are seen along the travel, speed > 0.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from compact.engines.spectral.elastic_estimate import initial_half_width, surface_modulus
from compact.engines.spectral.galerkin_system import GalerkinSystem, assemble_system
from compact.engines.spectral.jacobi_basis import pressure_polynomials
from compact.engines.spectral.layer_compliance import LayerResponse, creep_compliance
from compact.material.laws import Elastic
from compact.numerics import Array
from compact.rolling_contact import Layer, Roller

TRACTION_SIGN = {"frictionless": 0, "free": 0, "sliding": 1, "driven": -1}  # [-], of the traction on the mix
HALF_WIDTH_TOLERANCE = 1e-12  # [-], residual of the target at which the half-width is accepted
HALF_WIDTH_STEPS_MAX = 60  # [-], of the secant method, and of Newton's method for the centre
HALF_WIDTH_STEP = 1e-4  # [-], relative, for derivatives by the half-width; its square: the smallest useful secant
CENTRE_TOLERANCE = 1e-14  # [-], last step of the centre over the half-width
CIRCLE_SHARE_MAX = 0.9  # [-], largest half-width over the radius of a circle


class ModeRefinement(NamedTuple):
    """Solution with one number of modes.

    Attributes
    ----------
    modes, half_width : int, float
        Number of pressure polynomials, and half-width a [m].
    load, resistance : float
        Forces per unit roller length [N/m].
    error : tuple of float
        Estimated relative errors of load and resistance [-].
    """

    modes: int
    half_width: float
    load: float
    resistance: float
    error: tuple[float, float]


@dataclass(frozen=True)
class RollingProblem:
    """Steady rolling contact without its half-width.

    Parameters
    ----------
    contact_modulus : float
        Relaxed E* of the top ply [Pa].
    radius : float
        Roller radius R [m].
    profile : str
        "parabola" or "circle".
    target, value : str, float
        Prescribed "indentation" [m], "load" [N/m] or "peak_pressure" [Pa], and its value.
    """

    response: LayerResponse
    contact_modulus: float
    radius: float
    profile: str
    target: str
    value: float

    @property
    def max_half_width(self) -> float:
        """Largest half-width of the search [m]; a circle ends at its radius."""
        return CIRCLE_SHARE_MAX * self.radius if self.profile == "circle" else np.inf

    def gap(self, x: Array) -> Array:
        """Return the height [m] of the roller above its lowest generatrix at x [m], free of cancellation."""
        R = self.radius
        return x**2 / (2 * R if self.profile == "parabola" else R + np.sqrt(R**2 - x**2))

    def slope(self, x: Array) -> tuple[Array, Array]:
        """Return gap' [-] and gap'' [1/m] at x [m]."""
        R = self.radius
        if self.profile == "parabola":
            return x / R, np.full_like(x, 1 / R)
        root = np.sqrt((R - x) * (R + x))
        return x / root, R**2 / root**3


@dataclass(frozen=True)
class ContactSolution:
    """Contact of one half-width in which the surface has the slope of the roller.

    Parameters
    ----------
    centre : float
        Middle of the contact [m] from the lowest generatrix.
    coefficients : ndarray
        Coefficients b_k of the pressure [-], shape (modes,).
    scale : float
        E* a/2R [Pa].
    indentation : float
        Indentation [m].
    load, resistance : float
        Forces per unit roller length [N/m].
    """

    system: GalerkinSystem
    centre: float
    coefficients: Array
    scale: float
    indentation: float
    load: float
    resistance: float

    @property
    def half_width(self) -> float:
        """Half-width a [m]."""
        return self.system.half_width

    def pressure(self, xi: Array | float) -> Array:
        """Return the pressure p [Pa] at xi in [-1, 1]."""
        alpha = self.system.basis.trailing_exponent
        polynomials = pressure_polynomials(xi, alpha, len(self.coefficients))
        return self.scale * (1 - xi) ** (1 - alpha) * (1 + xi) ** alpha * (self.coefficients @ polynomials)

    @property
    def peak_position(self) -> float:
        """Position xi of the largest pressure [-], by successive refinement of a grid."""
        centre, reach = 0.0, 1.0
        for _ in range(4):
            xi = np.clip(centre + reach * np.linspace(-1, 1, 41), -1, 1)
            centre, reach = xi[np.argmax(self.pressure(xi))], reach / 20
        return float(centre)

    @property
    def peak_pressure(self) -> float:
        """Largest pressure [Pa]."""
        return float(self.pressure(self.peak_position))


def build_rolling_problem(
    layer: Layer, roller: Roller, material: Elastic, speed: float
) -> tuple[RollingProblem, float]:
    """Build the `RollingProblem` of a contact at a speed [m/s] of either sign and estimate its half-width [m]."""
    target, value = roller.target
    friction = TRACTION_SIGN[roller.rolling] * roller.friction
    creep = creep_compliance(getattr(material, "branches", ()), abs(speed), layer.height)
    problem = RollingProblem(
        LayerResponse(layer, material.poisson, friction, creep),
        contact_modulus=surface_modulus(layer, material),
        radius=roller.radius,
        profile=roller.profile,
        target=target,
        value=value,
    )
    half_width = initial_half_width(layer, material, roller.radius, target, value)
    return problem, min(half_width, problem.max_half_width)


def solve_contact(
    problem: RollingProblem, modes: int, half_width: float, history: list[ModeRefinement]
) -> ContactSolution:
    """Find the half-width at which the contact has its target, from a first guess [m]; messages state the history.

    Notes
    -----
    Secant method for the logarithm of the target over the logarithm of the half-width.
    """
    log_a, residual, power, step = np.log(half_width), None, 2.0, 0.0
    for _ in range(HALF_WIDTH_STEPS_MAX):
        contact = solve_pressure(problem, assemble_system(problem.response, modes, np.exp(log_a)), modes)
        value = getattr(contact, problem.target)
        if not 0 < value < np.inf:
            raise RuntimeError(
                f"`{problem.target}` must be positive, got {value:.3g} at the half-width {np.exp(log_a):.3g} m; "
                f"{describe_history(history)}"
            )
        previous, residual = residual, np.log(value / problem.value)
        if abs(step) > HALF_WIDTH_STEP**2:
            power = np.clip((residual - previous) / step, 0.5, 20)
        step = np.clip(-residual / power, -1, min(1, np.log(problem.max_half_width) - log_a))
        if abs(residual) < HALF_WIDTH_TOLERANCE:
            return contact
        log_a += step
    raise RuntimeError(
        f"half-width not found in {HALF_WIDTH_STEPS_MAX} steps with {modes} modes, relative residual of "
        f"`{problem.target}` {residual:.1g}; {describe_history(history)}"
    )


def solve_pressure(problem: RollingProblem, system: GalerkinSystem, modes: int) -> ContactSolution:
    """Solve for the pressure on a given half-width with as many tests T_m, m >= 1, as modes; T_0 gives the centre."""
    basis, R, a = system.basis, problem.radius, system.half_width
    tests = basis.tests[: modes + 1]
    factors = lu_factor(system.matrix[1 : modes + 1, :modes])
    elimination = lu_solve(factors, system.matrix[0, :modes], trans=1)
    centre = _find_centre(problem, basis.nodes, a, tests[0] - elimination @ tests[1:])
    b = lu_solve(factors, tests[1:] @ problem.slope(centre + a * basis.nodes)[0] * (R / a))
    scale = problem.contact_modulus * a / (2 * R)
    load = scale * a * basis.unit_load * b[0]
    depth = a**2 / R * (system.depths[:modes] @ b) + tests[0] @ problem.gap(centre + a * basis.nodes)
    inclination = basis.pressures[:modes] @ problem.slope(centre + a * basis.pressure_nodes)[0]
    return ContactSolution(
        system,
        centre,
        b,
        scale,
        indentation=depth / tests[0].sum(),
        load=load,
        resistance=scale * a * (b @ inclination) + problem.response.friction * load,
    )


def _find_centre(problem, nodes, a, row):
    """Middle of the contact [m] at which the equation of T_0 holds, by Newton's method."""
    centre = 0.0
    for _ in range(HALF_WIDTH_STEPS_MAX):
        if abs(centre) + a >= problem.radius and problem.profile == "circle":
            raise RuntimeError(
                f"the contact, {a:.3g} m to either side of {centre:.3g} m, is wider than the circle of radius "
                f"{problem.radius:.3g} m; reduce the load or the indentation"
            )
        slope, curvature = problem.slope(centre + a * nodes)
        step = (row @ slope) / (row @ curvature)
        centre -= step
        if abs(step) <= CENTRE_TOLERANCE * a:
            return centre
    raise RuntimeError(
        f"centre of the contact not found in {HALF_WIDTH_STEPS_MAX} steps, last step {step:.1g} m at a half-width of "
        f"{a:.3g} m"
    )


def describe_history(history: list[ModeRefinement]) -> str:
    """Describe the solutions with fewer modes in one line, for messages."""
    steps = (
        f"{step.modes} modes: a {step.half_width:.6g} m, load {step.load:.8g} N/m, error {max(step.error):.1g}"
        for step in history
    )
    return f"history: {'; '.join(steps) or 'none'}"
