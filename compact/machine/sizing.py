"""Size of a roller machine by the engineering method: eqs (1.1)-(1.3), (1.9) and (1.10).

D is the monograph of Loveikin and Pochka on cam-driven roller forming. The available print lacks the operators of
(1.2), (1.3) and (1.9); the formulas below are a reconstruction that uses every printed digit. The notes state the
confidence in each. All formulas broadcast over arrays.

References
----------
V. S. Loveikin and K. I. Pochka, monograph on roller forming machines (D), eqs (1.1)-(1.3), (1.9), (1.10).
"""

from dataclasses import dataclass

import numpy as np

from compact.numerics import Array, IntArray, validation

COUNT_ROUNDING = 1e-9  # [-], relative distance of a quotient from a whole number of rollers that is rounding
RADIUS_RATIOS = (0.40, 0.55)  # [-], roller radius over product height, smallest and largest of (1.1)

Values = float | Array


@dataclass(frozen=True)
class RadiusRange:
    """Range of the roller radius.

    Parameters
    ----------
    low, high : float or ndarray
        Ends of the range of the smallest suitable radius [m].
    """

    low: Values
    high: Values


def radius_range(height: Values) -> RadiusRange:
    """Compute the range of the smallest suitable roller radius [m].

        R = (0.40 ... 0.55) h0                                                                      (1.1)

    Parameters
    ----------
    height : float or ndarray
        Height h0 of the product [m], > 0.

    Notes
    -----
    A design rule, not mechanics. Confidence: printed.

    Examples
    --------
    >>> bounds = radius_range(0.22)
    >>> f"{bounds.low:.3f} to {bounds.high:.3f} m"
    '0.088 to 0.121 m'
    """
    validation.require_positive(height=height)
    low, high = RADIUS_RATIOS
    return RadiusRange(low=low * np.asarray(height), high=high * np.asarray(height))


def rollers_needed(width: Values, radius: Values, feeder_sleeve: Values, overlap: Values) -> IntArray:
    """Compute the number of rollers that cover a product.

        n = B / (2R + B_T - b_n), rounded up                                                        (1.2)

    Parameters
    ----------
    width : float or ndarray
        B of the product along the travel [m], > 0.
    radius : float or ndarray
        R [m], > 0.
    feeder_sleeve : float or ndarray
        Width B_T of the sleeve of the feeder [m], >= 0.
    overlap : float or ndarray
        Overlap b_n of neighbouring fields [m], >= 0 and < 2R + B_T.

    Notes
    -----
    A quotient within 1e-9 of a whole number is that number. Confidence 80 %: with b_n 0.012 and B_T 0.18 the number,
    (1.3) and the stroke 0.4 m agree exactly.

    Examples
    --------
    >>> int(rollers_needed(1.164, 0.11, 0.18, 0.012))
    3
    """
    validation.require_positive(width=width, radius=radius)
    validation.require_nonnegative(feeder_sleeve=feeder_sleeve, overlap=overlap)
    field = 2 * np.asarray(radius) + feeder_sleeve - overlap
    validation.require_that(
        field > 0, field, "`overlap` must be less than 2 `radius` + `feeder_sleeve`, which leaves a field of"
    )
    return np.ceil(width / field * (1 - COUNT_ROUNDING)).astype(int)


def stroke_needed(width: Values, rollers: Values, overlap: Values) -> Values:
    """Compute the stroke [m] for which the rollers cover a product.

        s = B/n + b_n                                                                               (1.3)

    Parameters
    ----------
    width : float or ndarray
        B of the product along the travel [m], > 0.
    rollers : int or ndarray
        Number n, a whole number >= 1.
    overlap : float or ndarray
        Overlap b_n of neighbouring fields [m], >= 0 and < B/n.

    Notes
    -----
    Confidence 80 %.

    Examples
    --------
    >>> f"{stroke_needed(1.164, 3, 0.012):.3f} m"
    '0.400 m'
    """
    validation.require_positive(width=width)
    validation.require_nonnegative(overlap=overlap)
    validation.require_integers(rollers=rollers)
    field = width / np.asarray(rollers)
    validation.require_that(
        overlap < field, overlap - field, "`overlap` must be less than the field `width`/`rollers`, exceeds by"
    )
    return field + overlap


def guide_coefficient(
    *,
    bearing_friction: Values,
    journal_diameter: Values,
    rolling_arm: Values,
    wheel_diameter: Values,
    rib_factor: Values,
) -> Values:
    """Compute the friction force of the guide wheels over their load [-], as in (1.9).

        mu = (f3 d + 2 f4)/D f5

    Parameters
    ----------
    bearing_friction : float or ndarray
        Friction f3 of bush on journal [-], >= 0.
    journal_diameter, wheel_diameter : float or ndarray
        Diameters d and D of the guide wheels [m], > 0.
    rolling_arm : float or ndarray
        Lever arm f4 of rolling friction of the guide wheels [m], >= 0.
    rib_factor : float or ndarray
        Factor f5 of the friction of the wheel's rib [-], >= 0.

    Examples
    --------
    >>> wheels = {"journal_diameter": 0.02, "rolling_arm": 5e-4, "wheel_diameter": 0.046}
    >>> f"{guide_coefficient(bearing_friction=0.05, rib_factor=1.5, **wheels):.4f}"
    '0.0652'
    """
    validation.require_nonnegative(bearing_friction=bearing_friction, rolling_arm=rolling_arm, rib_factor=rib_factor)
    validation.require_positive(journal_diameter=journal_diameter, wheel_diameter=wheel_diameter)
    arm = bearing_friction * np.asarray(journal_diameter) + 2 * np.asarray(rolling_arm)
    return arm / wheel_diameter * rib_factor


def cart_resistance(
    force: Values, roller_resistance: Values, rollers: Values, weight: Values, **wheels: Values
) -> Values:
    """Compute the force [N] that moves a cart with its rollers at constant speed.

        F_B = |n F - G| mu + n F_p                                                                  (1.9)

    Parameters
    ----------
    force, roller_resistance : float or ndarray
        F of (1.6) and F_p of (1.8), of one roller [N], >= 0.
    rollers : int or ndarray
        Number n, a whole number >= 1.
    weight : float or ndarray
        Weight G of the cart [N], >= 0.
    **wheels : float or ndarray
        Parameters of `guide_coefficient`, which gives mu.

    Notes
    -----
    Confidence 60 %: the print has a second d of unknown meaning.

    Examples
    --------
    >>> wheels = {"journal_diameter": 0.02, "rolling_arm": 5e-4, "wheel_diameter": 0.046}
    >>> f"{cart_resistance(17721.0, 3358.0, 2, 1e4, bearing_friction=0.05, rib_factor=1.5, **wheels):.0f} N"
    '8375 N'
    """
    validation.require_nonnegative(force=force, roller_resistance=roller_resistance, weight=weight)
    validation.require_integers(rollers=rollers)
    guides = np.abs(rollers * np.asarray(force) - weight) * guide_coefficient(**wheels)
    return guides + rollers * np.asarray(roller_resistance)


def cart_power(resistance: Values, velocity: Values) -> Values:
    """Compute the power [W] that moves a cart at constant speed, without inertia.

        N = F_B V                                                                                   (1.10)

    Parameters
    ----------
    resistance : float or ndarray
        F_B of (1.9) [N].
    velocity : float or ndarray
        V [m/s].

    Notes
    -----
    Confidence: printed.

    Examples
    --------
    >>> f"{cart_power(8375.0, 0.16):.0f} W"
    '1340 W'
    """
    validation.require_finite(resistance=resistance, velocity=velocity)
    return np.multiply(resistance, velocity)
