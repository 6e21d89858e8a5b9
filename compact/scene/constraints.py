"""Rules between the keys of a scene, and advice by rules of thumb; bounds of a single key are in `schema`.

A rule is a function of the values of its keys. It returns a sentence where the values contradict one another, else
None. It is evaluated if none of its keys has been refused, and reported at its first key. The value of an absent
optional key is None; without the table [process] its keys are absent too. Limits, keys that need another key and keys
that belong to one choice are tables, `LIMITS`, `NEEDS` and `BELONGS`.
"""

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from operator import eq, gt, lt
from typing import Any

from compact.engines import BUILT_IN, ENGINES
from compact.engines.interface import Limit
from compact.machine.drives import DRIVES
from compact.material.laws import drucker_prager_slopes
from compact.material.mix import prior, scaled_fits
from compact.scene.errors import Key, Mistake, Source
from compact.scene.schema import NIP_ANGLE, STROKES_LIMIT, unit_of

OIL_SHARE = 0.02  # [-], of the stroke, by which oil may yield; a cart overshoots its stroke by up to half of this
STATIC_SLOPES = 0.4e-6, 1.5e-6, 5e-6  # [1/Pa], assumed: gyratory compactors before the first turn, to the prior's share
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
    said = ((rule.paths[0], rule.broken(*(value_at(data, path) for path in rule.paths))) for rule in evaluated)
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


# Limits of the engines. An absent key has a default: an engine that does not accept it computes with the nearest
# accepted value, and the results state the replacement. A key that the scene sets is never replaced, but refused. A
# `fixed` limit has no alternative (half-plane theory has one gap geometry): it replaces the value in both cases.


def adapt(scene: Any, engine: str) -> tuple[Any, tuple[str, ...]]:
    """Replace the values that an engine does not accept by the nearest accepted ones.

    Returns
    -------
    scene : Scene
        Unvalidated copy for the engine.
    sentences : tuple of str
        One for each replaced key, such as "spectral: frictionless roller in place of the free roller, as ...".
    """
    friction, sentences = scene.mix.overrides.steel_friction, []
    for limit in ENGINES[engine].limits:
        value = limit.value_in(scene)
        if limit.takes(value, friction) or (scene.is_set(limit.key) and not limit.fixed):
            continue
        sentences.append(replaced(engine, limit, value))
        table, key = limit.key.split(".")
        scene = scene.model_copy(update={table: getattr(scene, table).model_copy(update={key: limit.taken[0]})})
    return scene, tuple(sentences)


def replaced(engine: str, limit: Limit, value: object) -> str:
    """Return the sentence on a replaced value."""
    return f"{engine}: {limit.key} {_shown(limit.taken[0])} in place of {_shown(value)}, as {limit.why}"


def _shown(value):
    """Return a value in words; a table and a list of tables by their kind."""
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, int | float):
        return f"{value:g}"
    return "absent" if value is None else f"{len(value)} plies" if isinstance(value, tuple) else "lower lift"


def _refusal(key, value, chosen, friction):
    limits = [each for each in ENGINES[chosen].limits if each.key == key and not (each.fixed or each.late)]
    if value is None or all(each.takes(value, friction) for each in limits):
        return None
    able = [
        name
        for name, engine in BUILT_IN.items()
        if not engine.reads("process")  # no alternative to an engine of a single pass
        and all(each.takes(value, friction) for each in engine.limits if each.key == key)
    ]
    remedy = f"give {_listed(limits[0].taken)}" if any(limits[0].taken) else "take the key out"
    got = f"{key.rpartition('.')[2]} of {value:g}" if isinstance(value, int | float) else _shown(value)
    return (
        f'the engine "{chosen}" takes no {got}, as {limits[0].why}; {remedy}, or choose '
        f"accuracy.engine = {_listed(able)}"
    )


def _listed(values):
    return " or ".join(map(_shown, values))


for _key in dict.fromkeys(limit.key for engine in BUILT_IN.values() for limit in engine.limits):
    rule(_key, "accuracy.engine", "mix.overrides.steel_friction")(partial(_refusal, _key))


