"""Engine "spectral": steady rolling on a linear layer of plies over a rigid base, by a Galerkin method.

Plane strain, elastic or viscoelastic layer, bonded or frictionless base. The roller is frictionless or in full slip
with the traction f p. `rolling_problem` solves the contact with a given number of modes; the number is raised until the
estimated errors are below the tolerance. The error estimate compares with the next number of modes, at the same target.
It adds the boundary layers of branches that are too fast for either.

Limits: small strains, no inertia, no stick.

References
----------
K. L. Johnson, Contact Mechanics, CUP 1985, sections 2.7, 5.8; S. C. Hunter, J. Appl. Mech. 28 (1961) 611.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from compact.engines.spectral.galerkin_system import assemble_system, power_spectrum
from compact.engines.spectral.rolling_problem import (
    HALF_WIDTH_STEP,
    ModeRefinement,
    build_rolling_problem,
    describe_history,
    solve_contact,
    solve_pressure,
)
from compact.material.laws import Elastic
from compact.numerics.validation import require_positive
from compact.rolling_contact import (
    ContactResult,
    Layer,
    Roller,
    require_known_case,
    require_on_target,
    resistance_scale,
)

MODE_COUNTS = (
    16,
    24,
    36,
    54,
    80,
    120,
    180,
    270,
    405,
    610,
)  # [-], modes tried in turn; the error is estimated from the next
SPECTRAL_RTOL = 1e-5  # [-], default tolerance of load and resistance, a tenth of that of the peak pressure
SPECTRAL_RTOL_MAX = 1e-3  # [-], error with the most modes above which the contact is not returned
TARGET_RTOL = 1e-9  # [-], residual of the prescribed quantity that is guaranteed
ARITHMETIC_ERROR = 1e-13  # [-], relative error by rounding, over the instantaneous share of the compliance
MODE_ERROR_FACTOR = 2.0  # [-], error over the change to the next number of modes
PEAK_ERROR_RATIO = 10  # [-], tolerance of the peak pressure over that of the load
SPECTRUM_LIMIT = 100.0  # [-], wave number times half-width from which the spectrum is a power law
PRESSURE_SAMPLES = 201  # [-], points along the contact, denser at its edges


@dataclass(frozen=True, kw_only=True)
class SpectralContactResult(ContactResult):
    """`ContactResult` with the numerical effort.

    Parameters
    ----------
    indentation : float
        Indentation delta [m].
    modes : int
        Number of pressure polynomials.
    history : tuple of ModeRefinement
        Solutions with each number of modes.
    """

    indentation: float
    modes: int
    history: tuple[ModeRefinement, ...]


def roll(
    layer: Layer, roller: Roller, material: Elastic, speed: float, *, rtol: float = SPECTRAL_RTOL
) -> SpectralContactResult:
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
    SpectralContactResult
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
    >>> mix = Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),))
    >>> rolled = roll(Layer(0.22), Roller(0.11, indentation=0.003), mix, speed=0.3)
    >>> f"load {rolled.load:.1f} N/m, resistance {rolled.resistance:.2f} N/m"
    'load 20455.8 N/m, resistance 392.89 N/m'
    """
    require_spectral_range(layer, roller, material, speed)
    require_positive(rtol=rtol)
    problem, half_width = build_rolling_problem(layer, roller, material, speed)
    with threadpool_limits(1):  # the matrices are too small for threads
        contact, history = _refine_modes(problem, half_width, rtol, np.sign(speed))
        rolled = _build_result(problem, contact, history, np.sign(speed))
    require_on_target(rolled, roller, TARGET_RTOL)
    return rolled


def _refine_modes(problem, half_width, rtol, direction):
    """Solve with increasing numbers of modes until the errors are below `rtol`; return the contact and the history."""
    history = []
    for modes, next_modes in pairwise(MODE_COUNTS):
        contact = solve_contact(problem, modes, half_width, history)
        half_width, (*error, peak_error) = contact.half_width, _estimate_errors(problem, contact, next_modes)
        history.append(ModeRefinement(modes, half_width, contact.load, direction * contact.resistance, tuple(error)))
        largest = max(*error, peak_error / PEAK_ERROR_RATIO)
        if largest <= rtol:
            break
    if not largest <= max(rtol, SPECTRAL_RTOL_MAX):
        raise RuntimeError(
            f"{modes} modes reach a relative error of {max(error):.1g}, allowed is {max(rtol, SPECTRAL_RTOL_MAX):.1g}; "
            f"{describe_history(history)}"
        )
    return contact, history


