"""Values of scene keys that each contact engine accepts, and the nearest replacement for the others.

A key that is absent from the scene file has a default. If an engine does not accept the default, it computes with the
nearest accepted value, and the results state the replacement. A key that the scene sets is never replaced: an engine
that does not accept its value refuses the scene. A `fixed` limit has no alternative (half-plane theory has one gap
geometry), so the engine replaces the value in both cases.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any

ENTRY_POINTS = "compact.engines"  # group of entry points by which other packages add engines
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
FORMING_ENGINE = "process"  # engine of all strokes of [process], no alternative to those of a single pass
TORQUE_ENGINES = ("fem", "compaction")  # engines of a roller that sticks and slips under a torque

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


@dataclass(frozen=True)
class Limit:
    """Values of one key that an engine accepts.

    Parameters
    ----------
    taken : tuple
        Accepted values; the first replaces all others.
    why : str
        Reason, as a clause for messages.
    smooth : tuple
        Values accepted only without friction between mix and roller.
    fixed : bool
        True if the engine replaces the value even of a key that the scene sets.
    late : bool
        True if a value is refused only when the contact is computed, because several engines share the scene.
    """

    key: str
    taken: tuple
    why: str
    smooth: tuple = ()
    fixed: bool = False
    late: bool = False

    def value_in(self, scene: Any) -> Any:
        """Return the value of the key in a scene; None where its table is absent."""
        table, key = self.key.split(".")
        return getattr(getattr(scene, table), key, None)

    def takes(self, value: object, friction: float | None) -> bool:
        """Return True if the engine accepts a value.

        Parameters
        ----------
        friction : float or None
            Friction coefficient of the mix on the roller [-]; None for the prior.
        """
        return value in self.taken or (value in self.smooth and friction == 0)


_ONE_MODULUS = Limit("layer.plies", (None,), "it has one modulus for the whole layer")
_ONE_PASS = Limit("layer.passes", (1,), "an elastic layer keeps no trace of a pass")
_FRESH = Limit("layer.return_stroke", ("fresh",), "it compacts no mix that the return stroke could roll over")
_RECOVERS = (_ONE_PASS, _FRESH)
_RIGID_BASE = Limit("layer.lower_lift", (None,), "its layer does not compact, and lies on a rigid base")
_NO_AIR = Limit("mix.pore_air", ("drained",), "its layer has no voids that close", fixed=True)
_ONE_WAY = Limit(
    "mix.pore_air", ("one-way", "drained"), "columns under a held height do not yield to the air", fixed=True
)
_TARGETS = ("indentation", "load", "peak_pressure", "held")
_ONE_MIX = Limit("layer.plies", (None,), "its layer is of one mix")

LIMITS: dict[str, tuple[Limit, ...]] = {
    "formula": (
        Limit("machine.gap_geometry", ("parabola",), "half-plane theory has no other gap", fixed=True),
        Limit("contact.indentation", (None,), "the depth of a contact on a half-plane is not defined", late=True),
        _ONE_MODULUS,
        _RIGID_BASE,
        _NO_AIR,
        *_RECOVERS,
    ),
    "column": (
        Limit("machine.gap_geometry", ("circle", "parabola"), "columns move vertically only", fixed=True),
        Limit(
            "machine.roller_condition", ("frictionless", "free"), "columns carry no shear",
            smooth=("sliding", "driven"),
        ),
        Limit("layer.base", ("bonded",), "mix on a slipping base moves sideways, which no column does"),
        _ONE_MIX,
        _ONE_WAY,
    ),
    "spectral": (
        Limit("machine.gap_geometry", ("circle", "parabola"), "its gap is measured on the undeformed surface"),
        Limit(
            "machine.roller_condition", ("frictionless", "sliding", "driven"),
            "its rollers have no friction or slip everywhere", smooth=("free",),
        ),
        _RIGID_BASE,
        _NO_AIR,
        *_RECOVERS,
    ),
    "fem": (_RIGID_BASE, _NO_AIR, *_RECOVERS),
    "compaction": (_ONE_MIX,),
    "process": (
        Limit("machine.roller_condition", ("free",), "its rollers roll freely over the bed"),
        Limit("machine.gap_geometry", ("deformed",), "its lifts press the deformed surface", fixed=True),
        Limit("layer.base", ("bonded",), "the mix sticks to the base of the mould"),
        Limit("layer.passes", (1,), "the strokes of [process] are its passes"),
        Limit("layer.return_stroke", ("fresh",), "`process.feeds` states the strokes that are fed", fixed=True),
        Limit("layer.lift_thickness", (None,), "the whole height of the product lies under the roller"),
        *(Limit(f"contact.{name}", (None,), "the closure of [process] determines the contact") for name in _TARGETS),
        _ONE_MIX,
        Limit("layer.lower_lift", (None,), "the whole height of the product lies under the roller"),
        Limit("mix.pore_air", ("one-way", "drained"), "its lifts do not yield to the air", fixed=True),
    ),
}  # fmt: skip


BUILT_IN = tuple(LIMITS)  # engines of this package


def installed_engines() -> tuple[str, ...]:
    """Return the names of the engines of other packages: entry points of the group `ENTRY_POINTS`."""
    return tuple(entry_points(group=ENTRY_POINTS).names)


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
    for limit in LIMITS.get(engine, ()):
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
    """Yield (keys, rule) for each limit that a scene can violate; the value of an absent key is None."""
    for engine, limits in LIMITS.items():
        for limit in limits:
            if not limit.fixed and not limit.late:
                keys = (limit.key, "accuracy.engine", "mix.overrides.steel_friction")
                yield keys, _refusal(engine, limit)


def _refusal(engine, limit):
    def broken(value: Any, chosen: str, friction: Any) -> str | None:
        if chosen != engine or value is None or limit.takes(value, friction):
            return None
        remedies = [f"give {_listed(limit.taken)}"] if any(limit.taken) else []
        remedies += ["take the key out"] if limit.key in OPTIONAL else []
        others = {name: [each for each in found if each.key == limit.key] for name, found in LIMITS.items()}
        able = [
            name
            for name, found in others.items()
            if name != FORMING_ENGINE and all(each.takes(value, friction) for each in found)
        ]
        got = f'"{value}"' if isinstance(value, str) else _name(limit.key, value)
        return (
            f'the engine "{engine}" takes no {got}, as {limit.why}; {", ".join(remedies)}, or choose accuracy.engine = '
            f"{_listed(able)}"
        )

    return broken


def _listed(values):
    *some, last = [f'"{value}"' if isinstance(value, str) else f"{value}" for value in values]
    return f"{', '.join(some)} or {last}" if some else last
