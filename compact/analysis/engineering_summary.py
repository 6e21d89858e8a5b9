"""The engineering formulas 1.1-1.10 of one machine and mix, with what is known of each."""

from dataclasses import dataclass

import numpy as np

from compact import contact
from compact.engines.halfplane import pressure_exponent
from compact.quantities import FORMULA

ROUNDING = 1e-6  # of a tenth of a millimetre, by which a length may exceed a whole number of them


@dataclass(frozen=True)
class Engineering:
    """Eqs 1.1-1.10 for one machine and mix, SI; forces are of one roller unless the name says cart."""

    pressure: float
    exponent: float
    capture_angle: float
    roller_force: float
    contact_length: float
    roller_resistance: float
    resistance_coefficient: float
    cart_resistance: float
    guide_coefficient: float
    cart_power: float
    radius_low: float
    radius_high: float
    rollers_needed: int
    stroke_needed: float


def peak_pressure(scene, blend):
    """Peak contact pressure q [Pa] of the formulas: as `[contact]` prescribes it or the load, else as the mix needs.

    By eqs 1.5 and 1.6 the load is proportional to q^2. Raises ValueError for a prescribed depth if the formulas are the
    engine of the scene; beside another engine they are at the pressure that the mix needs.
    """
    given, machine = scene.target, scene.machine
    if "load" in given:
        alpha = pressure_exponent(blend.poisson, blend.steel_friction)
        return float(
            contact.pressure_for_load(
                given["load"], blend.effective_modulus, blend.poisson, alpha, machine.roller_radius,
                machine.roller_length, machine.pressure_nonuniformity, machine.one_sided,
            )
        )  # fmt: skip
    if "indentation" in given and scene.accuracy.engine == "formula":
        raise ValueError(
            f"contact.indentation: the engine formula has no depth, as it diverges on a half-plane, got "
            f"{given['indentation']!r}; give contact.load or contact.peak_pressure, or choose another accuracy.engine"
        )
    return given.get("peak_pressure", blend.required_pressure)


def _force(scene, blend, pressure):
    """Exponent [-], capture angle [rad] and force on one roller [N] by eqs 1.4 to 1.6."""
    machine, modulus, nu = scene.machine, blend.effective_modulus, blend.poisson
    alpha = float(pressure_exponent(nu, blend.steel_friction))
    phi = contact.capture_angle(pressure, modulus, nu, alpha)
    force = contact.roller_force(
        phi, modulus, nu, alpha, machine.roller_radius, machine.roller_length,
        machine.pressure_nonuniformity, machine.one_sided,
    )  # fmt: skip
    return alpha, phi, force


def engineering(scene, blend, pressure):
    """`Engineering` of a scene and its mix at the peak contact pressure q [Pa]; the power is that at mean speed."""
    machine = scene.machine
    alpha, phi, force = _force(scene, blend, pressure)
    length = contact.contact_length(phi, machine.roller_radius, alpha)
    friction = machine.roller_friction + machine.bearing_friction
    one = contact.roller_resistance(force, length, machine.roller_radius, alpha, friction)
    whole = contact.cart_resistance(
        force, one, machine.rollers, machine.weight, bearing_friction=machine.bearing_friction,
        journal_diameter=machine.journal_diameter, rolling_arm=machine.rolling_arm,
        wheel_diameter=machine.guide_wheel_diameter, rib_factor=machine.rib_factor,
    )  # fmt: skip
    needed = contact.rollers_needed(scene.product.width, machine.roller_radius, machine.feeder_sleeve, machine.overlap)
    radius = contact.radius_range(scene.product.height)
    return Engineering(
        pressure=float(pressure),
        exponent=alpha,
        capture_angle=float(phi),
        roller_force=float(force),
        contact_length=float(length),
        roller_resistance=float(one),
        resistance_coefficient=float(one / force),
        cart_resistance=float(whole),
        guide_coefficient=float(
            contact.guide_coefficient(
                bearing_friction=machine.bearing_friction,
                journal_diameter=machine.journal_diameter,
                rolling_arm=machine.rolling_arm,
                wheel_diameter=machine.guide_wheel_diameter,
                rib_factor=machine.rib_factor,
            )
        ),
        cart_power=float(contact.cart_power(whole, scene.mean_speed)),
        radius_low=float(radius.low),
        radius_high=float(radius.high),
        rollers_needed=int(needed),
        stroke_needed=float(contact.stroke_needed(scene.product.width, needed, machine.overlap)),
    )


