"""Slopes of the Drucker-Prager cap from the angles of friction and dilatancy and the earth pressure coefficient.

In plane strain the plastic flow leaves no strain across the plane. With s = sin phi, the Mohr-Coulomb limit is met by

    N = 3 sin psi/sqrt(3 + sin^2 psi),    M = s/[sqrt((1 - N^2/9)/3) + N s/9]

exactly for psi = 0, where M = sqrt(3) s, and psi = phi, where M = N. Confined compression on a cap of slope Mc ends
at the stress ratio eta = q/P, where Mc^2 = eta^2 + 3 eta by associated flow. All stresses are shifted by pt, so that a
coefficient K0 = s_h/s_v belongs to one vertical stress s_v:

    K0' = (K0 s_v + pt)/(s_v + pt),    eta = 3 (1 - K0')/(1 + 2 K0')

Mix in confined compression must flow on the cap, K0' > (3 - M)/(3 + 2 M). The cap must not be flatter than the line,
Mc >= M.

References
----------
D. C. Drucker and W. Prager, Soil mechanics and plastic analysis or limit design, Q. Appl. Math. 10 (1952) 157-165;
J. Jaky, A nyugalmi nyomas tenyezoje, J. Soc. Hungarian Architects and Engineers 78 (1944) 355-358 (K0 = 1 - sin phi).
"""

from typing import Any

import numpy as np

from compact.material.laws import DruckerPragerCap
from compact.numerics.validation import require_between, require_positive


def matched_slopes(friction_angle: float, dilatancy_angle: float = 0.0) -> tuple[float, float]:
    """Return the slopes of the shear line and of its plastic potential.

    Parameters
    ----------
    friction_angle, dilatancy_angle : float
        Angles phi and psi in plane strain [deg], 0 <= psi <= phi < 90, phi > 0.

    Returns
    -------
    M, N : float
        Slopes [-].

    Examples
    --------
    >>> M, N = matched_slopes(35.0, 35.0)
    >>> f"{M:.4f} {N:.4f}"
    '0.9431 0.9431'
    """
    if not 0 < friction_angle < 90:
        raise ValueError(
            f"`friction_angle` must lie between 0 and 90 degrees for a shear line, got {friction_angle!r}; mix without "
            'friction requires the law "ellipse" and its cohesion'
        )
    require_between(0, friction_angle, dilatancy_angle=dilatancy_angle)
    s, t = np.sin(np.radians([friction_angle, dilatancy_angle]))
    N = 3 * t / np.sqrt(3 + t * t)
    return float(s / (np.sqrt((1 - N * N / 9) / 3) + N * s / 9)), float(N)


def cap_slope(earth_pressure_coefficient: float, pressure: float, tensile_strength: float) -> float:
    """Return the slope Mc of the cap.

    Parameters
    ----------
    earth_pressure_coefficient : float
        K0 = s_h/s_v of confined compression [-], 0 < K0 < 1.
    pressure : float
        Vertical stress at which it holds [Pa].
    tensile_strength : float
        Isotropic tensile strength pt [Pa].

    Returns
    -------
    float
        Slope Mc [-].

    Examples
    --------
    >>> f"{cap_slope(0.4264, 200e3, 14281.0):.3f}"
    '1.786'
    """
    require_positive(earth_pressure_coefficient=earth_pressure_coefficient, pressure=pressure)
    shifted = (earth_pressure_coefficient * pressure + tensile_strength) / (pressure + tensile_strength)
    ratio = 3 * (1 - shifted) / (1 + 2 * shifted)
    return float(np.sqrt(ratio * ratio + 3 * ratio))


def earth_pressure_bounds(friction_slope: float, pressure: float, tensile_strength: float) -> tuple[float, float]:
    """Return the earth pressure coefficients between which a cap fits a shear line.

    Parameters
    ----------
    friction_slope : float
        Slope M of the line [-].
    pressure, tensile_strength : float
        As of `cap_slope`.

    Returns
    -------
    low, high : float
        K0 at which mix in confined compression slides on the line too, and K0 at which Mc = M [-].
    """
    flattest = (-3 + np.sqrt(9 + 4 * friction_slope**2)) / 2
    shift = tensile_strength / pressure
    low, high = ((3 - ratio) / (3 + 2 * ratio) * (1 + shift) - shift for ratio in (friction_slope, flattest))
    return float(low), float(high)


def drucker_prager_slopes(
    friction_angle: float, cohesion: float, earth_pressure_coefficient: float, pressure: float, dilatancy_angle: float
) -> dict[str, Any]:
    """Return slopes and tensile strength of a cap with a shear line, by the names of `DruckerPragerCap`.

    Parameters
    ----------
    friction_angle, dilatancy_angle : float
        Angles in plane strain [deg].
    cohesion : float
        Cohesion [Pa].
    earth_pressure_coefficient : float
        K0 of confined compression [-].
    pressure : float
        Vertical stress at which K0 holds [Pa].

    Raises
    ------
    ValueError
        If no cap has the coefficient; the message names the bounds.
    """
    require_positive(pressure=pressure)
    M, N = matched_slopes(friction_angle, dilatancy_angle)
    strength = float(cohesion / np.tan(np.radians(friction_angle)))
    low, high = earth_pressure_bounds(M, pressure, strength)
    if not low < earth_pressure_coefficient <= high:
        raise ValueError(
            f"`earth_pressure_coefficient` must be between {low:.4f} and {high:.4f} for a friction angle of "
            f"{friction_angle:g} degrees and a cohesion of {cohesion / 1e3:g} kPa at {pressure / 1e3:.4g} kPa, got "
            f"{earth_pressure_coefficient:.4f}: below, confined mix would slide along the shear line; above, the cap "
            "would be flatter than the line; change the coefficient, `friction_angle` or the cohesion"
        )
    slope = cap_slope(earth_pressure_coefficient, pressure, strength)
    return {"critical_slope": slope, "tensile_strength": strength, "friction_slope": M, "dilatancy_slope": N}


def drucker_prager_cap(
    *,
    friction_angle: float,
    cohesion: float,
    earth_pressure_coefficient: float,
    pressure: float,
    dilatancy_angle: float = 0.0,
    **others: Any,
) -> DruckerPragerCap:
    """Return the law of angles, cohesion and earth pressure whose confined compression follows a Heckel curve.

    Parameters
    ----------
    friction_angle, cohesion, earth_pressure_coefficient, pressure, dilatancy_angle : float
        As of `drucker_prager_slopes`.
    **others
        Further parameters of `DruckerPragerCap`; `heckel_slope` is that of confined compression.
    """
    slopes = drucker_prager_slopes(friction_angle, cohesion, earth_pressure_coefficient, pressure, dilatancy_angle)
    return DruckerPragerCap(heckel_test="confined", **slopes, **others)
