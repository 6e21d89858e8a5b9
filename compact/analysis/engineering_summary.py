"""Engineering formulas 1.1-1.10 for one machine and mix, with the confidence and the spread of each result.

The formulas themselves, their limits and sources are in `compact.contact`.
"""

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from compact import contact
from compact.engines import ENGINES
from compact.engines.halfplane import LineContact, pressure_exponent
from compact.material.mix import Mix
from compact.quantities import FORMULA
from compact.scene.loader import Scene


def _by(confidence: str) -> Any:
    """Return a field of the formulas, with its equation or origin and the confidence in it."""
    return field(metadata={"by": confidence})


@dataclass(frozen=True)
class Engineering:
    """Results of eqs 1.1-1.10 for one machine and mix, SI; units are those of `quantities.FORMULA`.

    Forces are those of one roller, but `cart_resistance`, the resistance of the whole cart.
    """

    pressure: float = _by("mix: pressure that the density requires")
    exponent: float = _by("eq 1.4, exact theory")
    capture_angle: float = _by("eq 1.5, reconstructed (80 %)")
    roller_force: float = _by("eq 1.6, reconstructed (65 %)")
    contact_length: float = _by("eq 1.7, reconstructed (95 %)")
    roller_resistance: float = _by("eq 1.8, reconstructed (60 %)")
    resistance_coefficient: float = _by("eqs 1.6 and 1.8")
    cart_resistance: float = _by("eq 1.9, reconstructed (60 %); its guide friction is not that of the drives")
    guide_coefficient: float = _by("eq 1.9: (f3 d + 2 f4) f5/D, guide friction over the load of the guide wheels")
    cart_power: float = _by("eq 1.10 at mean speed")
    radius_low: float = _by("eq 1.1, printed")
    radius_high: float = _by("eq 1.1, printed")
    rollers_needed: int = _by("eq 1.2, reconstructed (80 %)")
    stroke_needed: float = _by("eq 1.3, reconstructed (80 %)")


def peak_pressure(scene: Scene, mix: Mix) -> float:
    """Return the peak contact pressure of the formulas.

    Returns
    -------
    float
        Pressure that [contact] prescribes, or that of the prescribed load, else the required pressure of the mix [Pa].

    Raises
    ------
    ValueError
        If the scene prescribes an indentation and the formulas are its engine.

    Notes
    -----
    By eqs 1.5 and 1.6 the load is proportional to the square of the pressure.
    """
    given, machine = scene.target, scene.machine
    if "load" in given:
        alpha = pressure_exponent(mix.poisson, mix.steel_friction)
        return float(
            contact.pressure_for_load(
                given["load"], mix.effective_modulus, mix.poisson, alpha, machine.roller_radius,
                machine.roller_length, machine.pressure_nonuniformity, machine.one_sided,
            )
        )  # fmt: skip
    if "indentation" in given and not ENGINES[scene.accuracy.engine].reads("contact.indentation"):
        words = "contact.indentation: the engine formula takes none, as it diverges on a half-plane"
        raise ValueError(f"{words}, got {given['indentation']!r}; give contact.load or contact.peak_pressure")
    return given.get("peak_pressure", mix.required_pressure)


