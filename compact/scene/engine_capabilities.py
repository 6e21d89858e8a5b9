"""Values of scene keys that each contact engine accepts, and the nearest replacement for the others.

A key that is absent from the scene file has a default. If an engine does not accept the default, it computes with the
nearest accepted value, and the results state the replacement. A key that the scene sets is never replaced: an engine
that does not accept its value refuses the scene. A `fixed` limit has no alternative (half-plane theory has one gap
geometry), so the engine replaces the value in both cases.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from compact.engines import BUILT_IN, ENGINES
from compact.engines.interface import Limit


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
    return f"{engine}: {limit.key} {_shown(limit.taken[0])} in place of {_shown(value)}, as {limit.why}"


def _shown(value):
    """Return a value in words; a table and a list of tables by their kind."""
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, int | float):
        return f"{value:g}"
    return "absent" if value is None else f"{len(value)} plies" if isinstance(value, tuple) else "lower lift"


def refusals() -> Iterator[tuple[tuple[str, ...], Callable[..., str | None]]]:
    """Yield (keys, rule) for each key that an engine limits; the value of an absent key is None."""
    for key in dict.fromkeys(limit.key for engine in BUILT_IN.values() for limit in engine.limits):
        yield (key, "accuracy.engine", "mix.overrides.steel_friction"), partial(_refusal, key)


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
    is_number = isinstance(value, int | float)
    got = f"{key.rpartition('.')[2]} of {value:g}" if is_number else _shown(value)
    return (
        f'the engine "{chosen}" takes no {got}, as {limits[0].why}; {remedy}, or choose '
        f"accuracy.engine = {_listed(able)}"
    )


def _listed(values):
    return " or ".join(map(_shown, values))
