"""Loads of a roller by formula: the engineering method (1.1)-(1.10) and the engine "formula".

D is the monograph of Loveikin and Pochka on cam-driven roller forming. The print we work from lost the operators of
(1.2)-(1.9); what stands here is a reconstruction that uses every printed digit and is held against exact contact
theory, and each card tells our confidence in it. Every formula broadcasts over arrays.

In (1.5) and (1.6) E is a secant modulus of the contact, neither the unloading nor the plastic one. The two fix only
q^2/E' together: no calibration should rest on either alone.
"""

import warnings
from dataclasses import dataclass

import numpy as np

from compact.halfplane import LineContact, galin, hertz, pressure_exponent
from compact.records import Rolled, refuse_off_target
from compact.refuse import (
    refuse_fractional,
    refuse_negative,
    refuse_nonfinite,
    refuse_nonpositive,
    refuse_outside,
    refuse_unknown,
    refuse_unless,
)
from compact.sizing import RadiusRange, radius_range, rollers_needed, stroke_needed

__all__ = [
    "DryResistance",
    "EngineeringRolled",
    "LineContact",
    "RadiusRange",
    "capture_angle",
    "cart_power",
    "cart_resistance",
    "contact_length",
    "dry_resistance",
    "galin",
    "hertz",
    "pressure_exponent",
    "radius_range",
    "roll",
    "roller_force",
    "roller_resistance",
    "rollers_needed",
    "stroke_needed",
]

TRACTION = {"frictionless": 0, "free": 0, "sliding": 1, "driven": -1}  # of the mix, along the travel
TARGET = 1e-9  # relative, within which what is prescribed is met
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
        refuse_negative(force=self.force)

    def __call__(self, velocity, acceleration):
        """F sign(velocity) [N], of the common shape of velocity [m/s] and acceleration [m/s2]."""
        velocity, _ = np.broadcast_arrays(velocity, acceleration)
        return self.force * np.sign(velocity)


@dataclass(frozen=True, kw_only=True)
class EngineeringRolled(Rolled):
    """A `Rolled` from exact Galin theory, with the engineering values at the same peak pressure q beside it.

    capture_angle, exponent : phi of (1.5) [rad], alpha of (1.4) [-]
    contact_length : l of (1.7) [m]; the exact one is leading - trailing
    engineering_load : F of (1.6) per unit length, two-sided [N/m]; the exact one is load
    mean_pressure : engineering_load / contact_length [Pa]
    engineering_resistance : F_p of (1.8) per unit length with f2 = f3 = 0, the part of the mix [N/m]; unsigned
    """

    capture_angle: float
    exponent: float
    contact_length: float
    mean_pressure: float
    engineering_load: float
    engineering_resistance: float


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
    refuse_nonpositive(pressure=pressure, youngs_modulus=youngs_modulus)
    refuse_outside(0, 0.5, poisson=poisson)
    _refuse_unless_exponent(exponent)
    alpha, E = np.asarray(exponent), np.asarray(youngs_modulus)
    shape = np.exp((1 - alpha) * np.log(alpha) + (1 + alpha) * np.log1p(-alpha))
    sine = 7.53 * (1 - np.square(poisson)) * shape * (pressure / E)
    refuse_unless(sine <= 1, sine, "no capture angle; lower `pressure` or raise `youngs_modulus`: sin phi would be")
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
    refuse_nonpositive(youngs_modulus=youngs_modulus, radius=radius, length=length, nonuniformity=nonuniformity)
    refuse_outside(0, 0.5, poisson=poisson)
    _refuse_unless_angle(capture_angle)
    _refuse_unless_exponent(exponent)
    alpha = np.asarray(exponent)
    rest = 1 - alpha
    below = 20.32 * (1 - np.square(poisson)) * (rest * rest * rest) * (1 if one_sided else alpha)
    return nonuniformity * length * np.asarray(youngs_modulus) * radius * np.square(np.sin(capture_angle)) / below


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
    refuse_nonpositive(radius=radius)
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
    refuse_negative(force=force, friction=friction)
    refuse_nonpositive(contact_length=contact_length, radius=radius)
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
    refuse_negative(force=force, roller_resistance=roller_resistance, weight=weight, bearing_friction=bearing_friction)
    refuse_negative(rolling_arm=rolling_arm, rib_factor=rib_factor)
    refuse_nonpositive(journal_diameter=journal_diameter, wheel_diameter=wheel_diameter)
    refuse_fractional(rollers=rollers)
    arm = bearing_friction * np.asarray(journal_diameter) + 2 * np.asarray(rolling_arm)
    guide = np.abs(rollers * np.asarray(force) - weight) * arm / wheel_diameter * rib_factor
    return guide + rollers * np.asarray(roller_resistance)


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
    refuse_nonfinite(resistance=resistance, velocity=velocity)
    return np.multiply(resistance, velocity)


def dry_resistance(force):
    """A callable resistance(velocity, acceleration) = force sign(velocity) [N], force >= 0 [N]: a `DryResistance`.

    >>> resistance = dry_resistance(3486.0)
    >>> [float(resistance(v, 0.0)) for v in (-0.2, 0.0, 0.2)]
    [-3486.0, 0.0, 3486.0]
    """
    return DryResistance(force)


