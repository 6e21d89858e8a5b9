"""Engine "spectral": steady rolling on a linear layer of plies over a rigid base, by a Galerkin method.

Plane strain, elastic or viscoelastic layer, bonded or frictionless base. The roller is frictionless or in full slip
with the traction f p. The pressure on the unknown contact |x - centre| <= a is

    p = (E* a/2R) (1 - xi)^(1 - alpha) (1 + xi)^alpha sum b_k Q_{k-1}(xi),    cot(pi alpha) = f (1 - 2 nu)/(2 - 2 nu).

It vanishes at both edges with the exponents of the instantaneous response, 1/2 without friction. In contact the surface
has the slope of the roller, u' = -gap'. Tested with polynomials over the same edge powers this is a linear system for
the b_k, see `galerkin_system`, and one more row for the centre. The half-width follows from the prescribed indentation,
load or peak pressure by a secant method. Lengths are seen along the travel, speed > 0.

The number of modes is raised until the estimated errors are below the tolerance. The error estimate compares with the
next number of modes, at the same target. It adds the boundary layers of branches that are too fast for either. The
elastic frictionless contact under a parabola with few modes is an estimate for meshes and initial guesses.

Limits: small strains, no inertia, no stick.

References
----------
K. L. Johnson, Contact Mechanics, CUP 1985, sections 2.7, 5.8; S. C. Hunter, J. Appl. Mech. 28 (1961) 611.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.linalg import lu_factor, lu_solve
from threadpoolctl import threadpool_limits

from compact import rolling_contact
from compact.engines.spectral import SPECTRAL, galerkin_system
from compact.engines.spectral.galerkin_system import JacobiBasis, RollingProblem
from compact.material.laws import Elastic, Viscoelastic
from compact.numerics import Array
from compact.numerics.validation import require_instance, require_positive
from compact.rolling_contact import Contact, Layer, Roller

NAMES = ("load", "resistance", "peak_pressure", "indentation")  # of numbers of a `ContactSolution`
MODE_COUNTS = 16, 24, 36, 54, 80, 120, 180, 270, 405, 610  # [-], tried in turn; the error is estimated from the next
SPECTRAL_RTOL = 1e-5  # [-], default tolerance of load and resistance, a tenth of that of the peak pressure
SPECTRAL_RTOL_MAX = 1e-3  # [-], error with the most modes above which the contact is not returned
TARGET_RTOL = 1e-9  # [-], residual of the prescribed quantity that is guaranteed
ARITHMETIC_ERROR = 1e-13  # [-], relative error by rounding, over the instantaneous share of the compliance
MODE_ERROR_FACTOR = 2.0  # [-], error over the change to the next number of modes
PEAK_ERROR_RATIO = 10  # [-], tolerance of the peak pressure over that of the load
SPECTRUM_LIMIT = 100.0  # [-], wave number times half-width from which the spectrum is a power law
PRESSURE_SAMPLES = 201  # [-], points along the contact, denser at its edges
HALF_WIDTH_TOLERANCE = 1e-12  # [-], residual of the target at which the half-width is accepted
HALF_WIDTH_STEPS_MAX = 60  # [-], of the secant method, and of Newton's method for the centre
HALF_WIDTH_STEP = 1e-4  # [-], relative, for derivatives by the half-width; its square: the smallest useful secant
CENTRE_TOLERANCE = 1e-14  # [-], last step of the centre over the half-width
ESTIMATE_MODES = 12  # [-], pressure polynomials of the elastic estimate
ESTIMATE_TOLERANCE = 1e-6  # [-], residual of its target
HALF_WIDTH_SHARE_MIN = 1e-12  # [-], over the height; below it the contact is narrower than an atom
WIDTH_RATIO = 1.2  # [-], of the half-widths that share a mesh where the indentation is not prescribed
WIDTH_ITERATIONS = 4  # [-], fixed-point iterations for the modulus at the frequency of the contact
INITIAL_WIDTH_MAX = 2.0  # [-], initial half-width over the top ply, since wide contacts cost more modes


@dataclass(frozen=True)
class ContactSolution:
    """Contact of one half-width in which the surface has the slope of the roller.

    Parameters
    ----------
    basis : JacobiBasis
        Polynomials of the pressure, and tests.
    half_width : float
        Half-width a [m].
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

    basis: JacobiBasis
    half_width: float
    centre: float
    coefficients: Array
    scale: float
    indentation: float
    load: float
    resistance: float

    def pressure(self, xi: Array | float) -> Array:
        """Return the pressure p [Pa] at xi in [-1, 1]."""
        alpha = self.basis.trailing_exponent
        polynomials = galerkin_system.pressure_polynomials(xi, alpha, len(self.coefficients))
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


