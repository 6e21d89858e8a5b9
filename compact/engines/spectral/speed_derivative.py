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

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lu_factor, lu_solve
from threadpoolctl import threadpool_limits

from compact.engines.spectral import engine as spectral
from compact.engines.spectral.galerkin_system import (
    CreepCompliance,
    RollingProblem,
    assemble_system,
    pressure_polynomials,
)
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
    spectral.require_spectral_range(layer, roller, material, speed)
    require_positive(rtol=rtol)
    branches = getattr(material, "branches", ())
    if not branches:
        rolled = spectral.roll(layer, roller, material, speed)
        return ResistanceExpansion(speed, rolled.resistance, slope=0.0, added_mass=0.0, error=0.0, relaxation_time=0.0)
    problem, half_width = spectral.build_rolling_problem(layer, roller, material, speed)
    time = max(time for _, time in branches)
    with threadpool_limits(1):  # the matrices are too small for threads
        resistance, slope, added_mass, error = _refine_modes(problem, half_width, rtol, time * abs(speed))
    steady, of_speed = float(np.sign(speed) * resistance), float(slope / abs(speed))
    return ResistanceExpansion(speed, steady, of_speed, float(added_mass / speed**2), float(error / speed**2), time)


def _refine_modes(problem, half_width, rtol, length):
    """Return F_ss, v dF_ss/dv, v^2 M and the error of M, with the modes that `rtol` requires; `length` is v tau [m]."""
    masses, errors, longest = [], [], problem.creep.lengths[-1]
    for modes in spectral.MODE_COUNTS:
        contact = spectral.solve_contact(problem, modes, half_width)
        half_width = contact.half_width
        if not LENGTH_ERROR * half_width < ADDED_MASS_RTOL_MAX * longest:
            raise RuntimeError(
                f"the longest creep length is {longest / half_width:.1g} half-widths, too short for the digits of M; "
                "use a higher speed, or M = -tau dF_ss/dv, the limit of low speed"
            )
        slope, mass = _expansion(problem, contact)
        masses.append(mass)
        if len(masses) < AGREEING_SOLUTIONS:
            continue
        scale = max(abs(mass), length * abs(slope))
        error = CHANGE_ERROR_FACTOR * np.abs(np.diff(masses[-AGREEING_SOLUTIONS:])).max() / scale
        errors.append((modes, float(error)))
        if error <= rtol:
            break
    if not error <= max(rtol, ADDED_MASS_RTOL_MAX):
        raise RuntimeError(
            f"the added mass M does not converge: (modes, error over the larger of |M| and |tau dF/dv|) were {errors}; "
            "use the engine fem"
        )
    return contact.resistance, slope, mass, (error + DIFFERENCE_ERROR + LENGTH_ERROR * half_width / longest) * scale


def _expansion(problem, contact):
    """Compute v dF_ss/dv and v^2 M of a contact."""
    linear, creep = ContactLinearisation(problem, contact), problem.creep
    length, gradient = creep.lengths, linear.resistance_gradient
    speed_load = linear.surface(_creep_polynomial(creep, -1, 1, 0))  # of v C_v
    change = linear.solve(speed_load)
    acceleration_load = linear.surface(_creep_polynomial(creep, 0, -length, length))  # of v^2 Z
    acceleration_load += linear.surface_change(_creep_polynomial(creep, 0, length, 0), change, speed_load)  # of v Y
    return gradient @ change, gradient @ linear.solve(-acceleration_load)


def _creep_polynomial(creep, first, second, third):
    """`CreepCompliance` sum share (first D + second D^2 + third D^3), by central differences over the lengths."""
    ratio = 1 + LENGTH_STEP * STENCIL
    shares = np.multiply.outer(creep.shares * first, STENCIL == 0)
    shares = shares + np.multiply.outer(creep.shares * second, ratio * FIRST_DERIVATIVE / LENGTH_STEP)
    shares = shares + np.multiply.outer(creep.shares * third, ratio**2 * SECOND_DERIVATIVE / (2 * LENGTH_STEP**2))
    return CreepCompliance(0.0, shares.ravel(), np.outer(creep.lengths, ratio).ravel())