HOLDS: dict[str, Callable[[float, float], bool]] = {
    "below": lt,
    "above": gt,
    "equal to": eq,
    "at most": lambda value, limit: value <= limit * GUARD,
    "at least": lambda value, limit: value * GUARD >= limit,
}
LIMITS = (  # key, relation, limit as a formula of other keys, remedy
    ("machine.journal_diameter", "below", "machine.guide_wheel_diameter", "give the journal inside it"),
    ("machine.roller_radius", "at most", "(motion.stroke - machine.feeder_sleeve) / 2",
     "give a smaller roller or sleeve, or a longer stroke (eqs 1.2, 1.3)"),
    ("layer.fed_density_ratio", "below", "mix.density_ratio", "give the looser state before the first pass"),
    ("layer.lower_lift.density_ratio", "above", "layer.fed_density_ratio", "give that behind the earlier pass"),
    ("layer.lift_thickness", "at most", "product.height", "without it the product is one lift"),
    ("contact.indentation", "below", "(layer.lift_thickness or product.height)", "the base lies there"),
    ("motion.energy_weight", "at most", "1 - motion.acceleration_weight", "the rest up to 1 is the weight of jerk"),
    ("motion.rod_length", "above", "motion.stroke / 2", "give a longer rod"),
    ("drive.end_springs.length", "at most", "motion.stroke / 2", "give shorter springs"),
    ("drive.motor.belt.stiffness", "at least", "20 * drive.motor.belt.preload", "the belt may stretch by 5 % at most"),
    ("cam.breadth", "above", "motion.stroke", "give a broader cam"),
    ("process.mould_speed", "equal to", "product.mould_speed", "take product.mould_speed out"),
    ("process.mould_speed", "at most", "machine.roller_length / (motion.duration + motion.dwell)",
     "parts of the product would pass between two strokes"),
    ("process.mould_speed", "at least", f"machine.roller_length / (motion.duration + motion.dwell) / {STROKES_LIMIT}",
     "give 0 with process.strokes for a mould at rest"),
    ("process.fill_height", "at most", "product.height + machine.roller_radius * (1 - cos(process.nip_angle))",
     "the roller draws in no more"),
    ("process.gap", "at most", "machine.roller_radius * (1 - cos(process.nip_angle))", "the roller draws in no more"),
    ("process.product_density_ratio", "above", "max(process.feed_density_ratio, process.fill_density_ratio or 0)",
     "give the density behind the last stroke"),
    *(
        (key, "below", "mix.overrides.saturation_limit", "mix at rest is no denser")
        for key in (
            "layer.fed_density_ratio", "layer.lower_lift.density_ratio", "process.feed_density_ratio",
            "process.fill_density_ratio", "process.product_density_ratio", "mix.density_ratio",
        )
    ),
)  # fmt: skip
KEY_PATH = re.compile(r"[a-z]\w*(?:\.[a-z]\w*)+")


def _cosine(angle):
    return math.cos(math.radians(NIP_ANGLE if angle is None else angle))


def _limited(key, word, formula, limit, remedy, value, *others: float | None):
    if not value:  # 0 is none
        return None
    try:
        bound = limit(*others)
    except TypeError:  # a key of the limit is absent
        return None
    if bound is not None and not HOLDS[word](value, bound):
        return f"must be {word} {formula} = {bound:.6g}{unit_of(key)}, got {value:.9g}; {remedy}"


for _key, _word, _formula, _remedy in LIMITS:
    _others = dict.fromkeys(KEY_PATH.findall(_formula))
    _code = KEY_PATH.sub(lambda found: found[0].replace(".", "_"), f"lambda {', '.join(_others)}: {_formula}")
    rule(_key, *_others)(partial(_limited, _key, _word, _formula, eval(_code, {"cos": _cosine}), _remedy))

NEEDS = (  # key, and the one without which it means nothing
    ("motion.optimise.pressure_angle", "cam"),
    ("motion.optimise.radius_of_curvature", "cam"),
    ("process.fill_height", "process.fill_density_ratio"),
    ("process.fill_density_ratio", "process.fill_height"),
    ("process.plate_length", "process.plate_pressure"),
    ("process.plate_pressure", "process.plate_length"),
    ("sleeve", "process"),
)


def _needed(needed, value, given):
    if value is not None and given is None:
        return f"needs {needed}, which is missing; give it, or take the key out"


RULES.extend(Rule((key, other), partial(_needed, other)) for key, other in NEEDS)