def roll(layer: Layer, roller: Roller, material: Elastic, speed: float, *, rtol: float = SPECTRAL_RTOL) -> Contact:
    """Compute steady rolling over a linear layer by the engine "spectral".

        int K(x - s) p(s) ds = indentation - gap(x) in contact,  p >= 0,
        resistance = int p gap' dx + f P

    Parameters
    ----------
    layer : Layer
        Layer of any height and plies; the contact may be a hundred times as wide as the top ply is thick.
    roller : Roller
        Roller of profile "parabola" or "circle", with a vertical gap. It is "frictionless", "sliding" (traction f p on
        the mix along the travel), "driven" (full slip against the travel) or "free" without friction.
    material : Elastic or Viscoelastic
        Mix, 0 <= nu < 0.5.
    speed : float
        Speed of the roller along x [m/s], not 0. An elastic layer is independent of its size.
    rtol : float
        Tolerance of load and resistance [-]. The default is a point of studies/speed_against_error.py, where 1e-3 is
        no faster.

    Returns
    -------
    Contact
        For speed < 0 leading and trailing remain positive ahead; x, shear_traction and resistance refer to the fixed
        axis x.

    Raises
    ------
    RuntimeError
        If the contact is not found or its error exceeds 1e-3 and `rtol`.

    Notes
    -----
    On a frictionless base a sliding roller drags the whole layer along. The layer is then supported from behind,
    free of stress ahead, and the indentation refers to the surface ahead.

    Examples
    --------
    >>> from compact.material.laws import Viscoelastic
    >>> from compact.rolling_contact import Layer, Roller
    >>> mix = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 0.1),))
    >>> rolled = roll(Layer(0.22), Roller(0.11, indentation=0.003), mix, speed=0.3)
    >>> f"load {rolled.load:.1f} N/m, resistance {rolled.resistance:.2f} N/m"
    'load 20455.8 N/m, resistance 392.89 N/m'
    """
    problem, half_width = build_rolling_problem(layer, roller, material, speed)
    require_positive(rtol=rtol)
    history: list[tuple[int, float, float]] = []
    with threadpool_limits(1):  # the matrices are too small for threads
        for modes, next_modes in pairwise(MODE_COUNTS):
            contact = solve_contact(problem, modes, half_width)
            half_width, (*error, peak_error) = contact.half_width, _estimate_errors(problem, contact, next_modes)
            history.append((modes, *error))
            if max(*error, peak_error / PEAK_ERROR_RATIO) <= rtol:
                break
        allowed = max(rtol, SPECTRAL_RTOL_MAX)
        if not max(*error, peak_error / PEAK_ERROR_RATIO) <= allowed:
            raise RuntimeError(
                f"{modes} modes reach a relative error of {max(error):.1g}, allowed is {allowed:.1g}; before them "
                + ", ".join(f"{step[0]} modes {max(step[1:]):.1g}" for step in history[:-1])
            )
        xi = -np.cos(np.linspace(0, np.pi, PRESSURE_SAMPLES))
        pressure, x = contact.pressure(xi), contact.centre + contact.half_width * xi
        found = Contact(
            leading=float(x[-1]),
            trailing=float(x[0]),
            x=x,
            pressure=pressure,
            shear_traction=problem.friction * pressure,
            error=history[-1][1:],
            work_residual=_work_residual(problem, contact),
            history=tuple(history),
            **{name: getattr(contact, name) for name in NAMES},
        )
    return rolling_contact.require_on_target(rolling_contact.for_travel(found, speed), roller, TARGET_RTOL)


