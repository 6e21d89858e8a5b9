"""Values of scene keys that each contact engine accepts, and the nearest replacement for the others.

A key that is absent from the scene file has a default. If an engine does not accept the default, it computes with the
nearest accepted value, and the results state the replacement. A key that the scene sets is never replaced: an engine
that does not accept its value refuses the scene. A `fixed` limit has no alternative (half-plane theory has one gap
geometry), so the engine replaces the value in both cases.
"""

from collections.abc import Callable, Iterator
from typing import Any

from compact.engines import BUILT_IN, ENGINES
from compact.engines.interface import Limit

OPTIONAL = (
    "machine.roller_condition",
    "machine.gap_geometry",
    "layer.plies",
    "layer.lower_lift",
    "layer.lift_thickness",
    "contact.indentation",
    "contact.load",
    "contact.peak_pressure",
    "contact.held",
)  # keys that a scene need not have

NAMES = {  # of values, in the sentences about replacements
    ("machine.gap_geometry", "parabola"): "vertical gap to the parabola",
    ("machine.gap_geometry", "circle"): "vertical gap to the circle",
    ("machine.gap_geometry", "deformed"): "gap on the deformed surface",
    ("layer.passes", 1): "one pass",
    ("layer.plies", None): "layer of one ply",
    ("layer.lower_lift", None): "rigid base",
    ("contact.indentation", None): "pressure that the mix needs",
}
KINDS = {  # words for values that have no name of their own
    "layer.passes": "{:g} passes",
    "layer.plies": "{} plies",
    "layer.lower_lift": "lower lift",
    "layer.return_stroke": "{} mix under the return stroke",
    "machine.roller_condition": "{} roller",
    "layer.lift_thickness": "lift of {:g} m",
    "contact.indentation": "prescribed depth of {:g} m",
    "contact.load": "prescribed load of {:g} N",
    "contact.peak_pressure": "prescribed pressure of {:g} Pa",
    "contact.held": "constant {}",
    "mix.pore_air": "{} pore air",
}


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
        part = getattr(scene, table).model_copy(update={key: limit.taken[0]})
        scene = scene.model_copy(update={table: part})
    return scene, tuple(sentences)


def replaced(engine: str, limit: Limit, value: object) -> str:
    """Return the sentence on a replaced value."""
    return f"{engine}: {_name(limit.key, limit.taken[0])} in place of the {_name(limit.key, value)}, as {limit.why}"


def _name(key, value):
    if isinstance(value, tuple):  # plies
        return KINDS[key].format(len(value))
    if isinstance(value, dict):  # table of the lower lift
        return KINDS[key]
    return NAMES.get((key, value)) or KINDS[key].format(value)


def refusals() -> Iterator[tuple[tuple[str, ...], Callable[..., str | None]]]:
    """Yield (keys, rule) for each key that an engine limits; the value of an absent key is None."""
    for key in dict.fromkeys(limit.key for engine in BUILT_IN.values() for limit in engine.limits):
        yield (key, "accuracy.engine", "mix.overrides.steel_friction"), _refusal(key)


def _refusal(key):
    def broken(value: Any, chosen: str, friction: Any) -> str | None:
        limits = [each for each in ENGINES[chosen].limits if each.key == key and not (each.fixed or each.late)]
        if value is None or all(each.takes(value, friction) for each in limits):
            return None
        limit = limits[0]
        remedies = [f"give {_listed(limit.taken)}"] if any(limit.taken) else []
        remedies += ["take the key out"] if key in OPTIONAL else []
        able = [
            name
            for name, engine in BUILT_IN.items()
            if engine.takes != "process"  # no alternative to an engine of a single pass
            and all(each.takes(value, friction) for each in engine.limits if each.key == key)
        ]
        got = f'"{value}"' if isinstance(value, str) else _name(key, value)
        return (
            f'the engine "{chosen}" takes no {got}, as {limit.why}; {", ".join(remedies)}, or choose accuracy.engine = '
            f"{_listed(able)}"
        )

    return broken


def _listed(values):
    *some, last = [f'"{value}"' if isinstance(value, str) else f"{value}" for value in values]
    return f"{', '.join(some)} or {last}" if some else last
