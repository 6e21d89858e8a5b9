"""Engine "formula": engineering formulas (1.4)-(1.8) for the load and the resistance of one roller.

D is the monograph of Loveikin and Pochka on cam-driven roller forming. The available print lacks the operators of
(1.5)-(1.8). The formulas below are a reconstruction that uses every printed digit and is verified against exact contact
theory; the notes state the confidence in each. All formulas broadcast over arrays.

E of (1.5) and (1.6) is a secant modulus of the contact, neither the unloading nor the plastic modulus. Both equations
determine q^2/E' only, so that no calibration should use one of them alone.

References
----------
V. S. Loveikin and K. I. Pochka, monograph on roller forming machines (D), eqs (1.4)-(1.8).
"""

import warnings

import numpy as np

from compact import rolling_contact
from compact.engines.halfplane import LineContact, pressure_exponent
from compact.engines.interface import NO_AIR, ONE_MODULUS, RECOVERS, RIGID_BASE, Case, Engine, Limit, Turning, shares_of
from compact.material.laws import Elastic
from compact.numerics import Array
from compact.numerics.validation import (
    require_between,
    require_inside,
    require_instance,
    require_nonnegative,
    require_positive,
    require_that,
)
from compact.rolling_contact import Contact, Layer, Roller

TARGET_TOLERANCE = 1e-9  # [-], relative, of the prescribed load or pressure
CONTACT_SAMPLES = 201  # [-], points along the contact, denser at the edges where the pressure is steep
MAX_HALF_WIDTH_RATIO = 0.5  # [-], half-width over height; a bonded layer (nu 0.3) then carries 17 % more
TRIAL_PRESSURE_RATIO = 1e-3  # [-], trial pressure over E, for which (1.5) has a solution

Values = float | Array


def capture_angle(pressure: Values, youngs_modulus: Values, poisson: Values, exponent: Values) -> Values:
    """Compute the capture angle [rad], from the lowest point of the roller to the first contact with the mix.

        sin phi = 7.53 (1 - nu^2) alpha^(1 - alpha) (1 - alpha)^(1 + alpha) q/E                     (1.5)

    Parameters
    ----------
    pressure : float or ndarray
        Peak pressure q required for the density [Pa], > 0.
    youngs_modulus : float or ndarray
        Secant modulus E of the contact [Pa], > 0.
    poisson : float or ndarray
        Poisson's ratio nu [-], 0 to 0.5.
    exponent : float or ndarray
        Pressure exponent alpha of (1.4) [-], 0 < alpha < 1.

    Raises
    ------
    ValueError
        If sin phi would exceed 1.

    Notes
    -----
    Confidence 80 %. At alpha = 1/2 it is 5.9 % below Hertz, sin phi = 2 q/E*. Valid near 1/2: exact theory has
    2/sin(pi alpha) where this has 7.53 alpha (1 - alpha).

    Examples
    --------
    >>> f"{np.degrees(capture_angle(0.203e6, 0.75e6, 0.3, 0.4683)):.2f} deg"
    '29.35 deg'
    """
    require_positive(pressure=pressure, youngs_modulus=youngs_modulus)
    require_between(0, 0.5, poisson=poisson)
    require_inside(0, 1, exponent=exponent)
    alpha, E = np.asarray(exponent), np.asarray(youngs_modulus)
    shape = np.exp((1 - alpha) * np.log(alpha) + (1 + alpha) * np.log1p(-alpha))
    sine = 7.53 * (1 - np.square(poisson)) * shape * (pressure / E)
    require_that(sine <= 1, sine, "no capture angle; lower `pressure` or raise `youngs_modulus`: sin phi would be")
    return np.arcsin(sine)