def _estimate_errors(problem, contact, next_modes):
    """Estimated relative errors of load, resistance and peak pressure.

    The solution with more modes, at the same half-width, has a residual in the target; so has, by a little, the
    contact. Both are extrapolated along the half-width to the target. A prescribed load is exact: its error is that at
    the indentation found.
    """
    modes, a, (target, value) = len(contact.coefficients), contact.half_width, problem.roller.target
    wider, finer = solve_pressure(problem, modes, a * (1 + HALF_WIDTH_STEP)), solve_pressure(problem, next_modes, a)
    of_contact, of_wider, of_finer = (np.array([getattr(c, name) for name in NAMES]) for c in (contact, wider, finer))

    def change(target: str, value: float) -> Array:
        k = NAMES.index(target)
        derivative = (of_wider - of_contact) / (of_wider[k] - of_contact[k])
        return of_finer - of_contact - derivative * (of_finer[k] - value)

    at_depth = ("indentation", contact.indentation) if target == "load" else (target, value)
    changes = np.array([change(*at_depth)[0], *change(target, value)[1:3]])
    scale = [contact.load, rolling_contact.resistance_scale(contact.resistance, contact.load), contact.peak_pressure]
    load_error = contact.load * (_fast_branch_error(problem, contact) + ARITHMETIC_ERROR / problem.creep.instant)
    resistance_share = max(abs(problem.friction), 2 * a / problem.roller.radius)
    error = (MODE_ERROR_FACTOR * np.abs(changes) + load_error * np.array([1.0, resistance_share, 0.0])) / scale
    return tuple(error.tolist())


def _fast_branch_error(problem, contact):
    """Relative error of the load by branches too fast for the modes.

        1/2 sum modes share^2 y^3 exp(-modes^2 y),  y = relaxation length/half-width

    Polynomials of degree n resolve a/n^2 at an edge. A branch that is much shorter has its full effect except for a
    boundary layer, which more modes do not change until they resolve it. Shares are stiffnesses of a branch over those
    of all slower ones. The sum is a fit: 0.5-1 times the error of systems of 600 modes with y 1e-5 to 0.01, shares 0.1
    to 10, contacts 0.2 and 1.5 heights wide on both bases, friction 0 and 0.6.
    """
    creep, modes = problem.creep, len(contact.coefficients)
    shares = creep.shares / (creep.instant + np.cumsum(creep.shares))
    y = (1 - shares) * creep.lengths / contact.half_width
    return float(np.sum(0.5 * modes * (shares / (1 - shares)) ** 2 * y**3 * np.exp(-(modes**2) * y)))


