"""Quantities of the package: term, symbol, SI unit and unit of plots, one table for each record of results.

A table maps the name of a field, as in `summary.json` and in the CSV files, to its `Quantity`. Units are written in
ASCII (`m/s2`, `1` for a dimensionless quantity); `unit_symbol` converts them to the form of a page or a figure.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

PLOT_FACTORS = {  # unit of a plot -> factor from the SI unit
    "kN": 1e-3, "kN/m": 1e-3, "kN m": 1e-3, "kW": 1e-3, "kPa": 1e-3, "mm": 1e3, "°": math.degrees(1.0),
    "kW/m³": 1e-3, "kJ/m³": 1e-3,
}  # fmt: skip
UNIT_SYMBOLS = {
    "1": "", "-": "", "m/s2": "m/s²", "m/s3": "m/s³", "m/s^3": "m/s³", "m3/s": "m³/s", "kg/m3": "kg/m³",
    "W/m3": "W/m³", "J/m3": "J/m³", "Nm": "N m",
}  # fmt: skip


@dataclass(frozen=True)
class Quantity:
    """Term, units and symbol of a physical quantity.

    Parameters
    ----------
    unit : str
        SI unit in ASCII, "1" for a dimensionless quantity.
    plot_unit : str, optional
        Unit of the axes of figures, a key of `PLOT_FACTORS`; the SI unit by default.
    definition : str, optional
        Definition for the metadata of a file; the term by default.
    """

    term: str
    unit: str
    plot_unit: str = ""
    symbol: str = ""
    definition: str = ""

    @property
    def plot_factor(self) -> float:
        """Factor from the SI unit to the unit of plots [-]."""
        return PLOT_FACTORS[self.plot_unit] if self.plot_unit else 1.0

    @property
    def shown_unit(self) -> str:
        """Unit of plots, typeset; empty for a dimensionless quantity."""
        return self.plot_unit or unit_symbol(self.unit)

    @property
    def axis_label(self) -> str:
        """Label of an axis: term, symbol and unit."""
        return f"{' '.join(filter(None, (self.term, self.symbol)))} [{self.shown_unit or '-'}]"

    @property
    def long_name(self) -> str:
        """Definition, or the term where there is none."""
        return self.definition or self.term


def unit_symbol(unit: str) -> str:
    """Convert a unit from ASCII to its typeset form.

    Parameters
    ----------
    unit : str
        Unit in ASCII, such as "m/s2".

    Returns
    -------
    str
        The typeset unit; empty for a dimensionless quantity.

    Examples
    --------
    >>> unit_symbol("m/s2"), unit_symbol("1"), unit_symbol("Pa")
    ('m/s²', '', 'Pa')
    """
    return UNIT_SYMBOLS.get(unit, unit)


def column_names(quantities: Mapping[str, Quantity], *names: str) -> tuple[str, ...]:
    """Names of columns of a CSV file: field and SI unit, `load_N/m`; the field alone for a dimensionless quantity.

    Parameters
    ----------
    *names : str
        Fields of the record; all of them by default.
    """
    units = {name: quantities[name].unit for name in names or quantities}
    return tuple(name if unit == "1" else f"{name}_{unit}" for name, unit in units.items())


SPEED = Quantity("speed", "m/s", symbol="v")
TIME = Quantity("time", "s", symbol="t")
COEFFICIENT = Quantity(
    "rolling-resistance coefficient", "1", definition="rolling-resistance coefficient: resistance over load"
)
WORK_RESIDUAL = Quantity("energy-balance residual", "1", definition="relative residual of the energy balance")
MASS_RESIDUAL = Quantity(
    "mass-balance residual", "1", definition="relative residual of the mass balance; compacting layers only"
)
EXIT_HEIGHT = Quantity("exit height", "m", "mm")
EXIT_DENSITY_RATIO = Quantity("exit density ratio", "1", symbol="k")
INDENTATION = Quantity("indentation", "m", "mm")
PEAK_PRESSURE = Quantity("peak contact pressure", "Pa", "kPa")
CONTACT_ANGLE = Quantity("contact angle", "rad", "°", "φ")
CONTACT_LENGTH = Quantity("contact length", "m", "mm", definition="contact length: from trailing to leading edge")

CONTACT = {  # fields of a contact of one roller, per unit length of the roller
    "speed": SPEED,
    "load": Quantity("load", "N/m", "kN/m", "P"),
    "resistance": Quantity("rolling resistance", "N/m", "kN/m"),
    "coefficient": COEFFICIENT,
    "leading": Quantity("leading edge", "m", "mm"),
    "trailing": Quantity("trailing edge", "m", "mm"),
    "peak_pressure": PEAK_PRESSURE,
    "indentation": INDENTATION,
    "creep": Quantity("creepage", "1"),
    "work_residual": WORK_RESIDUAL,
    "exit_density_ratio": EXIT_DENSITY_RATIO,
    "exit_height": EXIT_HEIGHT,
    "lower_height": Quantity("height of the lower lift", "m", "mm"),
    "lower_density_ratio": Quantity("density ratio of the lower lift", "1", symbol="k"),
    "peak_density_ratio": Quantity("peak density ratio", "1", symbol="k"),
    "overdense_work": Quantity("plastic work beyond the pressure curve over all of it", "1"),
    "mass_residual": MASS_RESIDUAL,
    "yield_residual": Quantity("yield-condition residual", "1"),
    "equilibrium_residual": Quantity("equilibrium residual", "1"),
    "air_load": Quantity("load by pore air", "N/m", "kN/m"),
    "air_resistance": Quantity("rolling resistance by pore air", "N/m", "kN/m"),
    "air_excess_behind": Quantity("largest excess pressure of pore air behind the contact", "Pa", "kPa"),
}
PASS = {  # fields of one pass over a compacting layer
    name: CONTACT[name]
    for name in (
        "load", "resistance", "indentation", "exit_height", "exit_density_ratio", "work_residual", "mass_residual",
    )
}  # fmt: skip
FORMULA = {  # fields of the engineering formulas 1.1-1.10 and of Galin's exact contact
    "pressure": PEAK_PRESSURE,
    "exponent": Quantity("pressure exponent", "1", symbol="α"),
    "capture_angle": CONTACT_ANGLE,
    "roller_force": Quantity("load on one roller", "N", "kN"),
    "contact_length": CONTACT_LENGTH,
    "roller_resistance": Quantity("rolling resistance of one roller", "N", "kN"),
    "resistance_coefficient": COEFFICIENT,
    "cart_resistance": Quantity("resistance of one cart", "N", "kN"),
    "guide_coefficient": Quantity("friction coefficient of the guide wheels", "1"),
    "cart_power": Quantity("power of one cart", "W"),
    "radius_low": Quantity("least roller radius", "m", "mm"),
    "radius_high": Quantity("largest roller radius", "m", "mm"),
    "rollers_needed": Quantity("required number of rollers", "1"),
    "stroke_needed": Quantity("required stroke", "m"),
    "exact_capture_angle": CONTACT_ANGLE,
    "exact_roller_force": Quantity("load on one roller", "N", "kN"),
    "exact_contact_length": CONTACT_LENGTH,
}
SWEEP_POINT = {  # numbers of one point of a sweep
    "load": Quantity("load on one roller", "N", "kN", definition="normal force on one roller"),
    "resistance": Quantity(
        "resistance of one cart", "N", "kN", definition="rolling resistance of all rollers of one cart"
    ),
    "resistance_coefficient": COEFFICIENT,
    "power": Quantity("power at the mean speed", "W", definition="resistance of one cart times the mean speed"),
    "capture_angle": Quantity(
        "contact angle", "rad", "°", "φ", "contact (entry) angle, from the lowest generatrix to the leading edge"
    ),
    "contact_length": Quantity(
        "contact length", "m", "mm", "", "from the trailing to the leading edge; eq 1.7 by formula"
    ),
    "peak_pressure": PEAK_PRESSURE,
    "exit_density_ratio": Quantity(
        "exit density ratio", "1", "", "k", "mean density ratio behind the last pass; compacting layers only"
    ),
    "load_error": Quantity("relative error estimate of the load", "1"),
    "resistance_error": Quantity("relative error estimate of the resistance", "1"),
    "work_residual": WORK_RESIDUAL,
    "mass_residual": MASS_RESIDUAL,
    "required_pressure": Quantity(
        "required pressure", "Pa", "kPa", definition="pressure at which the mix reaches its density ratio"
    ),
    "saturation": Quantity("degree of saturation", "1", definition="share of the pore volume filled with water"),
}
SWEEP_CORRECTION = {  # further numbers of a point of a sweep by columns that finite elements correct
    "load_factor": Quantity("load over that of columns", "1"),
    "resistance_factor": Quantity("resistance over that of columns", "1"),
    "load_surface_error": Quantity(
        "relative error estimate of the load by interpolation", "1",
        definition="part of load_error: twice the rms leave-one-out error of the response surface",
    ),
    "resistance_surface_error": Quantity(
        "relative error estimate of the resistance by interpolation", "1",
        definition="part of resistance_error: twice the rms leave-one-out error of the response surface",
    ),
}  # fmt: skip
CRITERIA = {  # criteria by which laws are ranked
    "peak_force": Quantity("peak drive force", "N", "kN"),
    "peak_power": Quantity("peak drive power", "W"),
    "rms_force": Quantity("rms drive force", "N", "kN"),
    "rms_power": Quantity("rms drive power", "W"),
    "mean_force": Quantity("mean drive force", "N", "kN"),
    "mean_power": Quantity("mean drive power", "W"),
    "energy": Quantity("energy per cycle", "J"),
    "drawn_energy": Quantity("energy drawn per cycle", "J"),
    "peak_jerk": Quantity("peak jerk", "m/s^3"),
    "dynamic_factor": Quantity(
        "dynamic factor", "1", definition="peak drive force over that of steady motion at the mean speed"
    ),
    "nonuniformity": Quantity("speed non-uniformity in the working phase", "1"),
    "dynamic_amplification": Quantity(
        "dynamic amplification", "1", definition="peak drive force over that of a rigid drive with the same law"
    ),
}
RUN = {  # further results of a run with a compliant, hydraulic or motor drive
    "stick_time": Quantity("stick time", "s"),
    "fluctuation": Quantity("coefficient of speed fluctuation", "1"),
    "peak_pressure": Quantity("peak oil pressure", "Pa", "kPa"),
    "peak_flow": Quantity("peak flow rate", "m3/s"),
    "pump_work": Quantity("pump work per cycle", "J"),
    "throttle_heat": Quantity("heat of the throttles per cycle", "J"),
    "relief_heat": Quantity("heat of the relief valve per cycle", "J"),
    "peak_motor_power": Quantity("peak motor power", "W"),
    "energy_residual": WORK_RESIDUAL,
    "unsteady_share": Quantity("share of the cycle beyond first order in the acceleration", "1"),
}
ROLLER_MOTOR = {  # requirements of a law on the motor in a roller
    "peak_torque": Quantity("peak torque", "Nm"),
    "peak_power": Quantity("peak power", "W"),
    "peak_creep": Quantity("peak creepage", "1"),
    "share": Quantity("share of the friction limit", "1"),
}
MOTION = {  # time histories of a cycle
    "time": TIME,
    "position": Quantity("travel", "m", symbol="x"),
    "velocity": Quantity("velocity", "m/s", symbol="v"),
    "acceleration": Quantity("acceleration", "m/s2", symbol="a"),
    "jerk": Quantity("jerk", "m/s3"),
    "drive_force": Quantity("drive force along the motion", "N", "kN"),
    "drive_power": Quantity("drive power", "W"),
    "guide_reaction": Quantity("guide-wheel reaction", "N", "kN"),
    "crank_angle": Quantity("crank angle", "rad", "°"),
    "shaft_torque": Quantity("shaft torque", "N m", "kN m"),
    "shaft_power": Quantity("shaft power", "W", "kW"),
    "cart_resistance": Quantity("resistance of one cart", "N", "kN", "F"),
    "added_mass": Quantity("added mass", "kg", symbol="M"),
}
FIELD = {  # fields in the layer and on its surface
    "position": Quantity("position x from the lowest generatrix", "m", "mm"),
    "travel_position": Quantity("position x from the lowest generatrix, positive along the travel", "m", "mm"),
    "height": Quantity("height", "m", "mm", "y"),
    "contact_stress": Quantity("contact stress", "Pa", "kPa"),
    "pressure": Quantity("mean pressure", "Pa", "kPa"),
    "dissipation": Quantity("dissipation", "W/m3", "kW/m³"),
    "density_ratio": Quantity("density ratio", "1", symbol="k"),
    "plastic_work": Quantity("plastic work", "J/m3", "kJ/m³"),
    "air_pressure": Quantity("excess pressure of pore air", "Pa", "kPa"),
}
PROCESS = {  # results of a forming process along one roller
    "load": Quantity("load on one roller, a lower estimate", "N", "kN", "P"),
    "resistance": Quantity("resistance of one roller, confined compression alone", "N", "kN", "F"),
    "confined_floor": Quantity("confined floor of the resistance", "N", "kN", definition="closed form, not for sizing"),
    "load_centre": Quantity("centre of the load from the empty mould", "m"),
    "skew_moment": Quantity("skew moment of the load about the middle of the roller", "Nm"),
    "load_unevenness": Quantity("largest over mean load per roller length", "1"),
    "peak_pressure": PEAK_PRESSURE,
    "strokes": Quantity("strokes on a section", "1", symbol="N"),
    "largest_bite": Quantity("largest bite", "m", "mm"),
    "bite_limit": Quantity("bite at the nip angle", "m", "mm"),
    "product_height": Quantity("height of the product", "m", "mm"),
    "product_density_ratio": Quantity("density ratio of the product", "1", symbol="k"),
    "bottom_density_ratio": Quantity("density ratio of the bottom quarter", "1", symbol="k"),
    "top_density_ratio": Quantity("density ratio of the top quarter", "1", symbol="k"),
    "overpressed_height": Quantity("height with a density ratio above 1", "m", "mm"),
    "confined_work": Quantity("work of confined compression per volume of the product", "J/m3", "kJ/m³"),
    "strokes_for_density": Quantity("strokes until the required density ratio", "1"),
    "fastest_mould": Quantity("fastest mould for the required density ratio", "m/s"),
    "least_strokes": Quantity("least strokes for the required density ratio", "1"),
    "rate_factor": Quantity("factor of the yield pressure by the rate of compaction", "1"),
    "mass_residual": MASS_RESIDUAL,
    "work_residual": WORK_RESIDUAL,
}
STROKE = {  # one stroke on a section, per unit roller length
    "position": Quantity("position along the roller, from the empty mould", "m", symbol="z"),
    "make_up": Quantity("make-up", "m", "mm"),
    "bite": Quantity("bite", "m", "mm"),
    "load": CONTACT["load"],
    "resistance": CONTACT["resistance"],
    "peak_pressure": PEAK_PRESSURE,
    "leading": CONTACT["leading"],
    "trailing": CONTACT["trailing"],
    "surface": Quantity("height behind the roller", "m", "mm"),
    "density_ratio": Quantity("mean density ratio behind the roller", "1", symbol="k"),
}
INPUT = {  # inputs that sweeps and sensitivities vary
    "moisture": Quantity("moisture content", "1", symbol="W"),
    "density_ratio": Quantity("target density ratio", "1", symbol="k"),
    "machine.roller_length": Quantity("roller length", "m"),
    "machine.roller_friction": Quantity("roller friction", "1"),
    "machine.bearing_friction": Quantity("bearing friction", "1"),
    "machine.guide_friction": Quantity("guide friction", "1"),
    "machine.mass": Quantity("cart mass", "kg"),
    "motion.duration": Quantity("duration of a stroke", "s"),
    "layer.fed_density_ratio": Quantity("initial density ratio", "1"),
}
