"""Loads of a roller by formula: the engineering method (1.1)-(1.10) and the engine "formula".

D is the monograph of Loveikin and Pochka on cam-driven roller forming. The print we work from lost the operators of
(1.2)-(1.9); what stands here is a reconstruction that uses every printed digit and is held against exact contact
theory, and each card tells our confidence in it. Every formula broadcasts over arrays.

In (1.5) and (1.6) E is a secant modulus of the contact, neither the unloading nor the plastic one. The two fix only
q^2/E' together: no calibration should rest on either alone.

How big a machine must be: roller radius, number of rollers and stroke, eqs (1.1)-(1.3) of the monograph D.
"""

import warnings
from dataclasses import dataclass
from typing import get_args

import numpy as np

from compact.engines.halfplane import LineContact, galin, hertz, pressure_exponent
from compact.numerics.validation import (
    require_between,
    require_finite,
    require_integers,
    require_known,
    require_nonnegative,
    require_positive,
    require_that,
)
from compact.rolling_contact import ContactResult, RollerCondition, require_on_target

__all__ = [
    "DryResistance",
    "FormulaContactResult",
    "LineContact",
    "RadiusRange",
    "capture_angle",
    "cart_power",
    "cart_resistance",
    "contact_length",
    "dry_resistance",
    "galin",
    "guide_coefficient",
    "hertz",
    "pressure_exponent",
    "pressure_for_load",
    "radius_range",
    "roll",
    "roller_force",
    "roller_resistance",
    "rollers_needed",
    "stroke_needed",
]

TARGET = 1e-9  # [-], relative tolerance within which the prescribed load or pressure is met
SAMPLES = 201  # points along the contact, crowded to its edges where the pressure is steep
HALF_PLANE = 0.5  # half-width over height where a bonded layer (nu = 0.3) carries 17 % more than the half-plane


@dataclass(frozen=True)
class DryResistance:
    """Dry friction as a resistance: `force` F >= 0 [N] against the motion, whatever its speed.

    At velocity 0 it is set-valued, anything in [-force, force]; the call returns the middle, 0, and a drive that
    lets the cart stick reads the limit from `force`.
    """

    force: float

    def __post_init__(self):
        require_nonnegative(force=self.force)

    def __call__(self, velocity, acceleration):
        """F sign(velocity) [N], of the common shape of velocity [m/s] and acceleration [m/s2]."""
        velocity, _ = np.broadcast_arrays(velocity, acceleration)
        return self.force * np.sign(velocity)


@dataclass(frozen=True, kw_only=True)
class FormulaContactResult(ContactResult):
    """A `ContactResult` by the formulas (1.4)-(1.8): load (1.6), resistance (1.8), edges by (1.5) and (1.7).

    capture_angle, exponent : phi of (1.5) [rad], alpha of (1.4) [-]
    contact_length : l of (1.7) [m]
    mean_pressure : load / contact_length [Pa]

    The pressure has the exponent of (1.4) and the prescribed peak between the edges. Its integral is not exactly the
    load (1.6): the two are 6 % apart at the published machine. Exact contact theory is `galin`.
    """

    capture_angle: float
    exponent: float
    contact_length: float
    mean_pressure: float