BELONGS = (  # key, key of the choice, choice to which it belongs, its content where it must be given
    ("drive.motor.breakdown_slip", "drive.motor.curve", "kloss", "the slip at the breakdown torque, such as 0.15"),
    ("process.gap", "process.feed", "room", ""),
    ("process.feed_count", "process.feed", "first", "the number of fed strokes"),
)


def _belongs(choice, own, content, value, chosen):
    chosen = chosen or ("room" if choice == "process.feed" else "none")  # the default
    if chosen == own and value is None and content:
        return f'is missing, and {choice} is "{own}"; give {content}'
    if chosen != own and value is not None:
        return f'is for {choice} = "{own}", got it with "{chosen}"; take it out, or choose "{own}"'


RULES.extend(Rule((key, other), partial(_belongs, other, own, content)) for key, other, own, content in BELONGS)


def _belongs_to_drive(key, owner, value, kind):
    drive = DRIVES[kind]
    if key in drive.keys or value is None:
        return _belongs("drive.kind", kind, drive.keys.get(key), value, kind)
    return _belongs("drive.kind", owner, "", value, kind)


def _taken_by_drive(key, value, kind):
    if value and (reason := DRIVES[kind].refused.get(key)):
        return f'is not for drive.kind = "{kind}", which {reason}; take it out, or choose another drive'


for _drive in DRIVES.own.values():
    for _key in _drive.keys:
        rule(_key, "drive.kind")(partial(_belongs_to_drive, _key, _drive.name))
for _key in ("drive.catalogue", "drive.end_springs", "motion.dwell"):
    rule(_key, "drive.kind")(partial(_taken_by_drive, _key))


def _one_entry_each(counted, entries, count):
    if entries is not None and len(entries) != count:
        return f"needs one entry for each of {counted} = {count:g}, got {len(entries)}; make the two agree"


for _key, _other in (("machine.roller_positions", "machine.rollers"), ("drive.angles", "drive.carts")):
    rule(_key, _other)(partial(_one_entry_each, _other))


def _no_duplicates(names):
    if repeated := sorted({name for name in names or () if list(names).count(name) > 1}):
        return f"must not repeat an entry, got {', '.join(map(repr, repeated))} more than once; keep one of each"


RULES.extend(Rule((key,), _no_duplicates) for key in ("motion.laws", "motion.tables", "drive.rank_by", "output.items"))


def _wanted_is_computed(item, engines, wanted, engine):
    if item in wanted and engine not in engines:
        able = " or ".join(f'"{name}"' for name in engines)
        return f'holds "{item}", which accuracy.engine = "{engine}" does not compute; take it out, or choose {able}'


for _key, _engines in (("fields", ("fem", "compaction")), ("model_spread", ("column", "compaction", "process"))):
    rule("output.items", "accuracy.engine")(partial(_wanted_is_computed, _key, _engines))


@rule("machine.roller_positions", "machine.roller_radius")
def _rollers_do_not_overlap(positions, radius):
    gap = min((b - a for a, b in pairwise(sorted(positions))), default=2 * radius)
    if gap * GUARD < 2 * radius:
        return f"rollers overlap: neighbours must be at least 2*roller_radius = {2 * radius:g} m apart, got {gap:g}"


@rule("machine.guide_positions")
def _front_guide_is_in_front(positions):
    front, rear = positions
    if front <= rear:
        return f"front must be greater than rear, got [{front:g}, {rear:g}]; give [front, rear], + towards the drive"


SLOPES = ("friction_angle", "cohesion_loose", "earth_pressure_coefficient", "required_pressure", "dilatancy_angle")


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
        drucker_prager_slopes(*(getattr(mix, name) for name in SLOPES))
    except ValueError as error:
        return str(error)


@rule("layer.plies", "product.height", "layer.lift_thickness")
def _plies_fill_the_layer(plies, height, lift):
    total, required = sum(ply["thickness"] for ply in plies or ()), lift or height
    if plies and abs(total - required) > (GUARD - 1) * required:
        return f"must be as thick together as the layer, {required:g} m, got {total:.9g}; change one thickness"


def _at_most_one(names, *values: Any):
    if (given := len(values) - values.count(None)) > 1:
        return f"only one of {names} can be prescribed, got {given}; take the others out"


