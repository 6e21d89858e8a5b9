"""The refusals of a scene: changes of it, and words of the mistake, which is reported at the line of their key.

A new bound or rule is one row here. "…" stands for words left out.
"""

import math
from typing import Any

from drive_tables import MOTOR

BELT = {"pulley_radius": 0.1, "stiffness": 9000.0, "preload": 500.0, "friction": 0.4, "wrap": 3.0}
SPRINGS = {"stiffness": 5000.0, "preload": 200.0, "length": 0.3}
OPTIMISE = {"objectives": ["peak_force"], "smoothness": 1}
CAP, COLUMN = {"mix.law": "drucker-prager-cap"}, {"accuracy.engine": "column"}
FEM, SPECTRAL = {"accuracy.engine": "fem"}, {"accuracy.engine": "spectral"}
NO_CLOSURE = {"process.product_density_ratio": None}
PLAIN = {"motion.laws": ["cubic"], "drive.kind": "rigid", "output.items": [], "motion.rod_length": None}


def table(name: str, keys: dict[str, Any], **others: Any) -> dict[str, Any]:
    """Changes that give a table."""
    return {f"{name}.{key}": value for key, value in (keys | others).items()}


def plies(thickness: Any = 0.06, modulus: Any = 2.0, engine: str = "fem", name: str = "relative_modulus") -> Any:
    """Changes that give two plies of a layer of 0.22 m."""
    bottom, top = {"thickness": 0.16, "relative_modulus": modulus}, {"thickness": thickness, name: 1.0}
    return {"layer.plies": [bottom, top], "accuracy.engine": engine}


def lift(thickness: Any = 0.06, density_ratio: Any = 0.98, engine: str = "column", **others: Any) -> dict[str, Any]:
    """Changes that give a lower lift."""
    keys = {"thickness": thickness, "density_ratio": density_ratio}
    return table("layer.lower_lift", keys, **others) | {"accuracy.engine": engine}


