"""A rigid roller on an elastic half-plane, exactly: Hertz without friction, Galin with sliding friction.

Under a roller that slides with the traction f p on the mix along +x the pressure solves

    (1/pi) PV int p(s)/(x - s) ds - f b p(x) = E* x/(2R),    b = (1 - 2 nu)/(2 - 2 nu),

x from the lowest point of the roller. The solution tilts: p ~ (x - trailing)^alpha (leading - x)^(1 - alpha) with
cot(pi alpha) = f b. At f = 0 alpha is 1/2 and all is Hertz. Plane strain, per unit length, pressure positive in
compression; parabola for circle, so the error is of order (length/2R)^2. The depth is undefined on a half-plane.
"""

from dataclasses import dataclass

import numpy as np

from compact.numerics.validation import require_between, require_finite, require_positive


@dataclass(frozen=True)
class LineContact:
    """Where and how hard a roller touches a half-plane; numbers or arrays that broadcast.

    exponent : alpha of (1.4), the power with which pressure rises from the trailing edge [-]
    radius, contact_modulus : R [m], E* = E/(1 - nu^2) [Pa]
    contact_length : l [m]
    load, peak_pressure : P [N/m], p0 [Pa]
    leading, trailing : edges from the lowest point, + ahead: alpha l, -(1 - alpha) l [m]
    centroid : of the pressure, from the lowest point, + ahead: -(2/3)(1 - 2 alpha) l [m]
    """

    exponent: float
    radius: float
    contact_modulus: float
    contact_length: float
    load: float
    peak_pressure: float
    leading: float
    trailing: float
    centroid: float

    @property
    def half_width(self):
        """a = l/2 [m]."""
        return self.contact_length / 2

    def pressure(self, x):
        """p at x [m] from the lowest point, + ahead: p0 (xi/alpha)^alpha ((1 - xi)/(1 - alpha))^(1 - alpha) [Pa].

        xi = (x - trailing)/l; zero outside the contact.
        """
        # leading = alpha l and -trailing = (1 - alpha) l, so the two ratios need no xi and lose no digits
        behind = np.maximum((x - self.trailing) / self.leading, 0.0)
        ahead = np.maximum((x - self.leading) / self.trailing, 0.0)
        return self.peak_pressure * behind**self.exponent * ahead ** (-self.trailing / self.contact_length)


def pressure_exponent(poisson, friction):
    """Pressure exponent alpha [-] of a sliding contact, 0 < alpha < 1.

        alpha = (1/pi) arctan[(2 - 2 nu) / (f (1 - 2 nu))]                                          (1.4)

    Parameters
    ----------
    poisson : nu [-], 0 ... 0.5
    friction : f [-], traction over pressure; f < 0 turns the traction round and gives 1 - alpha(-f)

    Notes
    -----
    Exact for a rigid cylinder sliding on a half-plane; 1/2 at f = 0 and at nu = 1/2. Confidence 97 %.

    References
    ----------
    D, eq (1.4), the monograph of Loveikin and Pochka on cam-driven roller forming; L. A. Galin 1945.

    >>> f"{pressure_exponent(0.3, 0.35):.4f}"
    '0.4683'
    """
    require_between(0, 0.5, poisson=poisson)
    require_finite(friction=friction)
    return np.arctan2(2 - 2 * np.asarray(poisson), friction * (1 - 2 * np.asarray(poisson))) / np.pi


def hertz(
    *, radius, contact_modulus=None, youngs_modulus=None, poisson=None, load=None, half_width=None, peak_pressure=None
):
    """Elastic line contact of a roller on a half-plane without friction, a `LineContact`.

        p(x) = p0 sqrt(1 - (x/a)^2),  a^2 = 4 P R/(pi E*),  p0 = 2 P/(pi a) = E* a/(2R)

    Parameters
    ----------
    radius : R [m], > 0
    contact_modulus : E* = E/(1 - nu^2) [Pa], > 0; or `youngs_modulus` E [Pa], > 0, with `poisson` nu, 0 ... 0.5
    load, half_width, peak_pressure : P [N/m], a [m], p0 [Pa], > 0; exactly one

    Notes
    -----
    Half-plane theory: use while a << R and a << layer height. A bonded layer with nu = 0.3 carries 2.8 % more
    at a = 0.2 of its height, 17 % more at 0.5.

    References
    ----------
    K. L. Johnson, Contact Mechanics, CUP 1985, section 4.2(c).

    >>> c = hertz(load=10e3, radius=0.1, contact_modulus=20e6)
    >>> f"a = {c.half_width * 1e3:.2f} mm, p0 = {c.peak_pressure / 1e3:.0f} kPa"
    'a = 7.98 mm, p0 = 798 kPa'
    """
    E = _contact_modulus(contact_modulus, youngs_modulus, poisson)
    require_positive(radius=radius, contact_modulus=E)
    _refuse_unless_one(load=load, half_width=half_width, peak_pressure=peak_pressure)
    if load is not None:
        a = np.sqrt(4 * np.asarray(load) * radius / (np.pi * E))
    elif half_width is not None:
        a = np.asarray(half_width)
    else:
        a = 2 * radius * np.asarray(peak_pressure) / E
    P = np.pi * E * a**2 / (4 * radius) if load is None else load
    p0 = E * a / (2 * radius) if peak_pressure is None else peak_pressure
    return LineContact(0.5, radius, E, 2 * a, P, p0, leading=a, trailing=-a, centroid=0 * a)