def _work_residual(problem, contact):
    """Energy-balance residual over the larger of the resistance and 1e-3 of the load; theory.md 3.1.

        int p gap' dx = (2/pi E*) int_0^inf (L Im C - f M Re C) |p|^2 dk

    The right side is the work of p dissipated in the layer, from the Fourier transform of p and the complex compliance:
    it uses none of the closed forms from which the pressure is computed. The work of f p on slip and on the stretching
    of the surface is equal on both sides and left out. Beyond SPECTRUM_LIMIT |p|^2 is a power law.
    """
    basis, a = contact.basis, contact.half_width
    tau, weight, squared = galerkin_system.power_spectrum(basis, contact.coefficients, SPECTRUM_LIMIT)
    tail = np.geomspace(SPECTRUM_LIMIT, 1e9 * SPECTRUM_LIMIT, 2001)
    power = 2 + 2 * min(basis.trailing_exponent, 1 - basis.trailing_exponent)
    level = np.average(squared * tau**power, weights=weight * (tau > SPECTRUM_LIMIT / 2))
    dissipated = np.sum(weight * problem.dissipation_symbol(tau / a) * squared)
    dissipated += np.trapezoid(problem.dissipation_symbol(tail / a) * level * tail ** (1 - power), np.log(tail))
    dissipated *= 2 * a * contact.scale**2 / (np.pi * problem.contact_modulus)
    work = contact.resistance - problem.friction * contact.load
    return float(abs(work - dissipated) / rolling_contact.resistance_scale(contact.resistance, contact.load))


def build_rolling_problem(
    layer: Layer, roller: Roller, material: Elastic, speed: float
) -> tuple[RollingProblem, float]:
    """Build the `RollingProblem` of a contact at a speed [m/s] of either sign, and a first guess of its half-width [m].

    The guess is that of Hertz or sqrt(R delta), at most `INITIAL_WIDTH_MAX` top plies. ValueError for a contact outside
    the range of the engine.
    """
    SPECTRAL.require(layer, roller, speed)
    require_instance(Elastic, "Elastic or Viscoelastic for the engine spectral", material=material)
    problem = RollingProblem(layer, roller, material, galerkin_system.creep_compliance(material, speed, layer.height))
    (target, value), radius, modulus = roller.target, roller.radius, problem.contact_modulus
    half_width = {
        "indentation": np.sqrt(radius * value),
        "load": np.sqrt(4 * value * radius / (np.pi * modulus)),
        "peak_pressure": 2 * radius * value / modulus,
    }[target]
    if half_width < HALF_WIDTH_SHARE_MIN * layer.height:
        raise RuntimeError(
            f"the roller does not touch the layer: `{target}` {value!r} makes a contact of {half_width:.1g} m; raise it"
        )
    return problem, float(min(half_width, INITIAL_WIDTH_MAX * layer.top.thickness, problem.widest))


def solve_contact(
    problem: RollingProblem, modes: int, half_width: float, tolerance: float = HALF_WIDTH_TOLERANCE
) -> ContactSolution:
    """Find the half-width at which the contact has its target, from a first guess [m].

    Notes
    -----
    Secant method for the logarithm of the target over the logarithm of the half-width.
    """
    (target, prescribed), widest = problem.roller.target, np.log(problem.widest)
    log_a, residual, power, step = np.log(half_width), None, 2.0, 0.0
    for _ in range(HALF_WIDTH_STEPS_MAX):
        contact = solve_pressure(problem, modes, float(np.exp(log_a)))
        value = getattr(contact, target)
        if not 0 < value < np.inf:
            raise RuntimeError(f"`{target}` must be positive, got {value:.3g} at the half-width {np.exp(log_a):.3g} m")
        previous, residual = residual, np.log(value / prescribed)
        if abs(step) > HALF_WIDTH_STEP**2:
            power = np.clip((residual - previous) / step, 0.5, 20)
        step = np.clip(-residual / power, -1, min(1, widest - log_a))
        if abs(residual) < tolerance:
            return contact
        log_a += step
    raise RuntimeError(
        f"half-width not found in {HALF_WIDTH_STEPS_MAX} steps with {modes} modes, relative residual of "
        f"`{target}` {residual:.1g}"
    )


