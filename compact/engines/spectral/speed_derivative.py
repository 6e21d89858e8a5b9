"""Derivative of the resistance with respect to speed, and added mass M, of a rolling contact by the Galerkin method.

In the roller frame a creep branch z of a displacement w follows z + theta (dz/dt - v dz/dx) = w. For a small
acceleration a, p = p_ss(x; v) + a p_1(x; v) and d/dt = a d/dv. With the symbols D = 1/(1 - ik v theta) of the branches
and the C, S of `galerkin_system` this gives, in contact and with edges free to move,

    C S dp_ss/dv = -C_v S p_ss,    C S p_1 = Z S p_ss + Y S dp_ss/dv,
    C_v = sum share/v (D^2 - D),   Y = C_v/(ik) = sum share theta D^2,   Z = C_vv/(2ik) = sum share theta/v (D^3 - D^2).

Both pressures are singular at the edges, which move, so they are not computed as functions of x. A change of the
pressure is a change of its coefficients b, of the logarithm of the half-width and of the centre, at constant
xi = (x - centre)/half-width. At a fixed x a field q changes by

    dq|x = dq|xi - (d centre + half-width xi d log half-width) dq/dx.

Powers of D are derivatives of D with respect to the length l = v theta, D^2 = (l D)' and D^3 = (l^2 D)''/2. They are
computed by central differences of the exact matrices at five lengths. The logarithm of the speed is the variable of
differentiation, which requires v C_v, v Y and v^2 Z.
"""

from dataclasses import replace

import numpy as np
from scipy.linalg import lu_factor, lu_solve
from threadpoolctl import threadpool_limits

from compact.engines.spectral import engine as spectral
from compact.engines.spectral.galerkin_system import CreepCompliance, assemble_system, pressure_polynomials
from compact.material.laws import Elastic
from compact.numerics import Array
from compact.numerics.validation import require_positive
from compact.resistance import ResistanceExpansion
from compact.rolling_contact import Layer, Roller

ADDED_MASS_RTOL = 1e-4  # [-], default tolerance of M over the larger of |M| and |tau dF_ss/dv|
ADDED_MASS_RTOL_MAX = 1e-2  # [-], error with the most modes above which M is not returned
AGREEING_SOLUTIONS = 3  # [-], numbers of modes that must agree: two may both miss a short branch
CHANGE_ERROR_FACTOR = 2.0  # [-], error over the largest change among them
DIFFERENCE_ERROR = 1e-6  # [-], error of the finite differences, over the same scale
LENGTH_ERROR = 1e-12  # [-], error by rounding times the longest creep length in half-widths, over the same scale
LENGTH_STEP = 0.01  # [-], relative distance of the lengths in the finite differences
WIDTH_STEP = 3e-4  # [-], relative change of the half-width in central differences
STENCIL = np.arange(-2, 3)
FIRST_DERIVATIVE = np.array([1, -8, 0, 8, -1]) / 12
SECOND_DERIVATIVE = np.array([-1, 16, -30, 16, -1]) / 12


def expand_resistance(
    layer: Layer, roller: Roller, material: Elastic, speed: float, *, rtol: float = ADDED_MASS_RTOL
) -> ResistanceExpansion:
    """Compute the expansion of the resistance in speed and acceleration.

    Parameters
    ----------
    layer, roller, material, speed
        See `spectral.roll`; the prescribed quantity is constant during the motion.
    rtol : float
        Tolerance of M over the larger of |M| and |tau dF_ss/dv| [-].

    Raises
    ------
    RuntimeError
        If M does not converge, or the creep lengths are below 1e-10 half-widths, where it has no digits.
    """
    problem, half_width = spectral.build_rolling_problem(layer, roller, material, speed)
    require_positive(rtol=rtol)
    branches = getattr(material, "branches", ())
    if not branches:
        rolled = spectral.roll(layer, roller, material, speed)
        return ResistanceExpansion(speed, rolled.resistance, 0.0, 0.0, 0.0, 0.0)
    time, longest = max(time for _, time in branches), problem.creep.lengths[-1]
    masses: list[float] = []
    errors: list[tuple[int, float]] = []
    with threadpool_limits(1):  # the matrices are too small for threads
        for modes in spectral.MODE_COUNTS:
            contact = spectral.solve_contact(problem, modes, half_width)
            half_width = contact.half_width
            if not LENGTH_ERROR * half_width < ADDED_MASS_RTOL_MAX * longest:
                raise RuntimeError(
                    f"the longest creep length is {longest / half_width:.1g} half-widths, too short for the digits of "
                    "M; use a higher speed, or M = -tau dF_ss/dv, the limit of low speed"
                )
            slope, mass = (float(each) for each in _expansion(problem, contact))  # of the log of the speed
            masses.append(mass)
            if len(masses) < AGREEING_SOLUTIONS:
                continue
            scale = max(abs(mass), time * abs(speed * slope))
            change = float(np.abs(np.diff(masses[-AGREEING_SOLUTIONS:])).max())
            errors.append((modes, CHANGE_ERROR_FACTOR * change / scale))
            if errors[-1][1] <= rtol:
                break
    error = errors[-1][1]
    if not error <= max(rtol, ADDED_MASS_RTOL_MAX):
        raise RuntimeError(
            f"the added mass M does not converge: (modes, error over the larger of |M| and |tau dF/dv|) were {errors}; "
            "use the engine fem"
        )
    error = (error + DIFFERENCE_ERROR + LENGTH_ERROR * half_width / longest) * scale
    steady = float(np.sign(speed) * contact.resistance)
    return ResistanceExpansion(speed, steady, slope / abs(speed), mass / speed**2, error / speed**2, time)


