"""The refusals of a scene: changes of it, and words of the mistake, which is reported at the line of their key.

A new bound or rule is one row here. "…" stands for words left out.
"""

import datetime
import math
from typing import Any

HUGE = 10**400
BELT = {"pulley_radius": 0.1, "stiffness": 9000.0, "preload": 500.0, "friction": 0.4, "wrap": 3.0}
MOTOR = {
    "curve": "kloss", "torque": 40.0, "speed": 157.0, "breakdown_slip": 0.15, "gear_ratio": 150.0, "inertia": 0.01,
    "flywheel_inertia": 50.0,
}  # fmt: skip
HYDRAULICS = {
    "piston_area": 1e-3, "supply_pressure": 8e6, "pump_flow": 5e-4, "valve_area": 2e-5, "discharge_coefficient": 0.62,
    "oil_density": 870.0, "transition_drop": 1e3, "bulk_modulus": 1.4e9, "dead_volume": 1e-4,
}  # fmt: skip
SPRINGS = {"stiffness": 5000.0, "preload": 200.0, "length": 0.3}
OPTIMISE = {"objectives": ["peak_force"], "smoothness": 1}
ELASTIC = {"drive.kind": "elastic", "drive.damping": 0.0}
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


def feed(position: float, thickness: float) -> dict[str, Any]:
    """Changes that give a table of the feed."""
    return {"process.feed": "table", "process.feed_table": [{"position": position, "relative_thickness": thickness}]}


