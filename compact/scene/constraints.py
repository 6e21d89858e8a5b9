"""Rules between the keys of a scene, and advice by rules of thumb; bounds of a single key are in `schema`.

A rule is a function of the values of its keys. It returns a sentence where the values contradict one another, else
None. It is evaluated if none of its keys has been refused, and reported at its first key. The value of an absent
optional key is None.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from operator import gt, le, lt
from typing import Any

from compact.engines import ENGINES
from compact.material.earth_pressure import earth_pressure_bounds, matched_slopes
from compact.material.mix import prior, scaled_fits
from compact.scene.engine_capabilities import refusals
from compact.scene.errors import Key, Mistake, Source
from compact.scene.schema import unit_of

OIL_SHARE = 0.02  # [-], of the stroke, by which oil may yield; a cart overshoots its stroke by up to half of this
GUARD = 1 + 1e-9  # [-], relative rounding margin; the published machine satisfies 2R + B_T = stroke exactly


@dataclass(frozen=True)
class Rule:
    """Rule between keys.

    Parameters
    ----------
    broken : callable
        Function of their values that returns a sentence where they violate the rule, else None.
    """

    keys: tuple[str, ...]
    broken: Callable[..., str | None]

    @cached_property
    def paths(self) -> tuple[Key, ...]:
        """Key paths, part by part."""
        return tuple(tuple(key.split(".")) for key in self.keys)

    def involves(self, keys: Iterable[Key]) -> bool:
        """Return True if one of its keys is among `keys`, inside one of them or around one."""
        return any(path[: len(key)] == key[: len(path)] for key in keys for path in self.paths)


RULES: list[Rule] = []
ADVICE: list[Rule] = []
Broken = Callable[..., str | None]


def sentences(rules: Iterable[Rule], data: Mapping[str, Any], refused: Iterable[Mistake] = ()) -> list[Mistake]:
    """Evaluate rules on nested tables of values.

    Parameters
    ----------
    refused : iterable of Mistake
        Mistakes of single keys; rules that involve their keys are skipped.
    """
    out = {mistake.key for mistake in refused}
    evaluated = [rule for rule in rules if not rule.involves(out)]
    said = ((rule.paths[0], rule.broken(*(_value(data, path) for path in rule.paths))) for rule in evaluated)
    return [Mistake(key, sentence) for key, sentence in said if sentence]


def files_exist(source: Source) -> tuple[Rule, ...]:
    """Return the rules that the files that a scene names are below its folder."""

    def missing(names: Any) -> str | None:
        listed = (names,) if isinstance(names, str) else names or ()
        if absent := [name for name in listed if not _is_file(source.folder / name)]:
            names = ", ".join(map(repr, absent))
            return f"no such file: {names} under {str(source.folder)!r}; give CSV files relative to the scene file"
        return None

    return Rule(("motion.tables",), missing), Rule(("drive.catalogue.file",), missing)


def rule(*keys: str, into: list[Rule] = RULES) -> Callable[[Broken], Broken]:
    """Return a decorator that enters a function as the rule of some keys.

    Parameters
    ----------
    *keys : str
        Keys whose values the function takes; a broken rule is reported at the first.
    into : list of Rule
        Rules or advice to which it is added.
    """

    def enter(broken: Broken) -> Broken:
        into.append(Rule(keys, broken))
        return broken

    return enter


for _keys, _broken in refusals():
    rule(*_keys)(_broken)


@rule("machine.roller_positions", "machine.rollers")
def _one_position_per_roller(positions, rollers):
    if len(positions) != rollers:
        return f"needs one position per roller, machine.rollers = {rollers:g}, got {len(positions)}; make the two agree"


@rule("machine.roller_positions", "machine.roller_radius")
def _rollers_do_not_overlap(positions, radius):
    gap = min((b - a for a, b in pairwise(sorted(positions))), default=2 * radius)
    if gap * GUARD < 2 * radius:
        return (
            f"rollers overlap: neighbours must be at least 2*roller_radius = {2 * radius:g} m apart, got {gap:g}; "
            "move them apart or make machine.roller_radius smaller"
        )


@rule("machine.roller_radius", "machine.feeder_sleeve", "motion.stroke")
def _roller_fits_the_stroke(radius, sleeve, stroke):
    needed = 2 * radius + sleeve
    if needed > stroke * GUARD:
        return (
            f"roller too large for the stroke: 2*roller_radius + feeder_sleeve must be at most motion.stroke = "
            f"{stroke:g} m (eqs 1.2, 1.3), got {needed:g}; make the roller or the sleeve smaller, "
            f"or the stroke at least {needed:g}"
        )


@rule("machine.guide_positions")
def _front_guide_is_in_front(positions):
    front, rear = positions
    if front <= rear:
        return f"front must be greater than rear, got [{front:g}, {rear:g}]; give [front, rear], + towards the drive"


def _compared(word, holds, key, remedy, value, other):
    if value is not None and not holds(value, other):
        return f"must be {word} {key} = {other:g}{unit_of(key)}, got {value:g}; {remedy}"


for _key, _word, _holds, _other, _remedy in (
    ("machine.journal_diameter", "below", lt, "machine.guide_wheel_diameter", "give the journal inside it"),
    ("layer.fed_density_ratio", "below", lt, "mix.density_ratio", "give the looser state before the first pass"),
    ("layer.lower_lift.density_ratio", "above", gt, "layer.fed_density_ratio", "give that behind the earlier pass"),
    ("layer.lift_thickness", "at most", le, "product.height", "without it the product is one lift"),
    ("cam.breadth", "greater than", gt, "motion.stroke", "give a broader cam"),
):
    rule(_key, _other)(partial(_compared, _word, _holds, _other, _remedy))


@rule(
    "mix.overrides.earth_pressure_coefficient", "mix.law", "mix.moisture", "mix.density_ratio", "mix.overrides",
    "mix.fitted_at",
)  # fmt: skip
def _cap_has_the_earth_pressure(_, law, moisture, density_ratio, overrides, fitted_at):
    if law != "drucker-prager-cap":
        return None
    given = {name: value for name, value in (overrides or {}).items() if value is not None}
    try:
        mix = prior(moisture, density_ratio, given | scaled_fits(moisture, density_ratio, given, fitted_at))
        slope, _ = matched_slopes(mix.friction_angle, mix.dilatancy_angle)
    except ValueError as error:
        return str(error)
    strength = mix.cohesion_loose / math.tan(math.radians(mix.friction_angle))
    low, high = earth_pressure_bounds(slope, mix.required_pressure, strength)
    if not low < mix.earth_pressure_coefficient <= high:
        return (
            f"must be between {low:.4f} and {high:.4f} for a friction angle of {mix.friction_angle:g} degrees and a "
            f"cohesion of {mix.cohesion_loose / 1e3:g} kPa at {mix.required_pressure / 1e3:.4g} kPa, got "
            f"{mix.earth_pressure_coefficient:.4g}: below, mix in confined compression would slide along the shear "
            "line; above, the cap would be flatter than the line; change it, mix.overrides.friction_angle or "
            "mix.overrides.cohesion_loose"
        )
    return None


@rule("layer.plies", "product.height", "layer.lift_thickness")
def _plies_fill_the_layer(plies, height, lift):
    total = sum(ply["thickness"] for ply in plies or ())
    key, required = _pressed(height, lift)
    if plies and abs(total - required) > (GUARD - 1) * required:
        return f"must be {key} = {required:g} m thick together, got {total:.9g}; change one thickness"


def _pressed(height, lift):
    return ("product.height", height) if lift is None else ("layer.lift_thickness", lift)


@rule("motion.energy_weight", "motion.acceleration_weight")
def _weights_leave_a_share(energy, acceleration):
    if energy + acceleration > GUARD:
        return (
            f"energy_weight + acceleration_weight must be at most 1, got {energy + acceleration:g}; "
            "the rest up to 1 is the weight of jerk"
        )


@rule("contact.indentation", "contact.load", "contact.peak_pressure")
def _one_target(indentation, load, pressure):
    given = sum(target is not None for target in (indentation, load, pressure))
    if given > 1:
        return f"only one of indentation, load and peak_pressure can be prescribed, got {given}; take the others out"


@rule("contact.indentation", "product.height", "layer.lift_thickness")
def _roller_stays_above_the_base(indentation, height, lift):
    key, most = _pressed(height, lift)
    if indentation is not None and indentation >= most:
        return f"must be below {key} = {most:g} m, got {indentation:g}; the base lies there"


@rule("machine.roller_torque", "machine.roller_condition")
def _torque_turns_a_roller(torque, rolling):
    rolling = rolling or "free"  # the default
    if torque is not None and rolling not in ("free", "driven"):
        return f'is for machine.roller_condition "free" or "driven", got {torque:g} with "{rolling}"; take it out'
    if torque is not None and torque > 0 and rolling == "free":
        return (
            f'must not be positive for a "free" roller, which bearings only brake, got {torque:g}; give {-torque:g}, '
            'or machine.roller_condition = "driven"'
        )


@rule("machine.roller_torque", "machine.roller_condition", "accuracy.engine")
def _driven_roller_has_a_torque(torque, rolling, engine):
    if torque is None and rolling == "driven" and ENGINES[engine].reads("machine.roller_torque"):
        words = f'the engine "{engine}" rolls a "driven" roller by it'
        return f"is missing, and {words}; give the torque on one roller in N m"


@rule("mix.pore_air", "contact.held", "contact.load", "contact.peak_pressure")
def _air_needs_a_held_height(pore_air, held, load, pressure):
    if pore_air in (None, "drained"):
        return None
    given = {
        f'contact.held = "{held}"': held not in (None, "height"),
        "contact.load": load,
        "contact.peak_pressure": pressure,
    }
    if found := [name for name, value in given.items() if value]:
        return (
            f'"{pore_air}" is computed at the height of the roller, got {" and ".join(found)}; take the key out, so '
            'that the density or an indentation is prescribed, or choose "drained"'
        )


@rule("mix.pore_air", "mix.overrides.air_permeability", into=ADVICE)
def _permeability_is_heeded(pore_air, permeability):
    if permeability is not None and pore_air in (None, "drained"):
        return (
            'mix.overrides.air_permeability enters the de-aeration speed alone; mix.pore_air = "one-way" or "coupled" '
            "adds the pressure of the air to load and resistance"
        )


@rule("mix.pore_air", "layer.passes", "layer.return_stroke", into=ADVICE)
def _later_passes_have_no_air(pore_air, passes, return_stroke):
    later = [f"layer.passes = {passes:g}"] if passes is not None and passes > 1 else []
    if return_stroke == "compacted":
        later.append('layer.return_stroke = "compacted"')
    if later and pore_air not in (None, "drained"):
        return (
            f'"{pore_air}" belongs to the first pass over fed mix alone: with {" and ".join(later)} later passes have '
            'the forces of drained mix, which are too small; set "drained" to compute all passes alike'
        )


@rule("contact.speeds")
def _speeds_rise(speeds):
    if speeds is not None and not (len(speeds) and speeds[0] > 0 and all(b > a for a, b in pairwise(speeds))):
        return f"must be positive and rise one by one, got {list(speeds)}; give speeds such as [0.05, 0.1, 0.2]"


@rule("motion.other_durations", "motion.duration")
def _durations_are_positive_and_differ(others, duration):
    if others and not (all(each > 0 for each in others) and len({*others, duration}) == len(others) + 1):
        return (
            f"must be positive, differ from one another and from motion.duration = {duration:g} s, got {list(others)}; "
            "give times of one pass such as [1.0, 3.0]"
        )


@rule("motion.optimise", "cam")
def _bounds_of_a_cam_have_a_cam(optimise, cam):
    if optimise and cam is None:
        bounds = "pressure_angle", "radius_of_curvature", "profile_radius"
        if given := [key for key in bounds if optimise.get(key) is not None]:
            return f"bounds {' and '.join(given)} of a cam, and the table [cam] is missing; give it, or take them out"


@rule("motion.rod_length", "motion.stroke")
def _rod_is_longer_than_the_crank(rod, stroke):
    if rod is not None and rod <= stroke / 2:
        return f"must be greater than the crank, stroke/2 = {stroke / 2:g} m, got {rod:g}; give a longer rod"


@rule("motion.rod_length", "motion.laws", "drive.kind", "output.items")
def _crank_has_a_rod(rod, laws, kind, wanted):
    if rod is not None:
        return None
    users = {
        'motion.laws holds "crank"': "crank" in laws,
        'motion.laws is ["all"], crank included': "all" in laws,
        'drive.kind is "crank"': kind == "crank",
        'output.items holds "crank"': "crank" in wanted,
    }
    why = " and ".join(user for user, holds in users.items() if holds)
    return f"is missing, and {why}; give the length of the connecting rod in m" if why else None


@rule("drive.angles", "drive.carts")
def _one_angle_per_cart(angles, carts):
    if angles is not None and len(angles) != carts:
        return f"needs one angle per cart, drive.carts = {carts:g}, got {len(angles)}; make the two agree"


@rule("drive.kind", "drive.stiffness", "drive.damping", "drive.backlash", "drive.include_added_mass")
def _spring_belongs_to_an_elastic_drive(kind, stiffness, damping, backlash, added_mass):
    given = {"stiffness": stiffness, "damping": damping, "backlash": backlash, "include_added_mass": added_mass}
    if kind == "elastic":
        if missing := [name for name in ("stiffness", "damping") if given[name] is None]:
            return f'"elastic" needs drive.{" and drive.".join(missing)}, got none; give N/m and N s/m'
    elif strange := [name for name, value in given.items() if value is not None]:
        return f'"{kind}" has no {", ".join(strange)}; take it out, or choose "elastic"'


def _table_belongs_to_its_drive(own, table, content, kind, given):
    if kind == own and given is None:
        return f'"{own}" needs the table [drive.{table}], got none; give its {content}'
    if kind != own and given is not None:
        return f'"{kind}" has no {table}; take the table [drive.{table}] out, or choose "{own}"'


rule("drive.kind", "drive.motor")(partial(_table_belongs_to_its_drive, "motor", "motor", "curve, gear and inertias"))
rule("drive.kind", "drive.hydraulics")(
    partial(_table_belongs_to_its_drive, "hydraulic", "hydraulics", "cylinders, pump and oil")
)


@rule("drive.catalogue", "drive.kind")
def _catalogue_belongs_to_a_shaft(catalogue, kind):
    if catalogue is not None and kind == "hydraulic":
        return (
            'is for a drive with a shaft, got drive.kind = "hydraulic"; take the table [drive.catalogue] out, or '
            "choose another kind"
        )
    return None


@rule("drive.end_springs.length", "motion.stroke")
def _springs_leave_each_other_room(length, stroke):
    if length is not None and 2 * length > stroke * GUARD:
        return f"must be at most half of motion.stroke = {stroke:g} m, got {length:g}; give shorter springs"


@rule("drive.motor.breakdown_slip", "drive.motor.curve")
def _slip_belongs_to_kloss(slip, curve):
    if curve == "kloss" and slip is None:
        return 'is missing, and drive.motor.curve is "kloss"; give the slip at the breakdown torque, such as 0.15'
    if curve == "linear" and slip is not None:
        return f'is for drive.motor.curve "kloss", got {slip:g} with "linear"; take it out'


@rule("drive.motor.belt.stiffness", "drive.motor.belt.preload")
def _belt_creeps_little(stiffness, preload):
    if stiffness is not None and preload is not None and 20 * preload > stiffness * GUARD:
        return (
            f"must be at least 20*drive.motor.belt.preload = {20 * preload:g} N, so that the belt stretches by 5 % at "
            f"most, got {stiffness:g}; give a stiffer belt"
        )


@rule("cam", "output.items")
def _cams_wanted_are_given(cam, wanted):
    if cam is None and "cams" in wanted:
        return (
            'the table [cam] is missing, and output.items holds "cams"; give [cam] with breadth and '
            'roller_follower_radius in m, or take "cams" out'
        )


@rule("output.items", "accuracy.engine")
def _fields_wanted_are_computed(wanted, engine):
    if "fields" in wanted and engine not in ("fem", "compaction"):
        return (
            f'holds "fields", which accuracy.engine = "{engine}" does not compute; take it out, or choose "fem" or '
            '"compaction"'
        )


@rule("output.items", "accuracy.engine")
def _model_spread_wanted_has_a_law(wanted, engine):
    if "model_spread" in wanted and engine not in ("column", "compaction", "process"):
        return (
            f'holds "model_spread", the spread over the laws of the mix, which accuracy.engine = "{engine}" does not '
            'have; take it out, or choose "column" or "compaction"'
        )


@rule("compare", "accuracy.engine")
def _compared_engines_are_others(compare, engine):
    if engine in (compare or {}):
        return f'holds "{engine}", which is accuracy.engine itself; take it out, or choose another accuracy.engine'


def _no_duplicates(names):
    if repeated := sorted({name for name in names or () if list(names).count(name) > 1}):
        return f"must not repeat an entry, got {', '.join(map(repr, repeated))} more than once; keep one of each"


for _key in ("motion.laws", "motion.tables", "drive.rank_by", "output.items"):
    rule(_key)(_no_duplicates)


@rule("motion.laws")
def _all_stands_alone(laws):
    if "all" in laws and set(laws) != {"all"}:
        return '"all" already holds every law, got it with others; write ["all"] or the names'


@rule("machine.roller_radius", "product.height", into=ADVICE)
def _radius_suits_the_product(radius, height):
    low, high = 0.40 * height, 0.55 * height
    if not low <= radius * GUARD <= high * GUARD**2:
        return f"eq 1.1 advises 0.40 to 0.55 of product.height, {low:g} to {high:g} m, got {radius:g}"


@rule("machine.weight", "machine.mass", into=ADVICE)
def _weight_suits_the_mass(weight, mass):
    if not 9.5 <= weight / mass <= 10.5:
        return f"weight / mass is {weight / mass:g} m/s2, expected 9.5 to 10.5; is one of the two in other units?"


@rule(
    "drive.hydraulics.bulk_modulus", "drive.hydraulics.supply_pressure", "drive.hydraulics.piston_area",
    "drive.hydraulics.dead_volume", "motion.stroke", "drive.kind", into=ADVICE,
)  # fmt: skip
def _oil_is_stiff(modulus, pressure, area, volume, stroke, kind):
    if kind != "hydraulic" or modulus is None:
        return None
    yielding = pressure * (volume + area * stroke / 2) / (2 * modulus * area)  # of both columns, the cart in the middle
    if yielding > OIL_SHARE * stroke:
        return (
            f"under the supply pressure the oil yields by {yielding:.3g} m, more than {OIL_SHARE:.0%} of the stroke: "
            "the cart leaves its law, and near rest it may stop and start until its passage has no result; a larger "
            "bulk_modulus or piston_area, or a smaller dead_volume, makes the oil stiffer"
        )


@rule("machine.roller_condition", "accuracy.engine", into=ADVICE)
def _driven_roller_may_stick(rolling, engine):
    if not ENGINES[engine].reads("machine.roller_torque") and rolling == "driven":
        return f'the engine "{engine}" assumes full slip of a driven roller, whatever its torque; "fem" resolves stick'


@rule("machine.roller_torque", "machine.roller_condition", "accuracy.engine", into=ADVICE)
def _torque_is_heeded(torque, rolling, engine):
    if not ENGINES[engine].reads("machine.roller_torque") and torque and rolling != "driven":
        return f'the engine "{engine}" neglects machine.roller_torque; "fem" and "compaction" use it'


def _is_file(path):
    try:
        return path.is_file()
    except OSError:  # a name too long for the file system
        return False


def _value(data, parts):
    """Return the value at a key path, of a list of tables a tuple of values."""
    for number, part in enumerate(parts):
        if isinstance(data, list | tuple):
            return tuple(_value(entry, parts[number:]) for entry in data)
        data = data.get(part) if data is not None else None
    return _as_floats(data)


def _as_floats(value):
    """Whole numbers as floats, so that no sum of them is too large for a float."""
    if isinstance(value, list | tuple):
        return tuple(map(_as_floats, value))
    if isinstance(value, dict):
        return {key: _as_floats(inner) for key, inner in value.items()}
    return float(value) if isinstance(value, int) else value