BOUNDS = [  # of the published scene: types and bounds of single keys
    ({"machine.roller_radius": -0.11}, "machine.roller_radius: must be positive, got -0.11; give the radius in"),
    ({"machine.weight": math.nan}, "machine.weight: must be a finite number, got nan; give the weight G of the cart i"),
    ({"product.height": "0.22"}, "product.height: must be a number, got '0.22'; …, without quotes, decimal comma or"),
    ({"machine.mass": None}, "machine.mass: is missing; give the mass m of the cart in kg"),
    ({"drive.carts": 5}, "drive.carts: must be less than or equal to 4, got 5; give the number of carts on one shaft"),
    ({"machine.sleeve_distance": [0.1, -0.1]}, "machine.sleeve_distance[1]: must be greater than or equal to 0, got"),
    ({"drive.turn": "stp"}, 'drive.turn: must be "build-up", "step" or rows of an ascending travel and a share from'),
    ({"machine.one_sided": 0}, "machine.one_sided: must be true or false, got 0; give true for contact on the front"),
    ({"machine.guide_friction": 8}, "machine.guide_friction: must be less than or equal to 1, got 8; give the Coulomb"),
    ({"mix.moisture": 10}, "mix.moisture: must be less than or equal to 0.12, got 10; give the moisture W as water ma"),
    ({"mix.overrides.poisson": 0.5}, "mix.overrides.poisson: must be less than 0.5, got 0.5; give Poisson's ratio"),
    ({"mix.fitted_at.parameters": ["heckel_slop"]}, "mix.fitted_at.parameters[0]: …did you mean 'heckel_slope'?"),
    ({"layer.base": "bonder"}, "layer.base: must be 'bonded' or 'slip', got 'bonder'; did you mean 'bonded'?"),
    ({"motion.laws": ["cubic", "cubik"]}, "motion.laws[1]: must be 'constant-velocity', 'cubic', 'quintic', 'septic',"),
    ({"motion.laws": "all"}, "motion.laws: must be a list, got 'all'; give the laws to compare…in square brackets"),
    (plies(modulus="hard"), "layer.plies[0].relative_modulus: must be a number, got 'hard'; give the moduli"),
    (plies(name="relative_modulu"), "layer.plies[1].relative_modulu: unknown key in [layer.plies], got 1.0; did you"),
    (lift(density_ratio=None), "layer.lower_lift.density_ratio: is missing; give"),
]
NAMES = [  # unknown and missing tables and keys
    ({"machine": None}, "machine: the table [machine] is missing; add it with its keys (`compact new DIR` writes"),
    ({"machin.mass": 1.0}, "machin: unknown table at the top of the file, before any table, …did you mean `machine`?"),
    ({"machine.roler_radius": 0.11}, "machine.roler_radius: unknown key in [machine], … did you mean `roller_radius`"),
    ({"machine.stroke": 0.4}, "machine.stroke: unknown key in [machine], got 0.4; `stroke` belongs in [motion]"),
    ({"stroke": 0.4}, "stroke: unknown key at the top of the file, before any table, got 0.4; `stroke` belongs in"),
    ({"machine.title": "x"}, "machine.title: unknown key in [machine], got 'x'; `title` belongs at the top of the"),
    ({"product.zzz": 1}, "product.zzz: unknown key in [product], got 1; take it out, or choose from height, width,"),
]
CALLS = [  # changes that no line of a file makes
    ({"product": 3}, "product: must be a table, got 3; write [product] on a line of its own"),
    ({"machine": {1: 2.0}}, "machine: must have texts as keys, got 1"),
    ({"title.line": "x"}, "title.line: `title` is no table, so it has no key `line`"),
]
RULES = [  # between the keys
    ({"machine.roller_positions": [0.5, 0.0, -0.5]}, "machine.roller_positions: needs one entry for each of machine.r"),
    ({"machine.roller_positions": [0.1, -0.1]}, "machine.roller_positions: rollers overlap: … = 0.22 m apart, got 0.2"),
    ({"motion.stroke": 0.39}, "machine.roller_radius: must be at most (motion.stroke - machine.feeder_sleeve) / 2 = 0"),
    ({"machine.guide_positions": [-0.37, 0.37]}, "machine.guide_positions: front must be greater than rear, got [-"),
    ({"machine.journal_diameter": 0.046}, "machine.journal_diameter: must be below machine.guide_wheel_diameter ="),
    ({"layer.fed_density_ratio": 0.98}, "layer.fed_density_ratio: must be below mix.density_ratio = 0.98, got 0.98"),
    ({"mix.overrides.saturation_limit": 0.98}, "mix.density_ratio: must be below mix.overrides.saturation_limit = 0.9"),
    ({"motion.energy_weight": 0.8}, "motion.energy_weight: must be at most 1 - motion.acceleration_weight = 0.7, got"),
    ({"motion.rod_length": 0.2}, "motion.rod_length: must be above motion.stroke / 2 = 0.2 m, got 0.2; give a longer"),
    ({"motion.rod_length": None}, "motion.rod_length: is missing for the crank of motion.laws and output.items; give"),
    (PLAIN | {"motion.laws": ["crank"]}, "motion.rod_length: is missing for the crank of motion.laws; give the length"),
    ({"drive.stiffness": 1e6}, 'drive.stiffness: is for drive.kind = "elastic", got it with "rigid"; take it out, or'),
    ({"drive.kind": "elastic"}, 'drive.stiffness: is missing, and drive.kind is "elastic"; give it in N/m'),
    ({"drive.kind": "motor"}, 'drive.motor: is missing, and drive.kind is "motor"; give the table with curve, gear an'),
    (table("drive.motor", MOTOR), 'drive.motor: is for drive.kind = "motor", got it with "rigid"; take it out, or cho'),
    (table("drive.motor", MOTOR, curve="linear"), 'drive.motor.breakdown_slip: is for drive.motor.curve = "kloss", go'),
    (table("drive.motor", MOTOR, belt=BELT), "drive.motor.belt.stiffness: must be at least 20 * drive.motor.belt.prel"),
    (table("drive.end_springs", SPRINGS), "drive.end_springs.length: must be at most motion.stroke / 2 = 0.2 m, got 0"),
    ({"drive.angles": [0, 1.57]}, "drive.angles: needs one entry for each of drive.carts = 1, got 2; make the two agr"),
    ({"cam": None}, 'cam: the table [cam] is missing, and output.items holds "cams"; give it, or take "cams" out'),
    ({"cam.breadth": 0.4}, "cam.breadth: must be above motion.stroke = 0.4 m, got 0.4; give a broader cam"),
    ({"cam": None, "motion.optimise": OPTIMISE | {"pressure_angle": 0.7}}, "motion.optimise.pressure_angle: needs c"),
    ({"machine.roller_torque": 5.0, "machine.roller_condition": "sliding"}, "machine.roller_torque: is for machine."),
    ({"machine.roller_torque": 5.0}, "machine.roller_torque: must not be positive for a …, which bearings only brake"),
    (FEM | {"machine.roller_condition": "driven"}, "machine.roller_torque: is missing, and the engine … rolls a"),
    ({"contact.indentation": 0.22}, "contact.indentation: must be below (layer.lift_thickness or product.height) = 0."),
    ({"layer.lift_thickness": 0.3}, "layer.lift_thickness: must be at most product.height = 0.22 m, got 0.3; without"),
    ({"output.items": ["fields"]}, 'output.items: holds "fields", which … does not compute; take it out, or choose'),
    ({"motion.laws": ["cubic", "crank", "cubic"]}, "motion.laws: must not repeat an entry, got 'cubic' more than"),
    ({"motion.laws": ["all", "cubic"]}, 'motion.laws: "all" already holds every law, got it with others; write ["al'),
    ({"motion.tables": ["no.csv"]}, "motion.tables: no such file: 'no.csv' under …; give CSV files relative to"),
    (plies(0.05), "layer.plies: must be as thick together as the layer, 0.22 m, got 0.21; change one thickness"),
    (CAP | {"mix.overrides.friction_angle": 46.0}, "mix.overrides.earth_pressure_coefficient: … must be between 0.2"),
    (CAP | {"mix.overrides.earth_pressure_coefficient": 0.3}, "mix.overrides.earth_pressure_coefficient: … must be"),
]
ENGINES = [  # values that the engine of a scene does not accept
    ({"layer.passes": 2}, 'layer.passes: the engine "formula" takes no passes of 2, as an elastic layer keeps no tr'),
    (plies(engine="formula"), 'layer.plies: the engine "formula" takes no 2 plies, as it has one modulus for the'),
    (lift(engine="formula"), 'layer.lower_lift: … take the key out, or choose accuracy.engine = "column" or "comp'),
    (SPECTRAL | {"machine.gap_geometry": "deformed"}, 'machine.gap_geometry: the engine "spectral" takes no "def'),
    (COLUMN | {"machine.roller_condition": "sliding"}, 'machine.roller_condition: the engine "column" takes no "'),
    (COLUMN | {"layer.base": "slip"}, 'layer.base: the engine "column" takes no "slip", as mix on a slipping bas'),
]
UNITS = [  # values in other units; a guess states the unit
    ({"mix.overrides.required_pressure": 203}, "mix.overrides.required_pressure: 203 Pa is far outside … was 203 kPa"),
    ({"mix.overrides.heckel_slope": 13.0}, "mix.overrides.heckel_slope: … was 13 1/MPa = 1.3e-05 1/Pa meant?"),
    ({"mix.overrides.friction_angle": 0.61}, "mix.overrides.friction_angle: … was 0.61 rad = 34.9504 deg meant?"),
    ({"product.height": 220.0}, "product.height: … was 220 mm = 0.22 m meant?"),
    ({"machine.mass": 0.5}, "machine.mass: … was 0.5 t = 500 kg meant?"),
    ({"contact.speeds": [130.0]}, "contact.speeds: … was 130 mm/s = 0.13 m/s meant?"),
    (COLUMN | {"layer.passes": 130_400, "unusual": ["layer.passes"]}, "layer.passes: must be less than or equal to 10"),
    (plies(0.02, 1e6), "layer.plies.relative_modulus: 1e+06 is far outside the plausible 0.001 to 1000"),
    ({"unusual": ["mix.overrides.heckel_slop"]}, "unusual: holds … did you mean 'mix.overrides.heckel_slope'?"),
    ({"unusual": ["mix.moisture"]}, "unusual: holds 'mix.moisture', which is no key with a plausible range"),
    ({"compare.column.mix.overrides.heckel_slope": 13.0}, "compare.column: with it mix.overrides.heckel_slope: 13 1/"),
]
PROCESS = [  # of the process scene
    ({"process.kneading": [0.5, 0.7]}, "process.kneading: needs a static mix.overrides.heckel_slope: that of the pr"),
    ({"process.plate_pressure": None}, "process.plate_length: needs process.plate_pressure, which is missing; give"),
    ({"process.gap": 0.001}, "process.gap: only one of gap, product_density_ratio and extrusion_pressure can be pre"),
    ({"process.mould_speed": 0.0}, "process.mould_speed: is 0, and process.strokes is missing; give the number"),
    ({"process.strokes": 4}, "process.mould_speed: is 0.0175 m/s, which determines the number of strokes, got process"),
    ({"process.mould_speed": 1.5}, "process.mould_speed: must be at most machine.roller_length / (motion.duration + m"),
    ({"process.mould_speed": 1e-05, "unusual": ["process.mould_speed"]}, "process.mould_speed: must be at least mac"),
    ({"product.mould_speed": 0.02}, "process.mould_speed: must be equal to product.mould_speed = 0.02 m/s, got"),
    ({"process.fill_height": 0.2}, "process.fill_height: needs process.fill_density_ratio, which is missing; give it,"),
    ({"process.fill_height": 0.23, "process.fill_density_ratio": 0.75}, "process.fill_height: must be at most prod"),
    (NO_CLOSURE | {"process.gap": 0.007}, "process.gap: must be at most machine.roller_radius * (1 - cos(process.nip_"),
    (NO_CLOSURE | {"process.gap": 0.001, "process.feed": "even"}, 'process.gap: is for process.feed = "room", got it'),
    ({"process.product_density_ratio": 0.74}, "process.product_density_ratio: must be above max(process.feed_density_"),
    ({"process.feed": "first"}, 'process.feed_count: is missing, and process.feed is "first"; give the number of f'),
    ({"process.feed_count": 3}, 'process.feed_count: is for process.feed = "first", got it with "room"; take it out,'),
    ({"process.offered_thickness": 0.001}, "process.offered_thickness: only one of offered_thickness and "),
    ({"process": None}, "sleeve: needs process, which is missing; give it, or take the key out"),
]