def capture_angle(pressure, youngs_modulus, poisson, exponent):
    """Capture angle phi [rad], from the lowest point to where the mix is first touched.

        sin phi = 7.53 (1 - nu^2) alpha^(1 - alpha) (1 - alpha)^(1 + alpha) q/E                     (1.5)

    Parameters
    ----------
    pressure : q, peak contact pressure that presses the mix to its density [Pa], > 0
    youngs_modulus : E, secant modulus of the contact [Pa], > 0
    poisson : nu [-], 0 ... 0.5
    exponent : alpha of (1.4) [-], 0 < alpha < 1

    Notes
    -----
    Confidence 80 %. At alpha = 1/2 it is 5.9 % below Hertz, sin phi = 2 q/E*. Use near 1/2: far from it exact theory
    has 2/sin(pi alpha) where this has 7.53 alpha (1 - alpha). Refused where sin phi would exceed 1.

    References
    ----------
    D, eq (1.5).

    >>> f"{np.degrees(capture_angle(0.203e6, 0.75e6, 0.3, 0.4683)):.2f} deg"
    '29.35 deg'
    """
    require_positive(pressure=pressure, youngs_modulus=youngs_modulus)
    require_between(0, 0.5, poisson=poisson)
    _refuse_unless_exponent(exponent)
    alpha, E = np.asarray(exponent), np.asarray(youngs_modulus)
    shape = np.exp((1 - alpha) * np.log(alpha) + (1 + alpha) * np.log1p(-alpha))
    sine = 7.53 * (1 - np.square(poisson)) * shape * (pressure / E)
    require_that(sine <= 1, sine, "no capture angle; lower `pressure` or raise `youngs_modulus`: sin phi would be")
    return np.arcsin(sine)


def roller_force(capture_angle, youngs_modulus, poisson, exponent, radius, length, nonuniformity=1.0, one_sided=False):
    """Normal force F [N] that holds one roller at its height.

        F = k2 L E R sin^2(phi) / [20.32 (1 - nu^2) alpha (1 - alpha)^3]                            (1.6)

    Parameters
    ----------
    capture_angle : phi of (1.5) [rad], 0 < phi <= pi/2
    youngs_modulus, poisson : E, secant [Pa], > 0; nu [-], 0 ... 0.5
    exponent : alpha of (1.4) [-], 0 < alpha < 1
    radius, length : R, L of the roller [m], > 0
    nonuniformity : k2, of the pressure along the roller [-], > 0
    one_sided : the rival reading without alpha in the denominator, contact on the front half only: about half of F

    Notes
    -----
    Confidence 65 %; calibrate nothing on the factor 2 of the rival. At alpha = 1/2 it is 0.26 % above Hertz.

    References
    ----------
    D, eq (1.6).

    >>> f"{roller_force(0.5122, 0.75e6, 0.3, 0.4683, 0.11, 1.164):.0f} N"
    '17721 N'
    """
    require_positive(youngs_modulus=youngs_modulus, radius=radius, length=length, nonuniformity=nonuniformity)
    require_between(0, 0.5, poisson=poisson)
    _refuse_unless_angle(capture_angle)
    _refuse_unless_exponent(exponent)
    alpha = np.asarray(exponent)
    rest = 1 - alpha
    below = 20.32 * (1 - np.square(poisson)) * (rest * rest * rest) * (1 if one_sided else alpha)
    return nonuniformity * length * np.asarray(youngs_modulus) * radius * np.square(np.sin(capture_angle)) / below


def pressure_for_load(force, youngs_modulus, poisson, exponent, radius, length, nonuniformity=1.0, one_sided=False):
    """Peak pressure q [Pa] at which one roller carries a normal force.

        F ~ sin^2(phi) ~ q^2                                                                  (1.5), (1.6)

    Parameters
    ----------
    force : F of (1.6) [N], > 0
    youngs_modulus, poisson, exponent, radius, length, nonuniformity, one_sided : as of `roller_force`

    >>> f"{pressure_for_load(17721.0, 0.75e6, 0.3, 0.4683, 0.11, 1.164) / 1e3:.1f} kPa"
    '203.0 kPa'
    """
    require_positive(force=force, youngs_modulus=youngs_modulus)
    trial = 1e-3 * np.asarray(youngs_modulus)  # a pressure that has a capture angle
    angle = capture_angle(trial, youngs_modulus, poisson, exponent)
    carried = roller_force(angle, youngs_modulus, poisson, exponent, radius, length, nonuniformity, one_sided)
    return trial * np.sqrt(force / carried)