for _key, _names in (
    ("contact", ("indentation", "load", "peak_pressure")),
    ("process", ("gap", "product_density_ratio", "extrusion_pressure")),
    ("process", ("offered_thickness", "gap")),
    ("process", ("offered_thickness", "product_density_ratio")),
):
    rule(*(f"{_key}.{name}" for name in _names))(partial(_at_most_one, f"{', '.join(_names[:-1])} and {_names[-1]}"))


@rule("machine.roller_torque", "machine.roller_condition", "accuracy.engine")
def _torque_turns_a_roller(torque, rolling, engine):
    if torque is None:
        if rolling == "driven" and ENGINES[engine].reads("machine.roller_torque"):
            return f'is missing, and the engine "{engine}" rolls a "driven" roller by it; give the torque in N m'
    elif rolling not in (None, "free", "driven"):
        return f'is for machine.roller_condition "free" or "driven", got {torque:g} with "{rolling}"; take it out'
    elif torque > 0 and rolling != "driven":
        return (
            f'must not be positive for a "free" roller, which bearings only brake, got {torque:g}; give {-torque:g}, '
            'or machine.roller_condition = "driven"'
        )


@rule("mix.pore_air", "contact.held", "contact.load", "contact.peak_pressure")
def _air_needs_a_held_height(pore_air, held, load, pressure):
    held = None if held == "height" else held
    if pore_air not in (None, "drained") and (found := [each for each in (held, load, pressure) if each is not None]):
        return f'"{pore_air}" needs a density or an indentation, got {found[0]!r} in [contact]; or choose "drained"'


def _rises(values):
    return values[0] > 0 and all(b > a for a, b in pairwise(values))


@rule("contact.speeds")
def _speeds_rise(speeds):
    if speeds is not None and not (speeds and _rises(speeds)):
        return f"must be positive and rise one by one, got {list(speeds)}; give speeds such as [0.05, 0.1, 0.2]"


@rule("motion.other_durations", "motion.duration")
def _durations_are_positive_and_differ(others, duration):
    if others and not _rises(sorted([*others, duration])):
        return f"must be positive and differ, from motion.duration = {duration:g} s too, got {list(others)}"


@rule("motion.rod_length", "motion.laws", "drive.kind", "output.items")
def _crank_has_a_rod(rod, laws, kind, wanted):
    users = {
        "motion.laws": {"crank", "all"} & {*laws},
        "drive.kind": DRIVES[kind].needs_rod,
        "output.items": "crank" in wanted,
    }
    if rod is None and any(users.values()):
        named = " and ".join(key for key, holds in users.items() if holds)
        return f"is missing for the crank of {named}; give the length of the connecting rod in m"


@rule("cam", "output.items")
def _cams_wanted_are_given(cam, wanted):
    if cam is None and "cams" in wanted:
        return 'the table [cam] is missing, and output.items holds "cams"; give it, or take "cams" out'


@rule("compare", "accuracy.engine")
def _compared_engines_are_others(compare, engine):
    if engine in (compare or {}):
        return f'holds "{engine}", which is accuracy.engine itself; take it out, or choose another accuracy.engine'


@rule("motion.laws")
def _all_stands_alone(laws):
    if "all" in laws and set(laws) != {"all"}:
        return '"all" already holds every law, got it with others; write ["all"] or the names'


@rule("process.mould_speed", "process.strokes")
def _mould_at_rest_has_strokes(speed, strokes):
    if speed == 0 and strokes is None:
        return "is 0, and process.strokes is missing; give the number of strokes over a mould at rest, or its speed"
    if speed and strokes is not None:
        return f"is {speed:g} m/s, which determines the number of strokes, got process.strokes too; take one out"


@rule("accuracy.engine", "process")
def _engine_has_a_process(engine, process):
    if engine == "process" and not (process or {}).get("mould_speed"):
        return (
            'is "process", which needs the table [process] with a moving mould: only then the rollers have a steady '
            "resistance; give process.mould_speed, the feed and one closure"
        )