def coverage(scene, said):
    """Sentence on rollers that are too few for the product by eqs 1.2 and 1.3, with the remedy; empty if enough.

    With n rollers the product is covered if the field of each, 2R + B_T - b_n, is B/n at least, and the stroke is
    B/n + b_n.

    Parameters
    ----------
    scene : Scene
    said : Engineering of it
    """
    machine, width = scene.machine, scene.product.width
    if machine.rollers >= said.rollers_needed:
        return ""
    stroke = float(contact.stroke_needed(width, machine.rollers, machine.overlap))
    sleeve = _rounded_up(stroke - 2 * machine.roller_radius)
    stroke = _rounded_up(2 * machine.roller_radius + sleeve)  # which rounding must not make too short
    return (
        f"eq 1.2: the product, {width:g} m wide, needs {said.rollers_needed} rollers, the scene has {machine.rollers}; "
        f"set machine.rollers to {said.rollers_needed}, or machine.feeder_sleeve to {sleeve:.4f} m and motion.stroke "
        f"to {stroke:.4f} m; all forces here are those of {machine.rollers}"
    )


def _rounded_up(length):
    """A length up to the next tenth of a millimetre [m]."""
    return np.ceil(1e4 * length - ROUNDING) / 1e4


PRESCRIBED = "contact: as prescribed, or the pressure of the load that is"
# origin and confidence of each field of Engineering; theory of the formulas in `contact`
KNOWN_BY = {
    "pressure": "mix: pressure that the density requires",
    "exponent": "eq 1.4, exact theory",
    "capture_angle": "eq 1.5, reconstructed (80 %)",
    "roller_force": "eq 1.6, reconstructed (65 %)",
    "contact_length": "eq 1.7, reconstructed (95 %)",
    "roller_resistance": "eq 1.8, reconstructed (60 %)",
    "resistance_coefficient": "eqs 1.6 and 1.8",
    "cart_resistance": "eq 1.9, reconstructed (60 %); its guide friction is not that of the drives",
    "guide_coefficient": "eq 1.9: (f3 d + 2 f4) f5/D, guide friction over the load of the guide wheels",
    "cart_power": "eq 1.10 at mean speed",
    "radius_low": "eq 1.1, printed",
    "radius_high": "eq 1.1, printed",
    "rollers_needed": "eq 1.2, reconstructed (80 %)",
    "stroke_needed": "eq 1.3, reconstructed (80 %)",
}


@dataclass(frozen=True)
class Number:
    """A headline number: value, unit, how it is known, and its spread from `low` to `high` where that is known."""

    value: float
    unit: str
    known_by: str
    low: float | None = None
    high: float | None = None


def numbers(scene, blend, said, exact):
    """Headline `Number`s by name: an `Engineering`, and Galin's exact contact beside it at the same peak pressure.

    The spread is that of the required pressure, where the formulas still hold; none if load or pressure is prescribed.
    """
    needed = blend.parameter("required_pressure")
    prescribed = {"load", "peak_pressure"} & set(scene.target)
    required = () if prescribed else (needed.low, needed.high)
    ends = [_reached(scene, blend, pressure) for pressure in required] or [None, None]
    found = {}
    for name, known_by in KNOWN_BY.items():
        low, high = (None if end is None else getattr(end, name) for end in ends)
        value = getattr(said, name)
        known_by = PRESCRIBED if prescribed and name == "pressure" else known_by
        spread = {} if low == value == high else {"low": low, "high": high}
        found[name] = Number(value, FORMULA[name].unit, known_by, **spread)
    known_by = "Galin, exact for a half-plane"
    half_plane = {
        "exact_capture_angle": np.arcsin(exact.leading / exact.radius),
        "exact_roller_force": exact.load * scene.machine.roller_length,
        "exact_contact_length": exact.contact_length,
    }
    return found | {name: Number(float(value), FORMULA[name].unit, known_by) for name, value in half_plane.items()}


def _reached(scene, blend, pressure):
    try:
        return engineering(scene, blend, pressure)
    except ValueError:  # beyond the formulas: no such angle
        return None