def galin(*, radius, youngs_modulus, poisson, friction, load=None, contact_length=None, peak_pressure=None):
    """Line contact of a roller that slides on a half-plane with the traction f p on the mix, a `LineContact`.

        p(xi) = (E* l sin(pi alpha)/2R) xi^alpha (1 - xi)^(1 - alpha),  xi = (x - trailing)/l
        P = pi alpha (1 - alpha) E* l^2/(4R),  p0 at xi = alpha,  centroid (1 + alpha)/3,  lowest point 1 - alpha

    Parameters
    ----------
    radius : R [m], > 0
    youngs_modulus, poisson : E [Pa], > 0; nu [-], 0 ... 0.5
    friction : f [-], + for a traction on the mix along +x (the roller slides to +x), - for one along -x (driven)
    load, contact_length, peak_pressure : P [N/m], l [m], p0 [Pa], > 0; exactly one

    Notes
    -----
    Half-plane theory: l/2 << R and l/2 << layer height; full slip along the whole contact. Exact within that.

    References
    ----------
    L. A. Galin 1945; N. I. Muskhelishvili, Some Basic Problems of the Mathematical Theory of Elasticity.

    >>> c = galin(radius=0.11, youngs_modulus=0.75e6, poisson=0.3, friction=0.35, load=8368.0)
    >>> f"edges {c.trailing * 1e3:.1f} and {c.leading * 1e3:.1f} mm, p0 = {c.peak_pressure / 1e3:.0f} kPa"
    'edges -40.2 and 35.4 mm, p0 = 141 kPa'
    """
    require_positive(radius=radius)
    E = _contact_modulus(None, youngs_modulus, poisson)
    _refuse_unless_one(load=load, contact_length=contact_length, peak_pressure=peak_pressure)
    require_finite(friction=friction)
    tangent = friction * (1 - 2 * np.asarray(poisson)) / (2 - 2 * np.asarray(poisson))  # f b = cot(pi alpha)
    alpha, rest, tilt = _exponents(tangent)
    load_per_square = np.pi * alpha * rest * E / (4 * radius)
    peak_per_length = E / (2 * radius * np.hypot(1, tangent)) * np.exp(alpha * np.log(alpha) + rest * np.log(rest))
    if load is not None:
        length = np.sqrt(load / load_per_square)
    elif contact_length is not None:
        length = np.asarray(contact_length)
    else:
        length = peak_pressure / peak_per_length
    return LineContact(
        exponent=alpha,
        radius=radius,
        contact_modulus=E,
        contact_length=length,
        load=load_per_square * length**2 if load is None else load,
        peak_pressure=peak_per_length * length if peak_pressure is None else peak_pressure,
        leading=alpha * length,
        trailing=-rest * length,
        centroid=-2 / 3 * tilt * length,
    )


def _exponents(tangent):
    """alpha, 1 - alpha and 1 - 2 alpha of cot(pi alpha) = tangent, each with all its digits."""
    tilt = np.arctan(tangent) / np.pi
    if np.all(np.abs(tangent) < 1):
        return 0.5 - tilt, 0.5 + tilt, 2 * tilt
    # near 0 or 1 the sums above cancel; arctan2 does not, but takes twice the time
    return np.arctan2(1, tangent) / np.pi, np.arctan2(1, -tangent) / np.pi, 2 * tilt


def _contact_modulus(contact_modulus, youngs_modulus, poisson):
    """E* as given, or from E and nu."""
    if (contact_modulus is None) == (youngs_modulus is None) or (youngs_modulus is None) != (poisson is None):
        raise ValueError("give either `contact_modulus`, or `youngs_modulus` with `poisson`")
    if youngs_modulus is None:
        return contact_modulus
    require_positive(youngs_modulus=youngs_modulus)
    require_between(0, 0.5, poisson=poisson)
    return youngs_modulus / (1 - np.square(poisson))


def _refuse_unless_one(**targets):
    given = {name: value for name, value in targets.items() if value is not None}
    if len(given) != 1:
        raise ValueError(
            f"give exactly one of {', '.join(f'`{name}`' for name in targets)}, got {', '.join(given) or 'none'}"
        )
    require_positive(**given)
