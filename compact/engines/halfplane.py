"""Exact contact of a rigid roller with an elastic half-plane: Hertz without friction, Galin with sliding friction.

Under a roller that slides with the traction f p on the mix along +x the pressure satisfies

    (1/pi) PV int p(s)/(x - s) ds - f b p(x) = E* x/(2R),    b = (1 - 2 nu)/(2 - 2 nu),

x from the lowest point of the roller. The solution is unsymmetric, p ~ (x - trailing)^alpha (leading - x)^(1 - alpha),
with cot(pi alpha) = f b; f = 0 gives alpha = 1/2 and Hertz's solution. Plane strain, per unit length, pressure positive
in compression. The circle is replaced by a parabola, with an error of order (length/2R)^2. The indentation of a
half-plane is undefined.

References
----------
K. L. Johnson, Contact Mechanics, CUP 1985, sections 4.2(c) and 8.2; L. A. Galin 1945.
"""

from dataclasses import dataclass

import numpy as np

from compact.numerics import Array
from compact.numerics.validation import require_between, require_finite, require_positive

Values = float | Array


@dataclass(frozen=True)
class LineContact:
    """Line contact of a roller with a half-plane; numbers or arrays that broadcast.

    Parameters
    ----------
    exponent : float or ndarray
        Exponent alpha of (1.4) with which the pressure rises from the trailing edge [-].
    radius, contact_length : float or ndarray
        R and l [m].
    contact_modulus : float or ndarray
        E* = E/(1 - nu^2) [Pa].
    load, peak_pressure : float or ndarray
        P [N/m] and p0 [Pa].
    leading, trailing : float or ndarray
        Edges alpha l and -(1 - alpha) l from the lowest point, positive ahead [m].
    centroid : float or ndarray
        Centroid of the pressure, -(2/3)(1 - 2 alpha) l, from the lowest point, positive ahead [m].
    """

    exponent: Values
    radius: Values
    contact_modulus: Values
    contact_length: Values
    load: Values
    peak_pressure: Values
    leading: Values
    trailing: Values
    centroid: Values

    @property
    def half_width(self) -> Values:
        """Half-width a = l/2 [m]."""
        return self.contact_length / 2

    def pressure(self, x: Values) -> Values:
        """Compute the pressure [Pa] at x [m] ahead of the lowest point, zero outside the contact.

        p = p0 (xi/alpha)^alpha ((1 - xi)/(1 - alpha))^(1 - alpha),  xi = (x - trailing)/l
        """
        # leading = alpha l and -trailing = (1 - alpha) l: the two ratios avoid xi and its cancellation
        behind = np.maximum((x - self.trailing) / self.leading, 0.0)
        ahead = np.maximum((x - self.leading) / self.trailing, 0.0)
        return self.peak_pressure * behind**self.exponent * ahead ** (-self.trailing / self.contact_length)


def pressure_exponent(poisson: Values, friction: Values) -> Values:
    """Compute the pressure exponent of a sliding contact.

        alpha = (1/pi) arctan[(2 - 2 nu) / (f (1 - 2 nu))]                                          (1.4)

    Parameters
    ----------
    poisson : float or ndarray
        Poisson's ratio nu [-], 0 to 0.5.
    friction : float or ndarray
        Traction over pressure f [-]; f < 0 reverses the traction and gives 1 - alpha(-f).

    Returns
    -------
    float or ndarray
        Exponent alpha [-], 0 < alpha < 1.

    Notes
    -----
    Exact for a rigid cylinder sliding on a half-plane; 1/2 at f = 0 and at nu = 1/2. Confidence 97 %.

    References
    ----------
    D, eq (1.4), the monograph of Loveikin and Pochka on cam-driven roller forming; L. A. Galin 1945.

    Examples
    --------
    >>> f"{pressure_exponent(0.3, 0.35):.4f}"
    '0.4683'
    """
    require_between(0, 0.5, poisson=poisson)
    require_finite(friction=friction)
    return np.arctan2(2 - 2 * np.asarray(poisson), friction * (1 - 2 * np.asarray(poisson))) / np.pi


def hertz(
    *,
    radius: Values,
    contact_modulus: Values | None = None,
    youngs_modulus: Values | None = None,
    poisson: Values | None = None,
    load: Values | None = None,
    half_width: Values | None = None,
    peak_pressure: Values | None = None,
) -> LineContact:
    """Compute the elastic line contact of a roller with a half-plane without friction (Hertz).

        p(x) = p0 sqrt(1 - (x/a)^2),  a^2 = 4 P R/(pi E*),  p0 = 2 P/(pi a) = E* a/(2R)

    Parameters
    ----------
    radius : float or ndarray
        R [m], > 0.
    contact_modulus : float or ndarray, optional
        E* = E/(1 - nu^2) [Pa], > 0; or `youngs_modulus` with `poisson`.
    youngs_modulus, poisson : float or ndarray, optional
        E [Pa], > 0, and nu [-], 0 to 0.5.
    load, half_width, peak_pressure : float or ndarray, optional
        P [N/m], a [m] and p0 [Pa], > 0; exactly one.

    Notes
    -----
    Half-plane theory: valid for a << R and a << layer height. A bonded layer with nu = 0.3 carries 2.8 % more at
    a = 0.2 of its height, 17 % more at 0.5.

    References
    ----------
    K. L. Johnson, Contact Mechanics, CUP 1985, section 4.2(c).

    Examples
    --------
    >>> c = hertz(load=10e3, radius=0.1, contact_modulus=20e6)
    >>> f"a = {c.half_width * 1e3:.2f} mm, p0 = {c.peak_pressure / 1e3:.0f} kPa"
    'a = 7.98 mm, p0 = 798 kPa'
    """
    E = _contact_modulus(contact_modulus, youngs_modulus, poisson)
    require_positive(radius=radius, contact_modulus=E)
    _require_one(load=load, half_width=half_width, peak_pressure=peak_pressure)
    length = None if half_width is None else 2 * np.asarray(half_width)
    return _line_contact(radius, E, np.zeros(()), load, length, peak_pressure)