def contact_length(capture_angle, radius, exponent):
    """Contact length l [m], the long side of the contact in front.

        l = R sin(phi)/(1 - alpha)                                                                  (1.7)

    Parameters
    ----------
    capture_angle : phi of (1.5) [rad], 0 < phi <= pi/2
    radius : R [m], > 0
    exponent : alpha of (1.4) [-], 0 < alpha < 1

    Notes
    -----
    Exact for a half-plane with the traction on the mix backwards (a driven roller). Confidence 95 %.

    References
    ----------
    D, eq (1.7).

    >>> f"{contact_length(0.5122, 0.11, 0.4683) * 1e3:.1f} mm"
    '101.4 mm'
    """
    _refuse_unless_angle(capture_angle)
    require_positive(radius=radius)
    _refuse_unless_exponent(exponent)
    return radius * np.sin(capture_angle) / (1 - np.asarray(exponent))


def roller_resistance(force, contact_length, radius, exponent, friction):
    """Force F_p [N] to move one roller.

        F_p = (F/R) [l (1 - 2 alpha)/3 + (f2 + f3) R]                                               (1.8)

    Parameters
    ----------
    force : F of (1.6) [N], >= 0
    contact_length, radius : l of (1.7), R [m], > 0
    exponent : alpha of (1.4) [-], 0 < alpha < 1
    friction : f2 + f3 [-], >= 0; f3 of bush on journal, f2 without a legend in the print

    Notes
    -----
    Confidence 60 %. The arm l (1 - 2 alpha)/3 is the distance of the resultant from the pressure peak; about the
    lowest point exact theory has twice that.

    References
    ----------
    D, eq (1.8).

    >>> f"{roller_resistance(17721.0, 0.1014, 0.11, 0.4683, 0.17):.0f} N"
    '3358 N'
    """
    require_nonnegative(force=force, friction=friction)
    require_positive(contact_length=contact_length, radius=radius)
    _refuse_unless_exponent(exponent)
    arm = np.asarray(contact_length) * (1 - 2 * np.asarray(exponent)) / 3
    return np.asarray(force) * (arm / radius + friction)


def cart_resistance(
    force,
    roller_resistance,
    rollers,
    weight,
    *,
    bearing_friction,
    journal_diameter,
    rolling_arm,
    wheel_diameter,
    rib_factor,
):
    """Force F_B [N] to move a cart with its rollers.

        F_B = |n F - G| (f3 d + 2 f4)/D f5 + n F_p                                                  (1.9)

    Parameters
    ----------
    force, roller_resistance : F of (1.6), F_p of (1.8), of one roller [N], >= 0
    rollers : n, whole number >= 1
    weight : G of the cart [N], >= 0
    bearing_friction : f3, bush on journal [-], >= 0
    journal_diameter, wheel_diameter : d, D of the guide wheels [m], > 0
    rolling_arm : f4, of the guide wheels [m], >= 0
    rib_factor : f5, friction of the wheel's rib [-], >= 0

    Notes
    -----
    Confidence 60 %: the print has a second d that we cannot place.

    References
    ----------
    D, eq (1.9).

    >>> wheels = {"journal_diameter": 0.02, "rolling_arm": 5e-4, "wheel_diameter": 0.046}
    >>> f"{cart_resistance(17721.0, 3358.0, 2, 1e4, bearing_friction=0.05, rib_factor=1.5, **wheels):.0f} N"
    '8375 N'
    """
    require_nonnegative(force=force, roller_resistance=roller_resistance, weight=weight)
    require_integers(rollers=rollers)
    coefficient = guide_coefficient(
        bearing_friction=bearing_friction, journal_diameter=journal_diameter, rolling_arm=rolling_arm,
        wheel_diameter=wheel_diameter, rib_factor=rib_factor,
    )  # fmt: skip
    guide = np.abs(rollers * np.asarray(force) - weight) * coefficient
    return guide + rollers * np.asarray(roller_resistance)