BOUNDS = [  # of the published scene: types and bounds of single keys
    ({"machine.roller_radius": -0.11}, "machine.roller_radius: must be positive, got -0.11; give the radius in m"),
    ({"machine.mass": 0}, "machine.mass: must be positive, got 0; give the mass m of the cart in kg"),
    ({"machine.weight": math.nan}, "machine.weight: must be finite, got nan; give the weight G"),
    ({"machine.pin_height": math.inf}, "machine.pin_height: must be finite, got inf; give the height"),
    ({"product.height": "0.22"}, "product.height: must be a number, got '0.22'; …, without quotes, decimal comma or"),
    ({"machine.mass": True}, "machine.mass: must be a number, got true; give the mass"),
    ({"machine.rollers": True}, "machine.rollers: must be a whole number, got true; give the number of rollers"),
    ({"machine.mass": datetime.date(2015, 1, 1)}, "machine.mass: must be a number, got the time 2015-01-01; give"),
    ({"machine.mass": {"a": 1}}, "machine.mass: must be a number, got a table; give the mass"),
    ({"machine.mass": HUGE}, "machine.mass: must be finite and below 1.8e308, got 1000…0…; give the mass m of"),
    ({"machine.mass": None}, "machine.mass: is missing; give the mass m of the cart in kg"),
    ({"layer.passes": 2.0}, "layer.passes: must be a whole number, got 2.0; … without a decimal point"),
    ({"machine.rollers": 0}, "machine.rollers: must be between 1 and 1000000, got 0; give the number"),
    ({"drive.carts": 5}, "drive.carts: must be between 1 and 4, got 5; give the number of carts"),
    ({"machine.one_sided": 0}, "machine.one_sided: must be true or false, got 0; give true for contact on the front"),
    ({"title": 3}, "title: must be a text in quotes, got 3; give a title in quotes"),
    ({"machine.guide_friction": 8}, "machine.guide_friction: must be between 0 and 1, got 8; give the Coulomb coef"),
    ({"machine.rolling_arm": -1e-09}, "machine.rolling_arm: must be zero or positive, got -1e-09; give the rolling"),
    ({"machine.rib_factor": 0.9}, "machine.rib_factor: must be at least 1, got 0.9; give the factor f5"),
    ({"mix.moisture": 10}, "mix.moisture: must be between 0.08 and 0.12, got 10; … 0.10 for 10 %"),
    ({"mix.density_ratio": 0.995}, "mix.density_ratio: must be between 0.9 and 0.99, got 0.995; give the required"),
    ({"mix.density_ratio": 0.89}, "mix.density_ratio: must be between 0.9 and 0.99, got 0.89; give"),
    ({"mix.overrides.poisson": 0.5}, "mix.overrides.poisson: must be at least 0 and below 0.5, got 0.5; give"),
    ({"mix.overrides.effective_modulus": 0.0}, "mix.overrides.effective_modulus: must be positive, got 0.0; give"),
    ({"mix.overrides.instant_over_relaxed": 0.99}, "mix.overrides.instant_over_relaxed: must be at least 1, got 0.99"),
    ({"mix.overrides.friction_angle": 61}, "mix.overrides.friction_angle: must be between 0 and 60, got 61; give"),
    ({"mix.fitted_at.parameters": ["heckel_slop"]}, "mix.fitted_at.parameters[0]: …did you mean 'heckel_slope'?"),
    ({"mix.fitted_at.parameters": ["friction_angle"]}, "mix.fitted_at.parameters[0]: must be one of …friction_angle'"),
    ({"mix.fitted_at.parameters": []}, "mix.fitted_at.parameters: must have at least 1 entry, got 0; give"),
    ({"mix.fitted_at.moisture": 0.2}, "mix.fitted_at.moisture: must be between 0.08 and 0.12, got 0.2; give"),
    ({"layer.fed_density_ratio": 0.72}, "layer.fed_density_ratio: must be above 0.72 and at most 0.99, got 0.72"),
    ({"motion.run_up": 0.6}, "motion.run_up: must be between 1e-06 and 0.5, got 0.6; give the share of the pass"),
    (table("motion.optimise", OPTIMISE, objectives=["noise"]), "motion.optimise.objectives[0]: must be one of …noise'"),
    ({"accuracy.tolerance": 0.5}, "accuracy.tolerance: must be above 0 and below 0.5, got 0.5; give the relative"),
    ({"layer.base": "bonder"}, "layer.base: must be one of bonded, slip, got 'bonder'; did you mean 'bonded'?"),
    ({"accuracy.engine": "x"}, "accuracy.engine: must be one of formula, column, … got 'x'; give the contact engine"),
    ({"accuracy.engine": 1}, "accuracy.engine: must be one of formula, column, … got 1; give the contact engine"),
    ({"motion.laws": ["cubic", "cubik"]}, "motion.laws[1]: must be one of constant-velocity, … did you mean 'cubic'?"),
    ({"output.items": ["tables", "figure"]}, "output.items[1]: must be one of tables, … did you mean 'figures'?"),
    ({"motion.laws": "all"}, "motion.laws: must be a list, got 'all'; give the laws to compare…in square brackets"),
    ({"motion.laws": []}, "motion.laws: must have at least 1 entry, got 0; give the laws to compare"),
    ({"machine.guide_positions": [0.37]}, "machine.guide_positions: must have exactly 2 entries, got 1; give the p"),
    ({"machine.guide_positions": [0.37, True]}, "machine.guide_positions[1]: must be a number, got true; give the"),
    ({"machine.guide_positions": [0.37, "x"]}, "machine.guide_positions[1]: must be a number, got 'x'; give the"),
    ({"contact.load": 0.0}, "contact.load: must be positive, got 0.0; … (zero means no contact)"),
    (ELASTIC | {"drive.stiffness": 0.0}, "drive.stiffness: must be positive, got 0.0; give the stiffness of an"),
    ({"drive.include_added_mass": 1}, "drive.include_added_mass: must be true or false, got 1; give true if the"),
    (plies(-0.06), "layer.plies[1].thickness: must be positive, got -0.06; give the thickness in m"),
    (plies(modulus="hard"), "layer.plies[0].relative_modulus: must be a number, got 'hard'; give the moduli"),
    (plies(modulus=HUGE), "layer.plies[0].relative_modulus: must be finite and below 1.8e308, got 1000"),
    (plies(name="E"), "layer.plies[1].relative_modulus: is missing; give the moduli of the ply"),
    (plies(name="relative_modulu"), "layer.plies[1].relative_modulu: unknown key in [layer.plies], got 1.0; did you"),
    ({"layer.plies": [0.22]}, "layer.plies[0]: must be a table, got 0.22; write { thickness = …, relative_modulus ="),
    ({"layer.plies": 0.22}, "layer.plies: must be a list, got 0.22; give the plies from the base upwards"),
    ({"layer.plies": []}, "layer.plies: must have at least 1 entry, got 0; give the plies"),
    (lift(-0.06), "layer.lower_lift.thickness: must be positive, got -0.06; give"),
    (lift(density_ratio=None), "layer.lower_lift.density_ratio: is missing; give"),
    (lift(residual_stress=1), "layer.lower_lift.residual_stress: must be true or false, got 1; give"),
]
NAMES = [  # unknown and missing tables and keys
    ({"machine": None}, "machine: the table [machine] is missing; add it with its keys (`compact new DIR` writes"),
    ({"machin.mass": 1.0}, "machin: unknown table at the top of the file, before any table, …did you mean `machine`?"),
    ({"other.height": 1}, "other: unknown table at the top of the file, before any table, got a table; take it out"),
    ({"product.x.height": 0.22}, "product.x: unknown table in [product], got a table"),
    ({"machine.roler_radius": 0.11}, "machine.roler_radius: unknown key in [machine], … did you mean `roller_radius`"),
    ({"machine.stroke": 0.4}, "machine.stroke: unknown key in [machine], got 0.4; `stroke` belongs in [motion]"),
    ({"stroke": 0.4}, "stroke: unknown key at the top of the file, before any table, got 0.4; `stroke` belongs in"),
    ({"machine.title": "x"}, "machine.title: unknown key in [machine], got 'x'; `title` belongs at the top of the"),
    ({"machine.stroks": 0.4}, "machine.stroks: unknown key in [machine], got 0.4; did you mean `stroke`, which bel"),
    ({"product.zzz": 1}, "product.zzz: unknown key in [product], got 1; take it out, or choose from height, width,"),
]
CALLS = [  # changes that no line of a file makes
    ({"product": 3}, "product: must be a table, got 3; write [product] on a line of its own, its keys below"),
    ({"product": [{"height": 0.22}]}, "product: must be a table, got [{'height': 0.22}]; write [product] on a line"),
    ({"machine": {1: 2.0}}, "machine: must have texts as keys, got 1"),
    ({"": 1}, ": unknown key at the top of the file, before any table, got 1"),
    ({"title.line": "x"}, "title.line: `title` is no table, so it has no key `line`"),
    ({"machine.roller_positions.0": 0.2}, "machine.roller_positions.0: `machine.roller_positions` is no table, so it"),
]
RULES = [  # between the keys
    ({"machine.roller_positions": [0.5, 0.0, -0.5]}, "machine.roller_positions: needs one position per roller, mach"),
    ({"machine.roller_positions": [0.1, -0.1]}, "machine.roller_positions: rollers overlap: … = 0.22 m apart, got 0.2"),
    ({"motion.stroke": 0.39}, "machine.roller_radius: roller too large for the stroke: … = 0.39 m (eqs 1.2, 1.3), got"),
    ({"machine.roller_radius": 10**308}, "machine.roller_radius: roller too large for the stroke: … got inf"),
    ({"machine.guide_positions": [-0.37, 0.37]}, "machine.guide_positions: front must be greater than rear, got [-"),
    ({"machine.journal_diameter": 0.046}, "machine.journal_diameter: must be below machine.guide_wheel_diameter ="),
    ({"layer.fed_density_ratio": 0.98}, "layer.fed_density_ratio: must be below mix.density_ratio = 0.98, got 0.98"),
    ({"motion.energy_weight": 0.8}, "motion.energy_weight: energy_weight + acceleration_weight must be at most 1, got"),
    ({"motion.rod_length": 0.2}, "motion.rod_length: must be greater than the crank, stroke/2 = 0.2 m, got 0.2; give"),
    ({"motion.rod_length": None}, 'motion.rod_length: is missing, and motion.laws is ["all"], crank included and o'),
    (PLAIN | {"motion.laws": ["crank"]}, "motion.rod_length: is missing, and motion.laws holds …; give the length"),
    (PLAIN | {"drive.kind": "crank"}, "motion.rod_length: is missing, and drive.kind is …; give the length"),
    (PLAIN | {"output.items": ["crank"]}, "motion.rod_length: is missing, and output.items holds …; give the length"),
    ({"drive.stiffness": 1e6}, 'drive.kind: "rigid" has no stiffness; take it out, or choose "elastic"'),
    ({"drive.include_added_mass": True}, 'drive.kind: "rigid" has no include_added_mass; take it out, or choose'),
    ({"drive.kind": "elastic"}, 'drive.kind: "elastic" needs drive.stiffness and drive.damping, got none; give N/m'),
    ({"drive.kind": "motor"}, 'drive.kind: "motor" needs the table [drive.motor], got none; give its curve, gear a'),
    (table("drive.motor", MOTOR), 'drive.kind: "rigid" has no motor; take the table [drive.motor] out, or choose'),
    (table("drive.motor", MOTOR, curve="linear"), 'drive.motor.breakdown_slip: is for drive.motor.curve "kloss", got'),
    (table("drive.motor", MOTOR, belt=BELT), "drive.motor.belt.stiffness: must be at least 20*…preload = 10000 N"),
    (table("drive.end_springs", SPRINGS), "drive.end_springs.length: must be at most half of motion.stroke = 0.4 m"),
    ({"drive.kind": "hydraulic"}, 'drive.kind: "hydraulic" needs the table [drive.hydraulics], got none; give its'),
    (table("drive.hydraulics", HYDRAULICS), 'drive.kind: "rigid" has no hydraulics; take the table …out, or choose'),
    ({"drive.angles": [0, 1.57]}, "drive.angles: needs one angle per cart, drive.carts = 1, got 2; make the two ag"),
    ({"cam": None}, 'cam: the table [cam] is missing, and output.items holds "cams"; give [cam] with breadth and'),
    ({"cam.breadth": 0.4}, "cam.breadth: must be greater than motion.stroke = 0.4 m, got 0.4; give a broader cam"),
    ({"cam": None, "motion.optimise": OPTIMISE | {"pressure_angle": 0.7}}, "motion.optimise: bounds pressure_angle of"),
    ({"machine.roller_torque": 5.0, "machine.roller_condition": "sliding"}, "machine.roller_torque: is for machine."),
    ({"machine.roller_torque": 5.0}, "machine.roller_torque: must not be positive for a …, which bearings only brake"),
    (FEM | {"machine.roller_condition": "driven"}, "machine.roller_torque: is missing, and the engine … rolls a"),
    ({"contact.indentation": 0.22}, "contact.indentation: must be below product.height = 0.22 m, got 0.22; the base"),
    ({"layer.lift_thickness": 0.3}, "layer.lift_thickness: must be at most product.height = 0.22 m, got 0.3; without"),
    ({"layer.lift_thickness": 0.06, "contact.indentation": 0.07}, "contact.indentation: must be below layer.lift_thi"),
    ({"output.items": ["fields"]}, 'output.items: holds "fields", which … does not compute; take it out, or choose'),
    ({"motion.laws": ["cubic", "crank", "cubic"]}, "motion.laws: must not repeat an entry, got 'cubic' more than"),
    (
        {"motion.laws": ["all", "cubic"]},
        'motion.laws: "all" already holds every law, got it with others; write ["all"]',
    ),
    ({"motion.tables": ["no.csv"]}, "motion.tables: no such file: 'no.csv' under …; give CSV files relative to"),
    ({"motion.tables": ["x" * 5000]}, "motion.tables: no such file: 'xxxx"),
    (plies(0.05), "layer.plies: must be product.height = 0.22 m thick together, got 0.21; change one thickness"),
    (plies(10**308), "layer.plies: must be product.height = 0.22 m thick together, got 1e+308; change one"),
    (lift(density_ratio=0.9), "layer.lower_lift.density_ratio: must be above layer.fed_density_ratio = 0.94, got 0.9"),
    (
        CAP | {"mix.overrides.friction_angle": 46.0},
        "mix.overrides.earth_pressure_coefficient: must be between 0.2… 46 ",
    ),
    (CAP | {"mix.overrides.earth_pressure_coefficient": 0.3}, "mix.overrides.earth_pressure_coefficient: must be b"),
    (CAP | {"mix.overrides.dilatancy_angle": 36.0}, "mix.overrides.earth_pressure_coefficient: `dilatancy_angle` must"),
]
ENGINES = [  # values that the engine of a scene does not accept
    ({"layer.passes": 2}, 'layer.passes: the engine "formula" takes no 2 passes, as an elastic layer keeps no trace'),
    (FEM | {"layer.passes": 2}, 'layer.passes: the engine "fem" takes no 2 passes, … "column" or "compaction"'),
    (plies(engine="formula"), 'layer.plies: the engine "formula" takes no 2 plies, … choose accuracy.engine = "spec'),
    (lift(engine="fem"), 'layer.lower_lift: the engine "fem" takes no lower lift, as its layer does not compact'),
    (lift(engine="formula"), 'layer.lower_lift: … take the key out, or choose accuracy.engine = "column" or "comp'),
    (SPECTRAL | {"machine.gap_geometry": "deformed"}, 'machine.gap_geometry: … takes no "deformed", … give "circle"'),
    (SPECTRAL | {"machine.roller_condition": "free"}, 'machine.roller_condition: … takes no "free", … choose acc'),
    (COLUMN | {"machine.roller_condition": "sliding"}, 'machine.roller_condition: … takes no "sliding", as columns'),
    (COLUMN | {"layer.base": "slip"}, 'layer.base: … takes no "slip", … give "bonded"'),
]
UNITS = [  # values in other units; a guess states the unit
    ({"mix.overrides.required_pressure": 203}, "mix.overrides.required_pressure: 203 Pa is far outside … was 203 kPa"),
    ({"mix.overrides.heckel_slope": 13.0}, "mix.overrides.heckel_slope: … was 13 1/MPa = 1.3e-05 1/Pa meant?"),
    ({"mix.overrides.unloading_modulus": 120.0}, "mix.overrides.unloading_modulus: … was 120 MPa = 1.2e+08 Pa meant?"),
    ({"mix.overrides.relaxation_time": 100.0}, "mix.overrides.relaxation_time: … was 100 ms = 0.1 s meant?"),
    ({"mix.overrides.friction_angle": 0.61}, "mix.overrides.friction_angle: … was 0.61 rad = 34.9504 deg meant?"),
    ({"mix.overrides.cohesion": 10.0}, "mix.overrides.cohesion: … was 10 kPa = 10000 Pa meant?"),
    ({"product.height": 1e-12}, "product.height: … give the value in m"),
    ({"product.height": 1000000.0}, "product.height: … was 1e+06 um = 1 m meant?"),
    ({"product.height": 220.0}, "product.height: … was 220 mm = 0.22 m meant?"),
    ({"machine.roller_length": 1164.0}, "machine.roller_length: … was 1164 mm = 1.164 m meant?"),
    ({"machine.mass": 1000000000.0}, "machine.mass: … give the value in kg"),
    ({"machine.mass": 0.5}, "machine.mass: … was 0.5 t = 500 kg meant?"),
    ({"accuracy.tolerance": 1e-30}, "accuracy.tolerance: … give a plain number"),
    ({"contact.speeds": [0.1, 1000000.0]}, "contact.speeds: 1e+06 m/s is far outside"),
    ({"contact.speeds": [130.0]}, "contact.speeds: … was 130 mm/s = 0.13 m/s meant?"),
    ({"contact.load": 1e8}, "contact.load: … give the value in N"),
    ({"contact.peak_pressure": 90.0}, "contact.peak_pressure: … was 90 kPa = 90000 Pa meant?"),
    (lift(60.0), "layer.lower_lift.thickness: 60 m is far outside the plausible 0.005 to 2 m"),
    (COLUMN | {"layer.passes": 130_400, "unusual": ["layer.passes"]}, "layer.passes: must be between 1 and 1000, got"),
    (plies(0.02, 1e6), "layer.plies.relative_modulus: 1e+06 is far outside the plausible 0.001 to 1000"),
    ({"unusual": ["mix.overrides.heckel_slop"]}, "unusual: holds … did you mean 'mix.overrides.heckel_slope'?"),
    ({"unusual": ["everything"]}, "unusual: holds 'everything', … give key paths such as"),
    ({"unusual": ["mix.moisture"]}, "unusual: holds 'mix.moisture', which is no key with a plausible range"),
    ({"compare.column.mix.overrides.heckel_slope": 13.0}, "compare.column: with it mix.overrides.heckel_slope: 13 1/"),
]
PROCESS = [  # of the process scene
    (NO_CLOSURE, "process.gap: exactly one of gap, product_density_ratio, extrusion_pressure must be given, got none"),
    ({"process.gap": 0.001}, "process.gap: … must be given, got gap and product_density_ratio; take the others out"),
    ({"process.mould_speed": 0.0}, "process.mould_speed: is 0, and process.strokes is missing; give the number"),
    ({"process.strokes": 4}, "process.mould_speed: is 0.0175 m/s, so that roller length and stroke determine"),
    ({"process.mould_speed": 1.5}, "process.mould_speed: must be at most machine.roller_length over the time of a"),
    ({"process.mould_speed": 1e-05, "unusual": ["process.mould_speed"]}, "process.mould_speed: must be at least 0."),
    ({"product.mould_speed": 0.02}, "process.mould_speed: must be product.mould_speed = 0.02 m/s, got 0.0175"),
    ({"process.mould_speed": 17.5}, "process.mould_speed: … was 17.5 mm/s = 0.0175 m/s meant?"),
    ({"process.fill_height": 0.2}, "process.fill_height: process.fill_density_ratio is missing; give both, or neit"),
    ({"process.fill_height": 0.23, "process.fill_density_ratio": 0.75}, "process.fill_height: must be at most prod"),
    (NO_CLOSURE | {"process.gap": 0.007}, "process.gap: must be at most R (1 - cos nip) = 0.006634 m, got 0.007"),
    (NO_CLOSURE | {"process.gap": 0.001, "process.feed": "even"}, 'process.gap: is for process.feed "room", got 0.001'),
    ({"process.product_density_ratio": 0.74}, "process.product_density_ratio: must be above …ratio = 0.75, got 0.74"),
    ({"process.feed": "first"}, 'process.feed_count: is missing, and process.feed is "first"; give the number of f'),
    ({"process.feed_count": 3}, 'process.feed_count: is for process.feed "first", got it with "room"; take it out'),
    ({"process.feed": "table"}, 'process.feed_table: is missing, and process.feed is "table"; give points'),
    (feed(2.0, 1.0), "process.feed_table: must have positions that rise one by one up to … = 1.164 m"),
    (feed(0.0, 0.0), "process.feed_table: must have one positive relative_thickness at least, got none"),
    ({"process.offered_thickness": 0.001}, "process.offered_thickness: is for process.extrusion_pressure, got 0.00"),
    ({"process.feed": "all"}, "process.feed: must be one of room, even, first, table, got 'all'"),
    ({"process.nip_angle": 0.0}, "process.nip_angle: must be above 0 and at most 60, got 0"),
    ({"process.layers": 0}, "process.layers: must be between 1 and 500, got 0"),
    ({"process.feed_density_ratio": 0.7}, "process.feed_density_ratio: must be above 0.72 and at most 0.99, got 0."),
    ({"process": None}, "sleeve: is for the table [process], which is missing; take the table [sleeve] out"),
    ({"sleeve.head": -1.0}, "sleeve.head: must be positive, got -1"),
    ({"sleeve.wall_friction": 1.5}, "sleeve.wall_friction: must be between 0 and 1, got 1.5"),
]