def roller_force(
    capture_angle: Values,
    youngs_modulus: Values,
    poisson: Values,
    exponent: Values,
    radius: Values,
    length: Values,
    nonuniformity: Values = 1.0,
    one_sided: bool = False,
) -> Values:
    """Compute the normal force on one roller [N].

        F = k2 L E R sin^2(phi) / [20.32 (1 - nu^2) alpha (1 - alpha)^3]                            (1.6)

    Parameters
    ----------
    capture_angle : float or ndarray
        phi of (1.5) [rad], 0 < phi <= pi/2.
    youngs_modulus : float or ndarray
        Secant modulus E of the contact [Pa], > 0.
    poisson : float or ndarray
        Poisson's ratio nu [-], 0 to 0.5.
    exponent : float or ndarray
        Pressure exponent alpha of (1.4) [-], 0 < alpha < 1.
    radius, length : float or ndarray
        R and L of the roller [m], > 0.
    nonuniformity : float or ndarray
        Factor k2 of the pressure along the roller [-], > 0.
    one_sided : bool
        True for the alternative reading without alpha in the denominator, contact on the front half only: about F/2.

    Notes
    -----
    Confidence 65 %; no calibration should rest on the factor 2 of the alternative. At alpha = 1/2 it is 0.26 % above
    Hertz.

    Examples
    --------
    >>> f"{roller_force(0.5122, 0.75e6, 0.3, 0.4683, 0.11, 1.164):.0f} N"
    '17721 N'
    """
    require_positive(youngs_modulus=youngs_modulus, radius=radius, length=length, nonuniformity=nonuniformity)
    require_between(0, 0.5, poisson=poisson)
    _require_capture_angle(capture_angle)
    require_inside(0, 1, exponent=exponent)
    alpha = np.asarray(exponent)
    rest = 1 - alpha
    denominator = 20.32 * (1 - np.square(poisson)) * (rest * rest * rest) * (1 if one_sided else alpha)
    return nonuniformity * length * np.asarray(youngs_modulus) * radius * np.square(np.sin(capture_angle)) / denominator


def pressure_for_load(
    force: Values,
    youngs_modulus: Values,
    poisson: Values,
    exponent: Values,
    radius: Values,
    length: Values,
    nonuniformity: Values = 1.0,
    one_sided: bool = False,
) -> Values:
    """Compute the peak pressure [Pa] at which one roller carries a normal force.

        F ~ sin^2(phi) ~ q^2                                                                  (1.5), (1.6)

    Parameters
    ----------
    force : float or ndarray
        F of (1.6) [N], > 0.
    youngs_modulus, poisson, exponent, radius, length, nonuniformity, one_sided
        As of `roller_force`.

    Examples
    --------
    >>> f"{pressure_for_load(17721.0, 0.75e6, 0.3, 0.4683, 0.11, 1.164) / 1e3:.1f} kPa"
    '203.0 kPa'
    """
    require_positive(force=force, youngs_modulus=youngs_modulus)
    trial = TRIAL_PRESSURE_RATIO * np.asarray(youngs_modulus)
    angle = capture_angle(trial, youngs_modulus, poisson, exponent)
    trial_force = roller_force(angle, youngs_modulus, poisson, exponent, radius, length, nonuniformity, one_sided)
    return trial * np.sqrt(force / trial_force)


def contact_length(capture_angle: Values, radius: Values, exponent: Values) -> Values:
    """Compute the contact length [m]; the longer part lies ahead of the lowest point.

        l = R sin(phi)/(1 - alpha)                                                                  (1.7)

    Parameters
    ----------
    capture_angle : float or ndarray
        phi of (1.5) [rad], 0 < phi <= pi/2.
    radius : float or ndarray
        R [m], > 0.
    exponent : float or ndarray
        alpha of (1.4) [-], 0 < alpha < 1.

    Notes
    -----
    Exact for a half-plane with the traction on the mix against the travel (a driven roller). Confidence 95 %.

    Examples
    --------
    >>> f"{contact_length(0.5122, 0.11, 0.4683) * 1e3:.1f} mm"
    '101.4 mm'
    """
    _require_capture_angle(capture_angle)
    require_positive(radius=radius)
    require_inside(0, 1, exponent=exponent)
    return radius * np.sin(capture_angle) / (1 - np.asarray(exponent))


