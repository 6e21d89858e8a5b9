"""Loads of a roller by formula: engineering method (1.1)-(1.10), half-plane contact and dry friction.

Entry point that collects the formulas of `engines.formula`, `engines.halfplane`, `machine.sizing` and `resistance`.
"""

from compact.engines.formula import (
    capture_angle,
    contact_length,
    pressure_for_load,
    roll,
    roller_force,
    roller_resistance,
)
from compact.engines.halfplane import LineContact, galin, hertz, pressure_exponent
from compact.machine.sizing import (
    RadiusRange,
    cart_power,
    cart_resistance,
    guide_coefficient,
    radius_range,
    rollers_needed,
    stroke_needed,
)
from compact.resistance import DryResistance, dry_resistance

__all__ = [
    "DryResistance",
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