def roll(layer, roller, material, speed):
    """One roller over a homogeneous half-plane by closed form, an `EngineeringRolled`: the engine "formula".

        resistance = P (f + centroid/R) sign(speed)

    Pressure, edges and load are Galin's, exact for the given peak pressure or load, with the traction f p on the mix
    along the travel for a "sliding" roller, -f p for a "driven" one (full slip both) and none for "frictionless" and
    "free". The centroid lies (2/3)(1 - 2 alpha) l behind the lowest point for f > 0, ahead for f < 0, and so takes a
    little of f back. (1.4)-(1.8) stand beside it, at the same peak pressure, as fields of their own; they take
    `roller.friction` except for "frictionless". For speed < 0 leading and trailing stay + ahead, while x,
    shear_traction and resistance keep the fixed axis x.

    Parameters
    ----------
    layer : Layer without plies; its height only warns where the half-plane is no longer a fair picture
    roller : Roller with `load` or `peak_pressure`, profile "parabola"
    material : anything with `youngs_modulus`, the secant modulus of the contact [Pa], and `poisson`; what it may know
        of time is not used
    speed : of the roller along x [m/s], not 0

    >>> from compact.material import Elastic
    >>> from compact.records import Layer, Roller
    >>> roller = Roller(0.11, load=8368.0, friction=0.35, rolling="sliding")
    >>> rolled = roll(Layer(0.22), roller, Elastic(0.75e6, 0.3), speed=0.16)
    >>> f"resistance {rolled.resistance:.0f} N/m, capture angle {np.degrees(rolled.capture_angle):.1f} deg"
    'resistance 2686 N/m, capture angle 19.9 deg'
    """
    _refuse_beyond_formula(layer, roller, material, speed)
    R, E, nu = roller.radius, material.youngs_modulus, material.poisson
    friction = TRACTION[roller.rolling] * roller.friction
    target = {"load": roller.load} if roller.load is not None else {"peak_pressure": roller.peak_pressure}
    exact = galin(radius=R, youngs_modulus=E, poisson=nu, friction=friction, **target)
    _warn_of_layer(exact, layer)
    ahead = exact.trailing + exact.contact_length * np.square(np.sin(np.linspace(0, np.pi / 2, SAMPLES)))
    ahead[-1] = exact.leading
    pressure = exact.pressure(ahead)
    direction = np.sign(speed)
    forth = slice(None, None, int(direction))  # x ascends, whichever way the roller goes
    rolled = EngineeringRolled(
        load=exact.load,
        resistance=direction * exact.load * (friction + exact.centroid / R),
        leading=exact.leading,
        trailing=exact.trailing,
        x=(direction * ahead)[forth],
        pressure=pressure[forth],
        shear_traction=(direction * friction * pressure)[forth],
        peak_pressure=exact.peak_pressure,
        **_engineering_values(exact.peak_pressure, roller, material),
    )
    refuse_off_target(rolled, roller, TARGET)
    return rolled


def _engineering_values(pressure, roller, material):
    """(1.4)-(1.8) for a roller of unit length, by the field names of `EngineeringRolled`."""
    R, E, nu = roller.radius, material.youngs_modulus, material.poisson
    alpha = pressure_exponent(nu, 0.0 if roller.rolling == "frictionless" else roller.friction)
    phi = capture_angle(pressure, E, nu, alpha)
    length = contact_length(phi, R, alpha)
    force = roller_force(phi, E, nu, alpha, R, length=1.0)
    return {
        "exponent": alpha,
        "capture_angle": phi,
        "contact_length": length,
        "engineering_load": force,
        "mean_pressure": force / length,
        "engineering_resistance": roller_resistance(force, length, R, alpha, friction=0.0),
    }


def _warn_of_layer(exact, layer):
    if exact.half_width > HALF_PLANE * layer.height:
        warnings.warn(
            f"half-plane theory needs `half_width` < {HALF_PLANE:g} `height`, got {exact.half_width:.3g} m for "
            f"{layer.height:.3g} m; the layer carries more: use spectral or fem",
            stacklevel=3,
        )


def _refuse_beyond_formula(layer, roller, material, speed):
    refuse_nonfinite(speed=speed)
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
    refuse_unknown("rolling", roller.rolling, TRACTION)
    for name in ("youngs_modulus", "poisson"):
        if not hasattr(material, name):
            got = type(material).__name__
            raise ValueError(f"the formula engine needs a `material` with `{name}`, got {got}; use fem")


def _refuse_unless_exponent(exponent):
    inside = (np.asarray(exponent) > 0) & (np.asarray(exponent) < 1)
    refuse_unless(inside, exponent, "`exponent` must lie between 0 and 1, got")


def _refuse_unless_angle(capture_angle):
    inside = (np.asarray(capture_angle) > 0) & (np.asarray(capture_angle) <= np.pi / 2)
    refuse_unless(inside, capture_angle, "`capture_angle` must lie between 0 and pi/2, got")