def roller_resistance(
    force: Values, contact_length: Values, radius: Values, exponent: Values, friction: Values
) -> Values:
    """Compute the resistance of one roller [N].

        F_p = (F/R) [l (1 - 2 alpha)/3 + (f2 + f3) R]                                               (1.8)

    Parameters
    ----------
    force : float or ndarray
        F of (1.6) [N], >= 0.
    contact_length, radius : float or ndarray
        l of (1.7) and R [m], > 0.
    exponent : float or ndarray
        alpha of (1.4) [-], 0 < alpha < 1.
    friction : float or ndarray
        f2 + f3 [-], >= 0; f3 is the friction of bush on journal, f2 has no legend in the print.

    Notes
    -----
    Confidence 60 %. The lever arm l (1 - 2 alpha)/3 is the distance of the resultant from the pressure peak; about the
    lowest point exact theory has twice that.

    Examples
    --------
    >>> f"{roller_resistance(17721.0, 0.1014, 0.11, 0.4683, 0.17):.0f} N"
    '3358 N'
    """
    require_nonnegative(force=force, friction=friction)
    require_positive(contact_length=contact_length, radius=radius)
    require_inside(0, 1, exponent=exponent)
    arm = np.asarray(contact_length) * (1 - 2 * np.asarray(exponent)) / 3
    return np.asarray(force) * (arm / radius + friction)


def roll(
    layer: Layer,
    roller: Roller,
    material: Elastic,
    speed: float,
    *,
    rolling_friction: float = 0.0,
    nonuniformity: float = 1.0,
    one_sided: bool = False,
) -> Contact:
    """Compute the contact of one roller by the formulas (1.4)-(1.8).

    The formulas describe one roller at the pressure q, with the friction of mix on roller in the exponent alpha,
    whatever its condition `rolling` is. The resistance has the sign of the speed. For speed < 0 leading and trailing
    stay positive ahead, while x, shear_traction and resistance refer to the fixed axis x. The shear traction is that
    assumed by alpha: friction times pressure, on the mix against the travel.

    The pressure has the exponent of (1.4) and the prescribed peak. Its integral is not exactly the load (1.6): the two
    differ by 6 % for the published machine. Exact contact theory is `galin`. `own` has the capture angle of (1.5) [rad]
    and the exponent of (1.4) [-].

    Parameters
    ----------
    layer : Layer
        Layer without plies. Its height is only compared with the half-width.
    roller : Roller
        Roller with `load` or `peak_pressure`, profile "parabola".
    material : Elastic
        Material with `youngs_modulus`, the secant modulus of the contact [Pa], and `poisson`; relaxation is ignored.
    speed : float
        Speed of the roller along x [m/s], not 0.
    rolling_friction : float
        f2 + f3 of (1.8) [-], >= 0; 0 for the resistance of the mix alone.
    nonuniformity, one_sided : float, bool
        As of `roller_force`.

    Warns
    -----
    UserWarning
        If the half-width exceeds half of the layer height.

    Examples
    --------
    >>> from compact.material.laws import Elastic
    >>> from compact.rolling_contact import Layer, Roller
    >>> roller = Roller(0.11, peak_pressure=0.203e6, friction=0.35, rolling="free")
    >>> mix = Elastic(youngs_modulus=0.75e6, poisson=0.3)
    >>> result = roll(Layer(0.22), roller, mix, speed=0.16, rolling_friction=0.17)
    >>> angle = np.degrees(result.own["capture_angle"])
    >>> f"{result.load:.0f} N/m, resistance {result.resistance:.0f} N/m, angle {angle:.1f}"
    '15224 N/m, resistance 2885 N/m, angle 29.3'
    """
    FORMULA.require(layer, roller, speed)
    if roller.profile != "parabola":
        raise ValueError(f"the formula engine needs `profile` 'parabola', got {roller.profile!r}; use fem")
    require_instance(Elastic, "an Elastic law for the formula engine", material=material)
    R, E, nu = roller.radius, material.youngs_modulus, material.poisson
    alpha, options = float(pressure_exponent(nu, roller.friction)), (nonuniformity, one_sided)
    name, value = roller.target
    pressure = value if name == "peak_pressure" else float(pressure_for_load(value, E, nu, alpha, R, 1.0, *options))
    phi = float(capture_angle(pressure, E, nu, alpha))
    load = float(roller_force(phi, E, nu, alpha, R, 1.0, *options))
    length, leading = float(contact_length(phi, R, alpha)), float(R * np.sin(phi))
    centroid = (2 / 3) * (1 - 2 * alpha) * length
    modulus = material.contact_modulus
    contact = LineContact(1 - alpha, R, modulus, length, load, pressure, leading, leading - length, centroid)
    if contact.half_width > MAX_HALF_WIDTH_RATIO * layer.height:
        warnings.warn(
            f"half-plane theory needs `half_width` < {MAX_HALF_WIDTH_RATIO:g} `height`, got {contact.half_width:.3g} m "
            f"for {layer.height:.3g} m; the layer carries more: use spectral or fem",
            stacklevel=2,
        )
    ahead = contact.trailing + length * np.square(np.sin(np.linspace(0, np.pi / 2, CONTACT_SAMPLES)))
    ahead[-1] = leading
    samples = np.asarray(contact.pressure(ahead))
    resistance, shear = float(roller_resistance(load, length, R, alpha, rolling_friction)), -roller.friction * samples
    own = {"capture_angle": phi, "exponent": alpha}
    along = Contact(load, resistance, leading, leading - length, ahead, samples, shear, peak_pressure=pressure, own=own)
    return rolling_contact.require_on_target(rolling_contact.for_travel(along, speed), roller, TARGET_TOLERANCE)


