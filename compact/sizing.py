"""How big a machine must be: roller radius, number of rollers and stroke, eqs (1.1)-(1.3) of the monograph D."""

from dataclasses import dataclass

import numpy as np

from compact.refuse import refuse_fractional, refuse_negative, refuse_nonpositive, refuse_unless

ROUNDING = 1e-9  # share by which a quotient may miss a whole number of rollers and still be that number


@dataclass(frozen=True)
class RadiusRange:
    """`low` and `high` end of the smallest sound roller radius [m]."""

    low: float
    high: float


def radius_range(height):
    """Smallest sound roller radius, a `RadiusRange`.

        R = (0.40 ... 0.55) h0                                                                      (1.1)

    Parameters
    ----------
    height : h0, height of the product [m], > 0

    Notes
    -----
    A design rule, not mechanics. Confidence: printed.

    References
    ----------
    D, eq (1.1).

    >>> bounds = radius_range(0.22)
    >>> f"{bounds.low:.3f} to {bounds.high:.3f} m"
    '0.088 to 0.121 m'
    """
    refuse_nonpositive(height=height)
    return RadiusRange(low=0.40 * np.asarray(height), high=0.55 * np.asarray(height))


def rollers_needed(width, radius, feeder_sleeve, overlap):
    """Rollers needed to cover a product, whole numbers.

        n = B / (2R + B_T - b_n), rounded up                                                        (1.2)

    Parameters
    ----------
    width : B, of the product along the travel [m], > 0
    radius : R [m], > 0
    feeder_sleeve : B_T, width of the feeder's sleeve [m], >= 0
    overlap : b_n, of neighbouring fields [m], >= 0 and < 2R + B_T

    Notes
    -----
    A quotient within 1e-9 of a whole number is that number. Confidence 80 %: with b_n 0.012 and B_T 0.18 it fits
    n, (1.3) and the stroke 0.4 m exactly.

    References
    ----------
    D, eq (1.2).

    >>> int(rollers_needed(1.164, 0.11, 0.18, 0.012))
    3
    """
    refuse_nonpositive(width=width, radius=radius)
    refuse_negative(feeder_sleeve=feeder_sleeve, overlap=overlap)
    field = 2 * np.asarray(radius) + feeder_sleeve - overlap
    refuse_unless(field > 0, field, "`overlap` must be less than 2 `radius` + `feeder_sleeve`, which leaves a field of")
    return np.ceil(width / field * (1 - ROUNDING)).astype(int)


def stroke_needed(width, rollers, overlap):
    """Stroke s [m] that lets the rollers cover a product.

        s = B/n + b_n                                                                               (1.3)

    Parameters
    ----------
    width : B, of the product along the travel [m], > 0
    rollers : n, whole number >= 1
    overlap : b_n, of neighbouring fields [m], >= 0 and < B/n

    Notes
    -----
    Confidence 80 %.

    References
    ----------
    D, eq (1.3).

    >>> f"{stroke_needed(1.164, 3, 0.012):.3f} m"
    '0.400 m'
    """
    refuse_nonpositive(width=width)
    refuse_negative(overlap=overlap)
    refuse_fractional(rollers=rollers)
    field = width / np.asarray(rollers)
    refuse_unless(
        overlap < field, overlap - field, "`overlap` must be less than the field `width`/`rollers`, exceeds by"
    )
    return field + overlap