def _expansion(problem, contact):
    """Compute v dF_ss/dv and v^2 M of a contact.

    A change is a vector of the coefficients b, the logarithm of the half-width and the centre [m], shape (modes + 2,).
    A surface is represented by -u' under T_0 ... T_modes and u under T_0, also of shape (modes + 2,).
    """
    a, b, basis, creep = contact.half_width, contact.coefficients, contact.basis, problem.creep
    x, tests = a * basis.nodes, basis.tests

    def surfaces(of: CreepCompliance, widening: float = 0.0) -> Array:
        """Surfaces under the pressures b_k = 1 on a contact widened by a share, shape (modes + 2, modes)."""
        wide = a * (1 + widening)
        _, matrix, depths = assemble_system(replace(problem, creep=of), len(b), wide)
        return wide / problem.roller.radius * np.vstack([matrix, wide * depths])

    def widened(of: CreepCompliance) -> Array:
        """Return the derivative of the surface with respect to the log half-width at constant b and xi."""
        return (surfaces(of, WIDTH_STEP) - surfaces(of, -WIDTH_STEP)) @ b / (2 * WIDTH_STEP)

    def at_nodes(moments: Array) -> Array:
        """Values at the nodes of a field with given moments under T_0 ... T_modes."""
        polynomials = tests / tests[0] * (2 / basis.unit_test)
        return moments[0] / 2 * polynomials[0] + moments[1:] @ polynomials[1:]

    # derivative of the surface less the roller by a change; the last row is the prescribed quantity
    slope, curvature = problem.slope(contact.centre + x)
    tangent = np.zeros((len(b) + 2, len(b) + 2))
    tangent[:, :-2], tangent[:, -2] = surfaces(creep), widened(creep)
    for column, shift in ((-2, x), (-1, 1.0)):
        tangent[:-1, column] -= tests @ (shift * curvature)
        tangent[-1, column] += tests[0] @ (shift * slope)
    if problem.roller.target[0] != "indentation":
        tangent[-1] = _target_gradient(problem, contact)
    factors = lu_factor(tangent)

    def compensating(surface: Array) -> Array:
        """Change of the contact that compensates an additional surface."""
        prescribed = surface[-1] if problem.roller.target[0] == "indentation" else 0.0
        return lu_solve(factors, -np.append(surface[:-1], prescribed))

    speed_load = surfaces(_creep_polynomial(creep, -1, 1, 0)) @ b  # of v C_v
    change = compensating(speed_load)
    acceleration_load = surfaces(_creep_polynomial(creep, 0, -creep.lengths, creep.lengths)) @ b  # of v^2 Z
    # v Y of the change of the pressure, at fixed x: that at fixed xi less the shift of the field
    memory, shift = _creep_polynomial(creep, 0, creep.lengths, 0), change[-1] + change[-2] * x
    retarded = surfaces(memory)
    acceleration_load += retarded @ change[:-2] + change[-2] * widened(memory)
    acceleration_load[:-1] -= tests @ (shift * at_nodes(speed_load[:-1]))
    acceleration_load[-1] += tests[0] @ (shift * at_nodes(retarded[:-1] @ b))

    x = a * basis.pressure_nodes
    slope, curvature = problem.slope(contact.centre + x)
    force = contact.scale * a
    of_b = force * (basis.pressures @ slope)
    of_b[0] += force * problem.friction * basis.unit_load
    of_width = 2 * contact.resistance + force * b @ (basis.pressures @ (x * curvature))
    gradient = np.append(of_b, [of_width, force * b @ (basis.pressures @ curvature)])  # of the resistance
    return gradient @ change, gradient @ compensating(-acceleration_load)


def _target_gradient(problem, contact):
    """Return the derivative of the load or the peak pressure with respect to the contact, over its scale."""
    gradient = np.zeros(len(contact.coefficients) + 2)
    if problem.roller.target[0] == "load":
        gradient[0], gradient[-2] = 1.0, 2 * contact.coefficients[0]
        return gradient
    xi, alpha = contact.peak_position, contact.basis.trailing_exponent
    gradient[:-2] = pressure_polynomials(xi, alpha, len(gradient) - 2) * (1 - xi) ** (1 - alpha) * (1 + xi) ** alpha
    gradient[-2] = gradient[:-2] @ contact.coefficients
    return gradient


def _creep_polynomial(creep, first, second, third):
    """`CreepCompliance` sum share (first D + second D^2 + third D^3), by central differences over the lengths."""
    ratio = 1 + LENGTH_STEP * STENCIL
    shares = np.multiply.outer(creep.shares * first, STENCIL == 0)
    shares = shares + np.multiply.outer(creep.shares * second, ratio * FIRST_DERIVATIVE / LENGTH_STEP)
    shares = shares + np.multiply.outer(creep.shares * third, ratio**2 * SECOND_DERIVATIVE / (2 * LENGTH_STEP**2))
    return CreepCompliance(0.0, shares.ravel(), np.outer(creep.lengths, ratio).ravel())