def engineering(scene: Scene, mix: Mix, pressure: float) -> Engineering:
    """Evaluate eqs 1.1-1.10 for a scene.

    Parameters
    ----------
    pressure : float
        Peak contact pressure [Pa].

    Returns
    -------
    Engineering
        The power is that at the mean speed.
    """
    machine, modulus, nu = scene.machine, mix.effective_modulus, mix.poisson
    radius, width, overlap = machine.roller_radius, scene.product.width, machine.overlap
    guides = {name: getattr(machine, name) for name in ("bearing_friction", "journal_diameter", "rolling_arm")}
    guides |= {"wheel_diameter": machine.guide_wheel_diameter, "rib_factor": machine.rib_factor}
    alpha = float(pressure_exponent(nu, mix.steel_friction))
    phi = contact.capture_angle(pressure, modulus, nu, alpha)
    force = contact.roller_force(
        phi, modulus, nu, alpha, radius, machine.roller_length, machine.pressure_nonuniformity, machine.one_sided
    )
    length = contact.contact_length(phi, radius, alpha)
    friction = machine.roller_friction + machine.bearing_friction
    one = contact.roller_resistance(force, length, radius, alpha, friction)
    whole = contact.cart_resistance(force, one, machine.rollers, machine.weight, **guides)
    needed = int(contact.rollers_needed(width, radius, machine.feeder_sleeve, overlap))
    radii = contact.radius_range(scene.product.height)
    return Engineering(
        pressure=float(pressure),
        exponent=alpha,
        capture_angle=float(phi),
        roller_force=float(force),
        contact_length=float(length),
        roller_resistance=float(one),
        resistance_coefficient=float(one / force),
        cart_resistance=float(whole),
        guide_coefficient=float(contact.guide_coefficient(**guides)),
        cart_power=float(contact.cart_power(whole, scene.mean_speed)),
        radius_low=float(radii.low),
        radius_high=float(radii.high),
        rollers_needed=needed,
        stroke_needed=float(contact.stroke_needed(width, needed, overlap)),
    )


def coverage(scene: Scene, formulas: Engineering) -> str:
    """Check by eq 1.2 that the rollers cover the width of the product.

    n rollers cover the product if the field of each, 2R + B_T - b_n, is at least B/n.

    Returns
    -------
    str
        Sentence with the remedy; empty if the rollers suffice.
    """
    machine, needed = scene.machine, formulas.rollers_needed
    if machine.rollers >= needed:
        return ""
    return (
        f"eq 1.2: the product, {scene.product.width:g} m wide, needs {needed} rollers, the scene has "
        f"{machine.rollers}; set machine.rollers to {needed}; all forces here are those of {machine.rollers}"
    )


PRESCRIBED = "contact: as prescribed, or the pressure of the load that is"


@dataclass(frozen=True)
class Number:
    """A result of the formulas.

    Parameters
    ----------
    known_by : str
        Equation or origin, with its confidence.
    low, high : float, optional
        Spread over the prior of the mix.
    """

    value: float
    unit: str
    known_by: str
    low: float | None = None
    high: float | None = None


def numbers(scene: Scene, mix: Mix, formulas: Engineering, exact: LineContact) -> dict[str, Number]:
    """Collect the results of the formulas and of Galin's exact contact at the same peak pressure.

    Returns
    -------
    dict of str to Number
        The spread is that of the required pressure, within the range of the formulas; none if the scene prescribes
        load or pressure.
    """
    needed = mix.parameter("required_pressure")
    prescribed = {"load", "peak_pressure"} & set(scene.target)
    required = () if prescribed else (needed.low, needed.high)
    ends = [_at_pressure(scene, mix, pressure) for pressure in required] or [None, None]
    found = {}
    for name, confidence in ((each.name, each.metadata["by"]) for each in fields(Engineering)):
        low, high = (None if end is None else getattr(end, name) for end in ends)
        value = getattr(formulas, name)
        known_by = PRESCRIBED if prescribed and name == "pressure" else confidence
        found[name] = Number(value, FORMULA[name].unit, known_by, *(() if low == value == high else (low, high)))
    of_half_plane = {
        "exact_capture_angle": np.arcsin(exact.leading / scene.machine.roller_radius),
        "exact_roller_force": exact.load * scene.machine.roller_length,
        "exact_contact_length": exact.contact_length,
    }
    known_by = "Galin, exact for a half-plane"
    return found | {name: Number(float(each), FORMULA[name].unit, known_by) for name, each in of_half_plane.items()}


def _at_pressure(scene: Scene, mix: Mix, pressure: float) -> Engineering | None:
    """Evaluate the formulas; None beyond their range."""
    try:
        return engineering(scene, mix, pressure)
    except ValueError:
        return None