def galin(
    *,
    radius: Values,
    youngs_modulus: Values,
    poisson: Values,
    friction: Values,
    load: Values | None = None,
    contact_length: Values | None = None,
    peak_pressure: Values | None = None,
) -> LineContact:
    """Compute the line contact of a roller sliding on a half-plane with the traction f p on the mix (Galin).

        p(xi) = (E* l sin(pi alpha)/2R) xi^alpha (1 - xi)^(1 - alpha),  xi = (x - trailing)/l
        P = pi alpha (1 - alpha) E* l^2/(4R),  p0 at xi = alpha,  centroid (1 + alpha)/3,  lowest point 1 - alpha

    Parameters
    ----------
    radius : float or ndarray
        R [m], > 0.
    youngs_modulus, poisson : float or ndarray
        E [Pa], > 0, and nu [-], 0 to 0.5.
    friction : float or ndarray
        f [-], positive for a traction on the mix along +x (the roller slides to +x), negative along -x (driven).
    load, contact_length, peak_pressure : float or ndarray, optional
        P [N/m], l [m] and p0 [Pa], > 0; exactly one.

    Notes
    -----
    Half-plane theory: l/2 << R and l/2 << layer height; full slip along the contact. Exact within these limits.

    References
    ----------
    L. A. Galin 1945; N. I. Muskhelishvili, Some Basic Problems of the Mathematical Theory of Elasticity.

    Examples
    --------
    >>> c = galin(radius=0.11, youngs_modulus=0.75e6, poisson=0.3, friction=0.35, load=8368.0)
    >>> f"edges {c.trailing * 1e3:.1f} and {c.leading * 1e3:.1f} mm, p0 = {c.peak_pressure / 1e3:.0f} kPa"
    'edges -40.2 and 35.4 mm, p0 = 141 kPa'
    """
    require_positive(radius=radius)
    E = _contact_modulus(None, youngs_modulus, poisson)
    _require_one(load=load, contact_length=contact_length, peak_pressure=peak_pressure)
    require_finite(friction=friction)
    tangent = friction * (1 - 2 * np.asarray(poisson)) / (2 - 2 * np.asarray(poisson))  # f b
    return _line_contact(radius, E, tangent, load, contact_length, peak_pressure)


def _line_contact(
    radius: Values, E: Values, tangent: Array, load: Values | None, length: Values | None, peak_pressure: Values | None
) -> LineContact:
    """Contact with cot(pi alpha) = `tangent` and one of load, length and peak pressure."""
    tilt = np.arctan(tangent) / np.pi  # 1/2 - alpha
    alpha, rest = np.arctan2(1, tangent) / np.pi, np.arctan2(1, -tangent) / np.pi  # sums with 1/2 would cancel
    load_per_square = np.pi * alpha * rest * E / (4 * radius)
    peak_per_length = E / (2 * radius * np.hypot(1, tangent)) * np.exp(alpha * np.log(alpha) + rest * np.log(rest))
    if load is not None:
        length = np.sqrt(load / load_per_square)
    elif peak_pressure is not None:
        length = peak_pressure / peak_per_length
    length = np.asarray(length)
    load = load_per_square * length**2 if load is None else load
    peak = peak_per_length * length if peak_pressure is None else peak_pressure
    return LineContact(alpha, radius, E, length, load, peak, alpha * length, -rest * length, -4 / 3 * tilt * length)


def _contact_modulus(contact_modulus: Values | None, youngs_modulus: Values | None, poisson: Values | None) -> Values:
    """Return E* as prescribed, or from E and nu."""
    if contact_modulus is not None and youngs_modulus is None and poisson is None:
        return contact_modulus
    if contact_modulus is not None or youngs_modulus is None or poisson is None:
        raise ValueError("either `contact_modulus`, or `youngs_modulus` with `poisson`, must be set")
    require_positive(youngs_modulus=youngs_modulus)
    require_between(0, 0.5, poisson=poisson)
    return youngs_modulus / (1 - np.square(poisson))


def _require_one(**targets: Values | None) -> None:
    prescribed = {name: value for name, value in targets.items() if value is not None}
    if len(prescribed) != 1:
        names = ", ".join(f"`{name}`" for name in targets)
        raise ValueError(f"exactly one of {names} must be set, got {', '.join(prescribed) or 'none'}")
    require_positive(**prescribed)