def guide_coefficient(*, bearing_friction, journal_diameter, rolling_arm, wheel_diameter, rib_factor):
    """Friction force of the guide wheels over the load on them [-], as eq 1.9 has it.

        mu = (f3 d + 2 f4)/D f5

    Parameters
    ----------
    bearing_friction : f3, bush on journal [-], >= 0
    journal_diameter, wheel_diameter : d, D of the guide wheels [m], > 0
    rolling_arm : f4, of the guide wheels [m], >= 0
    rib_factor : f5, friction of the wheel's rib [-], >= 0

    References
    ----------
    D, eq (1.9).

    >>> wheels = {"journal_diameter": 0.02, "rolling_arm": 5e-4, "wheel_diameter": 0.046}
    >>> f"{guide_coefficient(bearing_friction=0.05, rib_factor=1.5, **wheels):.4f}"
    '0.0652'
    """
    require_nonnegative(bearing_friction=bearing_friction, rolling_arm=rolling_arm, rib_factor=rib_factor)
    require_positive(journal_diameter=journal_diameter, wheel_diameter=wheel_diameter)
    arm = bearing_friction * np.asarray(journal_diameter) + 2 * np.asarray(rolling_arm)
    return arm / wheel_diameter * rib_factor


def cart_power(resistance, velocity):
    """Power N [W] that moves a cart at constant speed.

        N = F_B V                                                                                   (1.10)

    Parameters
    ----------
    resistance : F_B of (1.9) [N]
    velocity : V [m/s]

    Notes
    -----
    Without inertia. Confidence: printed.

    References
    ----------
    D, eq (1.10).

    >>> f"{cart_power(8375.0, 0.16):.0f} W"
    '1340 W'
    """
    require_finite(resistance=resistance, velocity=velocity)
    return np.multiply(resistance, velocity)


def dry_resistance(force):
    """Constant resistance of `force` [N] >= 0 that opposes the motion either way (dry friction), a `DryResistance`.

        R(v, a) = force sign(v)

    It is the resistance to give `simulate`, `elastic.travel` and the other drives for a machine of which one force is
    known. A plain constant, `lambda v, a: 3486.0`, would push the cart on its way back and is refused.

    >>> resistance = dry_resistance(3486.0)
    >>> [float(resistance(v, 0.0)) for v in (-0.2, 0.0, 0.2)]
    [-3486.0, 0.0, 3486.0]
    """
    return DryResistance(force)


def roll(layer, roller, material, speed, *, rolling_friction=0.0, nonuniformity=1.0, one_sided=False):
    """One roller by the engineering formulas (1.4)-(1.8), an `FormulaContactResult`: the engine "formula".

    The formulas have one roller: pressed at q, with the friction of mix on roller in the exponent alpha, whatever its
    condition `rolling` is. The resistance has the sign of the speed. For speed < 0 leading and trailing stay + ahead,
    while x, shear_traction and resistance keep the fixed axis x. The shear traction is that behind alpha, friction
    times pressure, backwards on the mix.

    Parameters
    ----------
    layer : Layer without plies; its height only warns where the half-plane is no longer a fair picture
    roller : Roller with `load` or `peak_pressure`, profile "parabola"
    material : anything with `youngs_modulus`, the secant modulus of the contact [Pa], and `poisson`; what it may know
        of time is not used
    speed : of the roller along x [m/s], not 0
    rolling_friction : f2 + f3 of (1.8) [-], >= 0; 0 for the share of the mix alone
    nonuniformity, one_sided : k2 and the rival reading of (1.6), as of `roller_force`

    References
    ----------
    D, eqs (1.4)-(1.8).

    >>> from compact.material.laws import Elastic
    >>> from compact.rolling_contact import Layer, Roller
    >>> roller = Roller(0.11, peak_pressure=0.203e6, friction=0.35, rolling="free")
    >>> rolled = roll(Layer(0.22), roller, Elastic(0.75e6, 0.3), speed=0.16, rolling_friction=0.17)
    >>> f"{rolled.load:.0f} N/m, resistance {rolled.resistance:.0f} N/m, angle {np.degrees(rolled.capture_angle):.1f}"
    '15224 N/m, resistance 2885 N/m, angle 29.3'
    """
    _refuse_beyond_formula(layer, roller, material, speed)
    R, E, nu = roller.radius, material.youngs_modulus, material.poisson
    alpha, shape = pressure_exponent(nu, roller.friction), (nonuniformity, one_sided)
    pressure = roller.peak_pressure or pressure_for_load(roller.load, E, nu, alpha, R, 1.0, *shape)
    phi = capture_angle(pressure, E, nu, alpha)
    load, length = roller_force(phi, E, nu, alpha, R, 1.0, *shape), contact_length(phi, R, alpha)
    leading = R * np.sin(phi)
    touched = LineContact(
        exponent=1 - alpha, radius=R, contact_modulus=E / (1 - nu**2), contact_length=length, load=load,
        peak_pressure=pressure, leading=leading, trailing=leading - length, centroid=(2 / 3) * (1 - 2 * alpha) * length,
    )  # fmt: skip
    _warn_of_layer(touched, layer)
    ahead = touched.trailing + length * np.square(np.sin(np.linspace(0, np.pi / 2, SAMPLES)))
    ahead[-1] = leading
    sampled = touched.pressure(ahead)
    direction = np.sign(speed)
    forth = slice(None, None, int(direction))  # x ascends, whichever way the roller goes
    rolled = FormulaContactResult(
        load=load,
        resistance=direction * roller_resistance(load, length, R, alpha, rolling_friction),
        leading=leading,
        trailing=touched.trailing,
        x=(direction * ahead)[forth],
        pressure=sampled[forth],
        shear_traction=(-direction * roller.friction * sampled)[forth],
        peak_pressure=pressure,
        capture_angle=phi,
        exponent=alpha,
        contact_length=length,
        mean_pressure=load / length,
    )
    require_on_target(rolled, roller, TARGET)
    return rolled