def solve_pressure(problem: RollingProblem, modes: int, half_width: float) -> ContactSolution:
    """Solve for the pressure on a half-width [m] with as many tests T_m, m >= 1, as modes; T_0 gives the centre."""
    a, R = half_width, problem.roller.radius
    basis, matrix, depths = galerkin_system.assemble_system(problem, modes, a)
    x, tests = a * basis.nodes, basis.tests
    factors = lu_factor(matrix[1:])
    centre = _find_centre(problem, x, a, tests[0] - lu_solve(factors, matrix[0], trans=1) @ tests[1:])
    b = lu_solve(factors, tests[1:] @ problem.slope(centre + x)[0] * (R / a))
    scale = problem.contact_modulus * a / (2 * R)
    load = scale * a * basis.unit_load * b[0]
    depth = a**2 / R * (depths @ b) + tests[0] @ problem.gap(centre + x)
    inclination = basis.pressures @ problem.slope(centre + a * basis.pressure_nodes)[0]
    resistance = scale * a * (b @ inclination) + problem.friction * load
    return ContactSolution(basis, a, centre, b, scale, float(depth / basis.unit_test), float(load), float(resistance))


def _find_centre(problem, x, a, row):
    """Middle of the contact [m] at which the equation of T_0 holds, by Newton's method."""
    centre, roller = 0.0, problem.roller
    for _ in range(HALF_WIDTH_STEPS_MAX):
        if abs(centre) + a >= roller.radius and roller.profile == "circle":
            raise RuntimeError(
                f"the contact, {a:.3g} m to either side of {centre:.3g} m, is wider than the circle of radius "
                f"{roller.radius:.3g} m; reduce the load or the indentation"
            )
        slope, curvature = problem.slope(centre + x)
        step = (row @ slope) / (row @ curvature)
        centre -= step
        if abs(step) <= CENTRE_TOLERANCE * a:
            return float(centre)
    raise RuntimeError(
        f"centre of the contact not found in {HALF_WIDTH_STEPS_MAX} steps, last step {step:.1g} m at a half-width of "
        f"{a:.3g} m"
    )


def expected_half_width(layer: Layer, roller: Roller, material: Elastic, speed: float) -> float:
    """Estimate the half-width [m] of a rolling contact.

    It is that of the relaxed modulus if the indentation is prescribed, else that of the modulus at the frequency
    speed/half-width, quantised. The error is 1e-3, and a few percent if the contact is many times as wide as the top
    ply is thick.
    """
    target = replace(roller, friction=0.0, rolling="frictionless", profile="parabola")
    elastic = Elastic(youngs_modulus=material.youngs_modulus, poisson=material.poisson)
    half_width = relaxed = _elastic_half_width(layer, target, elastic)
    if roller.indentation is not None or not isinstance(material, Viscoelastic) or not material.branches:
        return relaxed
    for _ in range(WIDTH_ITERATIONS):
        modulus = float(abs(material.complex_modulus(speed / half_width)))
        half_width = _elastic_half_width(layer, target, replace(elastic, youngs_modulus=modulus))
    return quantise_half_width(half_width, relaxed)


@lru_cache(maxsize=256)
def _elastic_half_width(layer, roller, elastic):
    """Estimated half-width [m] on an elastic layer."""
    problem, half_width = build_rolling_problem(layer, roller, elastic, 1.0)
    return solve_contact(problem, ESTIMATE_MODES, half_width, ESTIMATE_TOLERANCE).half_width


def quantise_half_width(half_width: float, widest: float) -> float:
    """Round a half-width [m] up to the widest over a power of WIDTH_RATIO, so that several speeds share a mesh."""
    return float(widest / WIDTH_RATIO ** np.floor(np.log(widest / half_width) / np.log(WIDTH_RATIO)))


def contact_of_half_width(layer: Layer, material: Elastic, radius: float, half_width: float) -> ContactSolution:
    """Estimate the elastic frictionless contact of a half-width [m] under a parabola of a radius [m]."""
    elastic = Elastic(youngs_modulus=material.youngs_modulus, poisson=material.poisson)
    problem, _ = build_rolling_problem(layer, Roller(radius, indentation=half_width**2 / radius), elastic, 1.0)
    return solve_pressure(problem, ESTIMATE_MODES, half_width)
