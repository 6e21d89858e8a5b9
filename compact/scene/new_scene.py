"""The scene that `compact new` writes: a commented template with the numbers of a machine, each with its origin.

The rollers lie side by side, each over its own strip of the plate, so that (n rollers of radius R on a width B)

    stroke = B/n + overlap  (1.3),    stroke = 2 R + sleeve  (1.2),    distance of the axles = B/n

Nothing is fitted: what is not given or derived is a guess, the mix is that of the prior.
"""

from collections.abc import Mapping
from importlib.resources import files
from operator import attrgetter
from pathlib import Path
from textwrap import wrap
from typing import Any

from compact.files import ResultsError, published_scenes, write_text
from compact.scene.errors import SceneError, key_places
from compact.scene.loader import Scene, parse_scene
from compact.scene.plant_data import instruments
from compact.scene.schema import unit_of

GRAVITY = 9.81  # [m/s2]
LIFT_SHARE = 1 / 3  # [-], of the radius: finite elements are steady there at moistures of 0.08 to 0.12, not at 2/3
LIFT_STEP = 0.005  # [m], to which a lift is rounded down, from this thickness up
LOOSE, FED_SHARE = 0.72, 0.846  # [-], density ratio of loose mix; share of the way to the product's as fed, a guess
PIN_REACH, ROD_REACH = 0.7, 2.0  # [-], of the stroke: drive pin before the guide, rod; those of the published machine
SCHEMA_LINE = "#:schema ./scene.schema.json\n"
COLUMN = 34  # [characters], at which a comment begins
SHEET_WIDTH = 112  # [characters], of a line of the sheet of measurements

KEYS = {  # option -> key of the scene
    "rollers": "machine.rollers", "stroke": "motion.stroke", "duration": "motion.duration", "mass": "machine.mass",
    "moisture": "mix.moisture", "density_ratio": "mix.density_ratio",
}  # fmt: skip

Values = dict[str, tuple[Any, str]]  # value and origin by key


def starter_scene() -> str:
    """Return the text of the commented template."""
    return (files("compact") / "data" / "new.toml").read_text("utf-8")


def write_sheet(directory: Path) -> Path:
    """Write the empty sheet of measurements with how each is made; ResultsError if it exists."""
    path, text = directory / "measured.toml", (files("compact") / "data" / "measurements.toml").read_text("utf-8")
    if path.exists():
        raise ResultsError(f"{path}: exists already; give another directory")
    for name, row in instruments().items():
        words = "{0}: {how}. Procedure: {procedure}. Expected: {expected}. Cost: {cost}.".format(name, **row)
        text = text.replace(f"{{{name}}}", "\n#    ".join(wrap(words, SHEET_WIDTH)))
    return write_text(path, text)


def published_scene(name: str) -> str:
    """Return the text of a published scene; ValueError for an unknown name."""
    known = published_scenes()
    if name not in known:
        raise ValueError(f"--from takes the name of a published scene, {', '.join(known)}, got {name!r}")
    return SCHEMA_LINE + known[name].read_text("utf-8")


def new_scene(given: Mapping[str, Any], file: str = "scene.toml") -> tuple[str, list[str]]:
    """Write the scene of a machine.

    Parameters
    ----------
    given : mapping
        Of `rollers`, `diameter` [m], `plate` (width along the travel, length of the rollers, height) [m], `stroke` [m],
        `duration` [s], `mass` [kg], `moisture` and `density_ratio` [-]; the template has the others.
    file : str
        Name of the file, for messages.

    Returns
    -------
    text : str
        Scene in TOML, valid.
    derived : list of str
        A line for each value that follows from those given.

    Raises
    ------
    SceneError
        If the machine has mistakes.
    """
    text, template = starter_scene(), require_given(given, file)
    values = _given(given) | _derived(given, template)
    text = _with_values(text, values)
    parse_scene(text, file)
    told = [(key, value, origin) for key, (value, origin) in values.items() if origin != "given"]
    return text, [f"{key} = {_toml(value)}{unit_of(key)}: {origin}" for key, value, origin in told]


def require_given(given: Mapping[str, Any], file: str) -> Scene:
    """Return the scene of the template; SceneError if a value that is given is wrong by itself."""
    template = parse_scene(starter_scene(), file)
    template.require_fields(**{key: value for key, (value, _) in _given(given).items()})
    return template


def assumed() -> dict[str, str]:
    """Return in words what is assumed where an option is not given, by its name."""
    scene = parse_scene(starter_scene())
    machine, product = scene.machine, scene.product
    plate = f"{product.width:g}x{machine.roller_length:g}x{product.height:g}"
    found = {"rollers": "the width over the stroke", "diameter": f"{2 * machine.roller_radius:g}", "plate": plate}
    return {name: f"{attrgetter(key)(scene):g}" for name, key in KEYS.items()} | found