def _warn_of_layer(exact, layer):
    if exact.half_width > HALF_PLANE * layer.height:
        warnings.warn(
            f"half-plane theory needs `half_width` < {HALF_PLANE:g} `height`, got {exact.half_width:.3g} m for "
            f"{layer.height:.3g} m; the layer carries more: use spectral or fem",
            stacklevel=3,
        )


def _refuse_beyond_formula(layer, roller, material, speed):
    require_finite(speed=speed)
    if layer.plies:
        raise ValueError(f"the formula engine knows one modulus, got {len(layer.plies)} `plies`; use spectral or fem")
    if speed == 0:
        raise ValueError("`speed` must not be 0, got 0: the resistance is set-valued there; say which way it goes")
    if roller.indentation is not None:
        raise ValueError(
            f"`indentation` is undefined on a half-plane (it diverges with the logarithm of its size), got "
            f"{roller.indentation!r}; give `load` or `peak_pressure`, or use spectral or fem"
        )
    if roller.profile != "parabola":
        raise ValueError(f"the formula engine needs `profile` 'parabola', got {roller.profile!r}; use fem")
    require_known("rolling", roller.rolling, get_args(RollerCondition))
    for name in ("youngs_modulus", "poisson"):
        if not hasattr(material, name):
            got = type(material).__name__
            raise ValueError(f"the formula engine needs a `material` with `{name}`, got {got}; use fem")


def _refuse_unless_exponent(exponent):
    inside = (np.asarray(exponent) > 0) & (np.asarray(exponent) < 1)
    require_that(inside, exponent, "`exponent` must lie between 0 and 1, got")


def _refuse_unless_angle(capture_angle):
    inside = (np.asarray(capture_angle) > 0) & (np.asarray(capture_angle) <= np.pi / 2)
    require_that(inside, capture_angle, "`capture_angle` must lie between 0 and pi/2, got")


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
    require_positive(height=height)
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
    require_positive(width=width, radius=radius)
    require_nonnegative(feeder_sleeve=feeder_sleeve, overlap=overlap)
    field = 2 * np.asarray(radius) + feeder_sleeve - overlap
    require_that(field > 0, field, "`overlap` must be less than 2 `radius` + `feeder_sleeve`, which leaves a field of")
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
    require_positive(width=width)
    require_nonnegative(overlap=overlap)
    require_integers(rollers=rollers)
    field = width / np.asarray(rollers)
    require_that(
        overlap < field, overlap - field, "`overlap` must be less than the field `width`/`rollers`, exceeds by"
    )
    return field + overlap
