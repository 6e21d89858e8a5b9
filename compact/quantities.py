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
    "W/m3": "W/m³", "J/m3": "J/m³", "Nm": "N m", "m2/s": "m²/s", "m2/s3": "m²/s³", "m2/s5": "m²/s⁵", "m2/s7": "m²/s⁷",
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


def column_names(quantities: Mapping[str, Quantity]) -> tuple[str, ...]:
    """Names of columns of a CSV file: field and SI unit, `load_N/m`; the field alone for a number or a word."""
    return tuple(name if each.unit in ("", "1") else f"{name}_{each.unit}" for name, each in quantities.items())


def _table(rows: str) -> dict[str, Quantity]:
    """Quantities by the name of their field, from rows of name, unit, unit of plots, symbol, term, and definition."""
    cells = ([cell.strip() for cell in row.split("|")] for row in rows.strip().split("\n"))
    return {
        name: Quantity(term, unit, plot_unit, symbol, *definition)
        for name, unit, plot_unit, symbol, term, *definition in cells
    }


# Fields of a contact of one roller, per unit length of the roller
CONTACT = _table("""
    speed                     | m/s |      | v | speed
    load                      | N/m | kN/m | P | load
    resistance                | N/m | kN/m |   | rolling resistance
    coefficient               | 1   |      |   | rolling-resistance coefficient | resistance over load
    leading                   | m   | mm   |   | leading edge
    trailing                  | m   | mm   |   | trailing edge
    peak_pressure             | Pa  | kPa  |   | peak contact pressure
    indentation               | m   | mm   |   | indentation
    creep                     | 1   |      |   | creepage
    work_residual             | 1   |      |   | energy-balance residual | relative residual
    bow_wave                  | m   | mm   | w | bow wave | rise of the surface ahead above the fed layer
    exit_density_ratio        | 1   |      | k | exit density ratio
    exit_height               | m   | mm   |   | exit height
    lower_height              | m   | mm   |   | height of the lower lift
    lower_density_ratio       | 1   |      | k | density ratio of the lower lift
    peak_density_ratio        | 1   |      | k | peak density ratio | at rest
    peak_loaded_density_ratio | 1   |      |   | peak density ratio under load | k exp(p/K), with elastic compression
    overdense_work            | 1   |      |   | plastic work beyond the pressure curve over all of it
    overfull_share            | 1   |      |   | section beyond full density | share between the edges, k exp(p/K) > 1
    density_reset             | 1   |      |   | density reset | largest log of density by volume over interpolated
    mass_residual             | 1   |      |   | mass-balance residual | relative, of compacting layers only
    yield_residual            | 1   |      |   | yield-condition residual
    equilibrium_residual      | 1   |      |   | equilibrium residual
    air_load                  | N/m | kN/m |   | load by pore air
    air_resistance            | N/m | kN/m |   | rolling resistance by pore air
    air_excess_behind         | Pa  | kPa  |   | largest excess pressure of pore air behind the contact
""")
SPEED = CONTACT["speed"]


def _of(table: Mapping[str, Quantity], names: str) -> dict[str, Quantity]:
    """Quantities of a record that has fields of another one."""
    return {name: table[name] for name in names.split()}


