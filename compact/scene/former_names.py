"""Former names of scene keys, accepted for one release with a DeprecationWarning that states the new name."""

import warnings
from collections.abc import Iterator, Mapping
from typing import Any

from compact.scene.errors import Key, SceneError, Source

FORMER_KEYS: dict[Key, Key] = {
    ("beside",): ("compare",),
    ("drive", "first_order"): ("drive", "include_added_mass"),
    ("layer", "lift"): ("layer", "lift_thickness"),
    ("machine", "profile"): ("machine", "gap_geometry"),
    ("machine", "rolling"): ("machine", "roller_condition"),
    ("mix", "overrides", "rate_exponent"): ("mix", "overrides", "rate_sensitivity"),
    ("output", "wanted"): ("output", "items"),
}
FORMER_PLY_KEYS = {"stiffness": "relative_modulus"}  # in each table of layer.plies
FORMER_VALUES: dict[Key, dict[str, str]] = {
    ("drive", "motor", "curve"): {"straight": "linear"},
    ("drive", "rank_by"): {"ringing": "dynamic_amplification"},  # an entry of a list
    ("motion", "optimise", "spread"): {"rate_exponent": "rate_sensitivity"},
}
COMPARED = "compare"  # table of tables that repeat the tables of a scene, one for each engine


def current_key(key: Key) -> Key:
    """Present name of a key path.

    Parameters
    ----------
    key : tuple of str
        Key path, part by part, under its present or its former name.
    """
    for former, present in FORMER_KEYS.items():
        if key[: len(former)] == former:
            key = (*present, *key[len(former) :])
    if key[0] == COMPARED and len(key) > 2:
        return (*key[:2], *current_key(key[2:]))
    return key


def current_path(path: str) -> str:
    """Present name of a key path such as "output.wanted"; warns if the path is a former name."""
    present = ".".join(current_key(tuple(path.split("."))))
    if present != path:
        _warn(f"`{path}`", f"`{present}`")
    return present


def current_tables(data: dict[str, Any], source: Source) -> Source:
    """Rename former keys in the nested tables of a scene file in place; warn about each.

    Returns
    -------
    Source
        The source with the lines and remarks of renamed keys under their present names.

    Raises
    ------
    SceneError
        If a key is given under both names.
    """
    for former, present in _former_keys(data):
        parent, name = _parent(data, former), present[-1]
        if name in parent:
            words = f"is the former name of {'.'.join(present)}, which is given too; take one of the two out"
            raise SceneError([f"{source.place(former)}: {'.'.join(former)}: {words}"])
        parent[name] = parent.pop(former[-1])
        _warn(f"{source.place(former)}: `{'.'.join(former)}`", f"`{'.'.join(present)}`")
        source = source.renamed(former, present)
    for key, values in FORMER_VALUES.items():
        parent = _parent(data, key)
        given = parent.get(key[-1])
        for old, new in values.items():
            if given == old or (isinstance(given, list) and old in given):
                parent[key[-1]] = current_value(key, given)
                _warn(f'{source.place(key)}: "{old}" of `{".".join(key)}`', f'"{new}"')
    return source


def current_value(key: Key, value: object) -> object:
    """Present form of a value that a caller gives to a key: renamed choices, and keys inside a table."""
    former = FORMER_VALUES.get(key, {})
    if isinstance(value, str):
        return former.get(value, value)
    if former and isinstance(value, list | tuple):
        return [former.get(entry, entry) if isinstance(entry, str) else entry for entry in value]
    if isinstance(value, Mapping):
        return {current_key((*key, name))[-1]: current_value((*key, name), inner) for name, inner in value.items()}
    if key == ("layer", "plies") and isinstance(value, list | tuple):
        return [_ply(ply) for ply in value]
    return value


def _ply(ply: object) -> object:
    if not isinstance(ply, Mapping):
        return ply
    return {FORMER_PLY_KEYS.get(name, name): value for name, value in ply.items()}


def _former_keys(data: dict[str, Any]) -> Iterator[tuple[Key, Key]]:
    """(former, present) path of each former key, outer tables first, so that inner paths hold present names."""
    for former, present in FORMER_KEYS.items():
        if former[-1] in _parent(data, former):
            yield former, present
    for engine in _parent(data, (COMPARED, "")):
        for former, present in FORMER_KEYS.items():
            if len(former) > 1 and former[-1] in _parent(data, (COMPARED, engine, *former)):
                yield (COMPARED, engine, *former), (COMPARED, engine, *present)
    plies = _parent(data, ("layer", "plies")).get("plies")
    if isinstance(plies, list) and any(isinstance(ply, dict) and ply.keys() & FORMER_PLY_KEYS.keys() for ply in plies):
        data["layer"]["plies"] = [_ply(ply) for ply in plies]
        _warn("`layer.plies[].stiffness`", "`layer.plies[].relative_modulus`")


def _parent(data: Mapping[str, Any], key: Key) -> dict[str, Any]:
    """Table that holds a key; an empty one if there is no such table."""
    table: Any = data
    for part in key[:-1]:
        table = table.get(part) if isinstance(table, Mapping) else None
    return table if isinstance(table, dict) else {}


def _warn(former: str, present: str) -> None:
    warnings.warn(f"{former} is now {present}; the former name is accepted for one release", DeprecationWarning, 4)
