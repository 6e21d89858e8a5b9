"""Loads of a roller by formula: engineering method (1.1)-(1.10), half-plane contact and dry friction.

Entry point that collects the formulas of `engines.formula`, `engines.halfplane`, `machine.sizing` and `resistance`.
"""

from compact.engines.formula import capture_angle as capture_angle
from compact.engines.formula import contact_length as contact_length
from compact.engines.formula import pressure_for_load as pressure_for_load
from compact.engines.formula import roll as roll
from compact.engines.formula import roller_force as roller_force
from compact.engines.formula import roller_resistance as roller_resistance
from compact.engines.halfplane import LineContact as LineContact
from compact.engines.halfplane import galin as galin
from compact.engines.halfplane import hertz as hertz
from compact.engines.halfplane import pressure_exponent as pressure_exponent
from compact.machine.sizing import RadiusRange as RadiusRange
from compact.machine.sizing import cart_power as cart_power
from compact.machine.sizing import cart_resistance as cart_resistance
from compact.machine.sizing import guide_coefficient as guide_coefficient
from compact.machine.sizing import radius_range as radius_range
from compact.machine.sizing import rollers_needed as rollers_needed
from compact.machine.sizing import stroke_needed as stroke_needed
from compact.resistance import DryResistance as DryResistance
from compact.resistance import dry_resistance as dry_resistance