def _estimate_errors(problem, contact, next_modes):
    """Estimated relative errors of load, resistance and peak pressure.

    The solution with more modes, at the same half-width, has a residual in the target; so has, by a little, the
    contact. Both are extrapolated along the half-width to the target. A prescribed load is exact: its error is that at
    the indentation found.
    """
    modes, a = len(contact.coefficients), contact.half_width
    wider = solve_pressure(problem, assemble_system(problem.response, modes, a * (1 + HALF_WIDTH_STEP)), modes)
    finer = solve_pressure(problem, assemble_system(problem.response, next_modes, a), next_modes)
    names = ("load", "resistance", "peak_pressure", "indentation")
    of_contact, of_wider, of_finer = (np.array([getattr(c, name) for name in names]) for c in (contact, wider, finer))

    def change(target: str, value: float) -> NDArray[np.float64]:
        k = names.index(target)
        derivative = (of_wider - of_contact) / (of_wider[k] - of_contact[k])
        return of_finer - of_contact - derivative * (of_finer[k] - value)

    at_depth = ("indentation", contact.indentation) if problem.target == "load" else (problem.target, problem.value)
    changes = np.array([change(*at_depth)[0], *change(problem.target, problem.value)[1:3]])
    scale = np.array([contact.load, resistance_scale(contact.resistance, contact.load), contact.peak_pressure])
    load_error = contact.load * (
        _fast_branch_error(problem, contact) + ARITHMETIC_ERROR / problem.response.creep.instant
    )
    resistance_share = max(abs(problem.response.friction), 2 * a / problem.radius)
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
    creep, modes = problem.response.creep, len(contact.coefficients)
    shares = creep.shares / (creep.instant + np.cumsum(creep.shares))
    y = (1 - shares) * creep.lengths / contact.half_width
    return float(np.sum(0.5 * modes * (shares / (1 - shares)) ** 2 * y**3 * np.exp(-(modes**2) * y)))


def _build_result(problem, contact, history, direction):
    """Express the contact in the fixed axis x."""
    xi = -np.cos(np.linspace(0, np.pi, PRESSURE_SAMPLES))
    pressure = contact.pressure(xi)
    ascending = slice(None, None, int(direction))
    return SpectralContactResult(
        load=float(contact.load),
        resistance=float(direction * contact.resistance),
        leading=float(contact.centre + contact.half_width),
        trailing=float(contact.centre - contact.half_width),
        x=(direction * (contact.centre + contact.half_width * xi))[ascending],
        pressure=pressure[ascending],
        shear_traction=(direction * problem.response.friction * pressure)[ascending],
        error=history[-1].error,
        work_residual=_work_residual(problem, contact),
        indentation=float(contact.indentation),
        peak_pressure=float(contact.peak_pressure),
        modes=history[-1].modes,
        history=tuple(history),
    )


def _work_residual(problem, contact):
    """Energy-balance residual over the larger of the resistance and 1e-3 of the load; theory.md 3.1.

        int p gap' dx = (2/pi E*) int_0^inf (L Im C - f M Re C) |p|^2 dk

    The right side is the work of p dissipated in the layer, from the Fourier transform of p and the complex compliance:
    it uses none of the closed forms from which the pressure is computed. The work of f p on slip and on the stretching
    of the surface is equal on both sides and left out. Beyond SPECTRUM_LIMIT |p|^2 is a power law.
    """
    response, basis, a = problem.response, contact.system.basis, contact.half_width
    tau, weight, squared = power_spectrum(basis, contact.coefficients, SPECTRUM_LIMIT)
    tail = np.geomspace(SPECTRUM_LIMIT, 1e9 * SPECTRUM_LIMIT, 2001)
    power = 2 + 2 * min(basis.trailing_exponent, 1 - basis.trailing_exponent)
    level = np.average(squared * tau**power, weights=weight * (tau > SPECTRUM_LIMIT / 2))
    dissipated = np.sum(weight * response.dissipation_symbol(tau / a) * squared)
    dissipated += np.trapezoid(response.dissipation_symbol(tail / a) * level * tail ** (1 - power), np.log(tail))
    dissipated *= 2 * a * contact.scale**2 / (np.pi * problem.contact_modulus)
    work = contact.resistance - response.friction * contact.load
    return float(abs(work - dissipated) / resistance_scale(contact.resistance, contact.load))


def require_spectral_range(layer: Layer, roller: Roller, material: Elastic, speed: float) -> None:
    """Require a contact in the range of the engine.

    Parameters
    ----------
    layer : Layer
        Layer.
    roller : Roller
        Roller.
    material : Elastic
        Constitutive law.
    speed : float
        Speed of the roller [m/s].

    Raises
    ------
    ValueError
        If the contact is outside the range.
    """
    require_known_case(layer, roller, speed)
    if roller.profile == "deformed":
        raise ValueError("the engine spectral needs `profile` 'parabola' or 'circle', got 'deformed'; use fem")
    if roller.rolling == "free" and roller.friction > 0:
        raise ValueError(
            f"the engine spectral covers full slip only, got `rolling` 'free' with `friction` {roller.friction!r}; use "
            "fem"
        )
    if not isinstance(material, Elastic):
        raise ValueError(
            f"the engine spectral needs a `material` Elastic or Viscoelastic, got {type(material).__name__}; use fem"
        )