def read_plate(text: str) -> tuple[float, float, float]:
    """Return width along the travel, length of the rollers and height [m] of a text such as 0.9x0.9x0.1."""
    try:
        width, length, height = (float(part) for part in text.lower().split("x"))
    except ValueError:
        raise ValueError(f"--plate takes WIDTHxLENGTHxHEIGHT in m, such as 0.9x0.9x0.1, got {text!r}") from None
    return width, length, height


def _given(given: Mapping[str, Any]) -> Values:
    """Return the keys that the options state."""
    found = {key: given[name] for name, key in KEYS.items() if name in given}
    if "diameter" in given:
        found["machine.roller_radius"] = given["diameter"] / 2
    if "plate" in given:
        plate = ("product.width", "machine.roller_length", "product.height")
        found |= dict(zip(plate, given["plate"], strict=True))
    return {key: (value, "given") for key, value in found.items()}


def _derived(given: Mapping[str, Any], template: Any) -> Values:
    """Return the keys that follow from those of the options."""
    found: Values = {}
    if "mass" in given:
        found["machine.weight"] = given["mass"] * GRAVITY, f"derived: {GRAVITY} times the mass"
    if "density_ratio" in given:
        fed = LOOSE + FED_SHARE * (given["density_ratio"] - LOOSE)
        found["layer.fed_density_ratio"] = fed, f"guess: {FED_SHARE} of the way from loose mix to the product"
    if given.keys() & {"rollers", "diameter", "plate", "stroke"}:
        machine, product = template.machine, template.product
        radius = given.get("diameter", 2 * machine.roller_radius) / 2
        width, _, height = given.get("plate", (product.width, machine.roller_length, product.height))
        stroke, rollers = given.get("stroke", template.motion.stroke), given.get("rollers")
        count = max(1, round(width / stroke)) if rollers is None else rollers
        _require_strips(count, radius, width, stroke)
        found |= {} if rollers == count else {"machine.rollers": (count, "derived: the width over the stroke")}
        found |= _geometry(count, radius, width, stroke)
        lift = LIFT_SHARE * radius
        lift = min(height, lift if lift < LIFT_STEP else LIFT_STEP * int(lift / LIFT_STEP + 1e-9))
        words = "the product" if lift == height else "a third of the radius, which one pass compacts without a heap"
        found["layer.lift_thickness"] = lift, f"derived: {words}"
    return found


def _geometry(rollers: int, radius: float, width: float, stroke: float) -> Values:
    """Return the positions on the cart [m] and the widths that follow from eqs (1.2) and (1.3)."""
    strip = width / rollers
    outer = strip * (rollers - 1) / 2
    guide = outer + radius
    side_by_side = f"derived: side by side, {width:g} m / {rollers} apart"
    return {
        "machine.roller_positions": ([outer - number * strip for number in range(rollers)], side_by_side),
        "machine.feeder_sleeve": (max(stroke - 2 * radius, 0.0), "derived: stroke less the diameter (eq 1.2)"),
        "machine.overlap": (max(stroke - strip, 0.0), f"derived: stroke less {width:g} m / {rollers} (eq 1.3)"),
        "machine.guide_positions": ([guide, -guide], "guess: a radius beyond the outer rollers"),
        "machine.pin_position": (guide + PIN_REACH * stroke, f"guess: {PIN_REACH} strokes before the front guide"),
        "machine.pin_height": (radius, "guess: the radius"),
        "motion.rod_length": (ROD_REACH * stroke, f"guess: {ROD_REACH:g} strokes"),
    }


def _require_strips(rollers: int, radius: float, width: float, stroke: float) -> None:
    """Require rollers that fit side by side, and a stroke over one strip each."""
    strip = width / rollers
    if stroke < 2 * radius:
        words = f"the stroke of {stroke:g} m is shorter than a roller of {2 * radius:g} m (eq 1.2)"
        raise SceneError([f"{words}; give a longer --stroke or a smaller --diameter, in m"])
    if strip < 2 * radius * (1 - 1e-9):
        words = f"{rollers} rollers of {2 * radius:g} m do not fit side by side on {width:g} m"
        raise SceneError([f"{words}; give --rollers {max(1, int(width / (2 * radius)))} or a smaller --diameter"])
    if not strip * (1 - 1e-9) <= stroke <= 2 * strip:
        words = f"a stroke of {stroke:g} m does not suit {rollers} strips of a plate of {width:g} m (eq 1.3)"
        raise SceneError([f"{words}; give --stroke {strip:.4g} to {2 * strip:.4g} or another --rollers"])


def _with_values(text: str, values: Values) -> str:
    """Replace values of the template, with their origin at the end of their comment."""
    lines, places = text.split("\n"), key_places(text)
    for key, (value, origin) in values.items():
        path = tuple(key.split("."))
        number = places[path][0] - 1
        comment = lines[number].partition("#")[2].strip().removesuffix("; guess")
        lines[number] = f"{path[-1]} = {_toml(value)}".ljust(COLUMN - 1) + f" # {comment}; {origin}"
    return "\n".join(lines)


def _toml(value: Any) -> str:
    """Return a number or list of numbers as TOML writes it, to a nanometre."""
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return repr(value if isinstance(value, int) else round(value, 9) + 0.0)