def _require_capture_angle(capture_angle: Values) -> None:
    inside = (np.asarray(capture_angle) > 0) & (np.asarray(capture_angle) <= np.pi / 2)
    require_that(inside, capture_angle, "`capture_angle` must lie between 0 and pi/2, got")


class FormulaEngine(Engine):
    """Engineering formulas of a half-plane: no indentation, no effect of the speed."""

    name, takes, cost, points_per_task = "formula", "half-plane", 0.001, 100
    mix_parameters = ("required_pressure", "effective_modulus", "poisson", "steel_friction")
    limits = (
        Limit("machine.gap_geometry", ("parabola",), "half-plane theory has no other gap", fixed=True),
        Limit("contact.indentation", (None,), "the depth of a contact on a half-plane is not defined", late=True),
        ONE_MODULUS,
        RIGID_BASE,
        NO_AIR,
        *RECOVERS,
    )

    def valid(self, height_ratio: float | None = None, detail: str | None = None) -> str:
        """Refuse thin layers: they are no half-plane."""
        thin = height_ratio is not None and 2 * MAX_HALF_WIDTH_RATIO * height_ratio < 1
        return f"no half-plane, layer {height_ratio:.2g} contact lengths high" if thin else ""

    @property
    def fitted_keys(self) -> tuple[str, ...]:
        """Inputs of eqs 1.8 and 1.9 other than the mix."""
        return "machine.roller_friction", "machine.bearing_friction"

    def contact(self, case: Case, start: Contact | None = None) -> Contact:
        """Evaluate the formulas."""
        return roll(case.layer, case.roller, case.material, case.speed, **case.factors)

    def turning(self, contact: Contact, radius: float, release: float, film: float | None = None) -> Turning:
        """Return the shares of a contact that grows into fresh mix as its own imprint, of the exponent of (1.4)."""
        return shares_of("imprint", contact.leading, contact.own["exponent"], release)


FORMULA = FormulaEngine()