@dataclass(frozen=True)
class ContactLinearisation:
    """Contact and its linear response to small changes.

    A change is a vector of the coefficients b, the logarithm of the half-width and the centre [m], shape (modes + 2,).
    A surface is represented by -u' under T_0 ... T_modes and u under T_0, also of shape (modes + 2,).
    """

    problem: RollingProblem
    contact: spectral.ContactSolution

    @property
    def x(self) -> Array:
        """Nodes of the tests [m] from the middle of the contact, shape (n,)."""
        return self.contact.half_width * self.contact.system.basis.nodes

    def surfaces(self, creep: CreepCompliance, widening: float = 0.0) -> Array:
        """Compute the surfaces under the pressures b_k = 1 on a contact widened by a share [-], (modes + 2, modes)."""
        a = self.contact.half_width * (1 + widening)
        system = assemble_system(replace(self.problem, creep=creep), len(self.contact.coefficients), a)
        return a / self.problem.radius * np.vstack([system.matrix, a * system.depths])

    def surface(self, creep: CreepCompliance, widening: float = 0.0) -> Array:
        """Compute the surface under the pressure of the contact, with another `creep`."""
        return self.surfaces(creep, widening) @ self.contact.coefficients

    def width_derivative(self, creep: CreepCompliance) -> Array:
        """Return the derivative of the surface with respect to the log half-width at constant b and xi."""
        return (self.surface(creep, WIDTH_STEP) - self.surface(creep, -WIDTH_STEP)) / (2 * WIDTH_STEP)

    def surface_change(self, creep: CreepCompliance, change: Array, gradient: Array) -> Array:
        """Compute the change of a surface at fixed x under that of the pressure; `gradient` is the surface of du/dx."""
        surfaces, (b, width, centre) = self.surfaces(creep), (change[:-2], *change[-2:])
        tests, shift = self.contact.system.basis.tests, centre + width * self.x
        slope_change = -tests @ (shift * self._nodal_values(gradient[:-1]))
        depth_change = tests[0] @ (shift * self._nodal_values(surfaces[:-1] @ self.contact.coefficients))
        return surfaces @ b + width * self.width_derivative(creep) + np.append(slope_change, depth_change)

    def _nodal_values(self, moments):
        """Values at the nodes of a field with given moments under T_0 ... T_modes."""
        basis = self.contact.system.basis
        polynomials = basis.tests / basis.tests[0] * (2 / basis.unit_test)
        return moments[0] / 2 * polynomials[0] + moments[1:] @ polynomials[1:]

    @cached_property
    def tangent(self) -> tuple[Array, NDArray[np.int32]]:
        """LU factors of the derivative of the surface less the roller; the last row is the prescribed quantity."""
        problem, contact = self.problem, self.contact
        tests, (slope, curvature) = contact.system.basis.tests, problem.slope(contact.centre + self.x)
        rows = np.zeros((len(tests) + 1, len(tests) + 1))
        rows[:, :-2] = self.surfaces(problem.creep)
        rows[:, -2] = self.width_derivative(problem.creep)
        for column, shift in ((-2, self.x), (-1, 1.0)):
            rows[:-1, column] -= tests @ (shift * curvature)
            rows[-1, column] += tests[0] @ (shift * slope)
        if problem.target != "indentation":
            rows[-1] = self.target_gradient
        return lu_factor(rows)

    @property
    def target_gradient(self) -> Array:
        """Return the derivative of the load or the peak pressure with respect to the contact, over its scale."""
        contact, gradient = self.contact, np.zeros(len(self.contact.coefficients) + 2)
        if self.problem.target == "load":
            gradient[0], gradient[-2] = 1.0, 2 * contact.coefficients[0]
            return gradient
        xi, alpha = contact.peak_position, contact.system.basis.trailing_exponent
        polynomials = pressure_polynomials(xi, alpha, len(gradient) - 2)
        gradient[:-2] = polynomials * (1 - xi) ** (1 - alpha) * (1 + xi) ** alpha
        gradient[-2] = gradient[:-2] @ contact.coefficients
        return gradient

    def solve(self, surface: Array) -> Array:
        """Solve for the change of the contact that compensates an additional surface, shape (modes + 2,)."""
        residual = surface.copy()
        if self.problem.target != "indentation":
            residual[-1] = 0.0
        return lu_solve(self.tangent, -residual)

    @cached_property
    def resistance_gradient(self) -> Array:
        """Return the derivative of the resistance [N/m] with respect to the contact, shape (modes + 2,)."""
        contact, basis, friction = self.contact, self.contact.system.basis, self.problem.friction
        x = contact.half_width * basis.pressure_nodes
        slope, curvature = self.problem.slope(contact.centre + x)
        force, b = contact.scale * contact.half_width, contact.coefficients
        gradient = np.empty(len(b) + 2)
        gradient[:-2] = force * (basis.pressures @ slope)
        gradient[0] += force * friction * basis.unit_load
        gradient[-2] = 2 * contact.resistance + force * b @ (basis.pressures @ (x * curvature))
        gradient[-1] = force * b @ (basis.pressures @ curvature)
        return gradient