# Fields of one pass over a compacting layer
PASS = _of(CONTACT, "load resistance indentation exit_height exit_density_ratio work_residual mass_residual")
# Fields of the engineering formulas 1.1-1.10 and of Galin's exact contact
FORMULA = _table("""
    pressure               | Pa  | kPa |   | peak contact pressure
    exponent               | 1   |     | α | pressure exponent
    capture_angle          | rad | °   | φ | contact angle
    roller_force           | N   | kN  |   | load on one roller
    contact_length         | m   | mm  |   | contact length | contact length: from trailing to leading edge
    roller_resistance      | N   | kN  |   | rolling resistance of one roller
    resistance_coefficient | 1   |     |   | rolling-resistance coefficient | resistance over load
    cart_resistance        | N   | kN  |   | resistance of one cart
    guide_coefficient      | 1   |     |   | friction coefficient of the guide wheels
    cart_power             | W   |     |   | power of one cart
    radius_low             | m   | mm  |   | least roller radius
    radius_high            | m   | mm  |   | largest roller radius
    rollers_needed         | 1   |     |   | required number of rollers
    stroke_needed          | m   |     |   | required stroke
""")
FORMULA |= {f"exact_{name}": FORMULA[name] for name in ("capture_angle", "roller_force", "contact_length")}
# Numbers of one point of a sweep
SWEEP_POINT = _table("""
    load                   | N   | kN  |   | load on one roller | normal force on one roller
    resistance             | N   | kN  |   | resistance of one cart | rolling resistance of all rollers of one cart
    resistance_coefficient | 1   |     |   | rolling-resistance coefficient | resistance over load
    power                  | W   |     |   | power at the mean speed | resistance of one cart times the mean speed
    capture_angle          | rad | °   | φ | contact angle | entry angle, from the lowest generatrix
    contact_length         | m   | mm  |   | contact length | from the trailing to the leading edge; eq 1.7 by formula
    exit_density_ratio     | 1   |     | k | exit density ratio | mean behind the last pass, of compacting layers
    load_error             | 1   |     |   | relative error estimate of the load
    resistance_error       | 1   |     |   | relative error estimate of the resistance
    required_pressure      | Pa  | kPa |   | required pressure | pressure at which the mix reaches its density ratio
    saturation             | 1   |     |   | degree of saturation | share of the pore volume filled with water
""") | _of(CONTACT, "peak_pressure work_residual mass_residual")
# Further numbers of a point of a sweep by columns that finite elements correct
SWEEP_CORRECTION = _table("""
    load_factor              | 1 |  |   | load over that of columns
    resistance_factor        | 1 |  |   | resistance over that of columns
    load_surface_error       | 1 |  |   | error of the load by interpolation | twice its rms leave-one-out error
    resistance_surface_error | 1 |  |   | error of the resistance by interpolation | twice its rms leave-one-out error
""")
# Criteria by which laws are ranked
CRITERIA = _table("""
    peak_force            | N     | kN |   | peak drive force
    peak_power            | W     |    |   | peak drive power
    rms_force             | N     | kN |   | rms drive force
    rms_power             | W     |    |   | rms drive power
    mean_force            | N     | kN |   | mean drive force
    mean_power            | W     |    |   | mean drive power
    energy                | J     |    |   | energy per cycle
    drawn_energy          | J     |    |   | energy drawn per cycle
    peak_jerk             | m/s^3 |    |   | peak jerk
    dynamic_factor        | 1     |    |   | dynamic factor | peak drive force over that at the mean speed
    nonuniformity         | 1     |    |   | speed non-uniformity in the working phase
    dynamic_amplification | 1     |    |   | dynamic amplification | peak drive force over that of a rigid drive
    squared_velocity      | m2/s  |    | J₁ | integral of squared velocity | of the law, over a pass
    squared_acceleration  | m2/s3 |    | J₂ | integral of squared acceleration | of the law, over a pass
    squared_jerk          | m2/s5 |    | J₃ | integral of squared jerk | of the law, over a pass
    squared_snap          | m2/s7 |    | J₄ | integral of squared snap | of the law, over a pass
""")
# Further results of a run with a compliant, hydraulic or motor drive
RUN = _table("""
    stick_time       | s    |     |   | stick time
    fluctuation      | 1    |     |   | coefficient of speed fluctuation
    peak_pressure    | Pa   | kPa |   | peak oil pressure
    peak_flow        | m3/s |     |   | peak flow rate
    pump_work        | J    |     |   | pump work per cycle
    throttle_heat    | J    |     |   | heat of the throttles per cycle
    relief_heat      | J    |     |   | heat of the relief valve per cycle
    peak_motor_power | W    |     |   | peak motor power
    energy_residual  | 1    |     |   | energy-balance residual | relative residual
    unsteady_share   | 1    |     |   | share of the cycle beyond first order in the acceleration
""")
# Time histories of a cycle
MOTION = _table("""
    time            | s    |      | t | time
    position        | m    |      | x | travel
    cart_resistance | N    | kN   | F | resistance of one cart
    added_mass      | kg   |      | M | added mass
""")
TIME = MOTION["time"]
# Fields in the layer and on its surface
FIELD = _table("""
    position            | m    | mm    |   | position x from the lowest generatrix
    travel_position     | m    | mm    |   | position x from the lowest generatrix, positive along the travel
    height              | m    | mm    | y | height
    contact_stress      | Pa   | kPa   |   | contact stress
    pressure            | Pa   | kPa   |   | mean pressure
    dissipation         | W/m3 | kW/m³ |   | dissipation
    density_ratio       | 1    |       | k | density ratio | at rest
    density_under_load  | 1    |       |   | density ratio under load | k exp(p/K), with elastic compression
    saturation_pressure | Pa   | kPa   | u | saturation reaction | keeps k at the saturation limit; no water pressure
    plastic_work        | J/m3 | kJ/m³ |   | plastic work
    air_pressure        | Pa   | kPa   |   | excess pressure of pore air
""")
# Results of a forming process along one roller
PROCESS = _table("""
    load                  | N    | kN    | P | load on one roller, a lower estimate
    resistance            | N    | kN    | F | resistance of one roller, confined compression alone
    confined_floor        | N    | kN    |   | confined floor of the resistance | closed form, not for sizing
    load_centre           | m    |       |   | centre of the load from the empty mould
    skew_moment           | Nm   |       |   | skew moment of the load about the middle of the roller
    load_unevenness       | 1    |       |   | largest over mean load per roller length
    strokes               | 1    |       | N | strokes on a section
    largest_bite          | m    | mm    |   | largest bite
    bite_limit            | m    | mm    |   | bite at the nip angle
    product_height        | m    | mm    |   | height of the product
    product_density_ratio | 1    |       | k | density ratio of the product
    confined_work         | J/m3 | kJ/m³ |   | work of confined compression per volume of the product
    rate_factor           | 1    |       |   | factor of the yield pressure by the rate of compaction
""") | _of(CONTACT, "peak_pressure work_residual mass_residual")
# Further results of lumped lifts in two dimensions
PROCESS_LIFTS = (
    _table("""
    specific_work         | J/m3 | kJ/m³ |   | work per volume of the product
    middle_density_ratio  | 1    |       | k | density ratio of the middle quarter
    bottom_density_ratio  | 1    |       | k | density ratio of the bottom quarter
    top_density_ratio     | 1    |       | k | density ratio of the top quarter
    saturated_height      | m    | mm    |   | height with a density ratio above 0.99
    surface               | m    | mm    |   | height behind the roller
    gyrations             | 1    |       | n | gyrations of a compactor with the same shear work over pressure
    largest_work_residual | 1    |       |   | largest energy-balance residual of a pass
""")
    | _of(PROCESS, "load_centre skew_moment")
    | _of(CONTACT, "air_excess_behind")
)
# One stroke on a section, per unit roller length
STROKE = _table("""
    position      | m   |      | z | position along the roller, from the empty mould
    make_up       | m   | mm   |   | make-up
    bite          | m   | mm   |   | bite
    surface       | m   | mm   |   | height behind the roller
    density_ratio | 1   |      | k | mean density ratio behind the roller
""") | _of(CONTACT, "load resistance peak_pressure leading trailing")