@rule("process.kneading", "mix.overrides.heckel_slope")
def _kneaded_slope_is_static(kneading, slope):
    if kneading is not None and (slope is None or slope > STATIC_SLOPES[2]):
        low, proposed, high = STATIC_SLOPES
        return (
            "needs a static mix.overrides.heckel_slope: that of the prior is from the required pressures of roller "
            f"machines, whose mix is kneaded, and would count it twice; give {proposed:g} 1/Pa, {low:g} to {high:g}"
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
    if pore_air not in (None, "drained") and (passes > 1 or return_stroke == "compacted"):
        return f'"{pore_air}" counts in the first pass alone; later passes have the too small forces of drained mix'


@rule("machine.roller_radius", "product.height", into=ADVICE)
def _radius_suits_the_product(radius, height):
    low, high = 0.40 * height, 0.55 * height
    if not low <= radius * GUARD <= high * GUARD**2:
        return f"eq 1.1 advises 0.40 to 0.55 of product.height, {low:g} to {high:g} m, got {radius:g}"


@rule("machine.weight", "machine.mass", "unusual")
def _weight_is_of_the_mass(weight, mass, unusual):
    if not 5 <= weight / mass <= 20 and not {"machine.weight", "machine.mass"} & {*(unusual or ())}:
        return f"weight / mass is {weight / mass:g} m/s2, must be about 9.81; give {9.81 * mass:g} N for {mass:g} kg"


@rule("machine.weight", "machine.mass", into=ADVICE)
def _weight_suits_the_mass(weight, mass):
    if not 9.5 <= weight / mass <= 10.5:
        return f"weight / mass is {weight / mass:g} m/s2, expected 9.5 to 10.5; is one of the two in other units?"


@rule(
    "drive.hydraulics.bulk_modulus", "drive.hydraulics.supply_pressure", "drive.hydraulics.piston_area",
    "drive.hydraulics.dead_volume", "motion.stroke", into=ADVICE,
)  # fmt: skip
def _oil_is_stiff(modulus, pressure, area, volume, stroke):
    if modulus is None:
        return None
    yielding = pressure * (volume + area * stroke / 2) / (2 * modulus * area)  # of both columns, the cart in the middle
    if yielding > OIL_SHARE * stroke:
        return (
            f"under the supply pressure the oil yields by {yielding:.3g} m, more than {OIL_SHARE:.0%} of the stroke: "
            "the cart leaves its law, and may stop and start near rest; a larger bulk_modulus or piston_area, or a "
            "smaller dead_volume, makes the oil stiffer"
        )


@rule("machine.roller_condition", "machine.roller_torque", "accuracy.engine", into=ADVICE)
def _torque_is_heeded(rolling, torque, engine):
    if ENGINES[engine].reads("machine.roller_torque"):
        return None
    if rolling == "driven":
        return f'the engine "{engine}" assumes full slip of a driven roller, whatever its torque; "fem" resolves stick'
    if torque:
        return f'the engine "{engine}" neglects machine.roller_torque; "fem" and "compaction" use it'


@rule("machine.rollers", "machine.overlap", "motion.stroke", "product.width", "process", into=ADVICE)
def _rollers_cover_the_product(rollers, overlap, stroke, width, process):
    covered = rollers * (stroke - overlap)
    if process is not None and covered * GUARD < width:
        needed = math.ceil(width / (stroke - overlap) / GUARD) if stroke > overlap else 0
        remedy = f"machine.rollers = {needed}" if needed else "a stroke longer than machine.overlap"
        return (
            f"{rollers:g} rollers side by side, each over its own stroke, press rollers*(stroke - overlap) = "
            f"{covered:.4g} m of product.width = {width:g} m; the whole width needs {remedy}, or another cart"
        )


def _is_file(path):
    try:
        return path.is_file()
    except OSError:  # a name too long for the file system
        return False


def value_at(data: Any, key: str | Sequence[str]) -> Any:
    """Return the value at a key of nested tables, numbers as floats, None if absent; of a list a tuple."""
    parts = key.split(".") if isinstance(key, str) else key
    for number, part in enumerate(parts):
        if isinstance(data, list | tuple):
            return tuple(value_at(entry, parts[number:]) for entry in data)
        data = data.get(part) if isinstance(data, Mapping) else None
    return _as_floats(data)


def _as_floats(value):
    """Whole numbers as floats, so that no sum of them is too large for a float."""
    if isinstance(value, list | tuple):
        return tuple(map(_as_floats, value))
    if isinstance(value, dict):
        return {key: _as_floats(inner) for key, inner in value.items()}
    return float(value) if isinstance(value, int) else value
