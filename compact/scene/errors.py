"""Mistakes of a scene as sentences: file, line, key path, rule, given value, remedy.

    loveikin.toml:14: machine.roller_radius: must be positive, got -0.11; give the radius in m

A scanner of table headers and keys provides the line; pydantic provides the key and the violated rule.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import date, time
from difflib import get_close_matches
from itertools import takewhile
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from compact.files import published_scenes
from compact.scene.schema import Table, declared_tables, table_of

Key = tuple[str, ...]
LONGEST_SHOWN = 60  # [characters], of a refused value in a message


class SceneError(ValueError):
    """All mistakes of one scene, one line each.

    Parameters
    ----------
    mistakes : iterable of str
        Sentences with file, line and key; kept as the attribute `mistakes`.
    """

    def __init__(self, mistakes: Iterable[str]) -> None:
        self.mistakes = tuple(mistakes)
        super().__init__("\n".join(self.mistakes))

    def __reduce__(self) -> tuple[type["SceneError"], tuple[tuple[str, ...]]]:
        return SceneError, (self.mistakes,)


@dataclass(frozen=True)
class Mistake:
    """Sentence on one key.

    Parameters
    ----------
    sentence : str
        Rule, given value and remedy.
    entry : str
        Position in a list, `[2]`, or in a list of tables, `[2].name`.
    silent : bool
        True if another mistake says it.
    """

    key: Key
    sentence: str
    entry: str = ""
    silent: bool = False

    def __str__(self) -> str:
        return f"{'.'.join(self.key)}{self.entry}: {self.sentence}"


@dataclass(frozen=True)
class Source:
    """Origin of a scene. Two sources always compare equal, so that scenes compare by content.

    Parameters
    ----------
    places : mapping
        Line and comment of each key and table, see `key_places`.
    changes : frozenset
        Key paths that the caller has replaced.
    given : mapping
        Tables of the file.
    """

    file: str = field(default="<text>", compare=False)
    places: Mapping[Key, tuple[int, str]] = field(default_factory=dict, compare=False)
    changes: frozenset[Key] = field(default=frozenset(), compare=False)
    given: Mapping[str, Any] = field(default_factory=dict, compare=False)

    @property
    def folder(self) -> Path:
        """Folder of the scene file."""
        return Path(self.file).parent

    def is_changed(self, key: Key) -> bool:
        """Return True if the caller has replaced a key, or a table around it."""
        return any(key[: len(change)] == change for change in self.changes)

    def of_comparison(self, engine: str, changed: "Source") -> "Source":
        """Return the source of the scene of a compared engine: keys of `[compare.ENGINE]` have their own remarks."""
        own = {key[2:]: place for key, place in self.places.items() if key[:2] == ("compare", engine)}
        remarked = {key for key, (_, remark) in own.items() if remark}
        return replace(changed, places={**self.places, **own}, changes=changed.changes - remarked)

    def _around(self, key: Key) -> Iterator[tuple[int, str]]:
        """Yield line and comment of a key and of the tables around it, the innermost first."""
        return (self.places[key[:length]] for length in range(len(key), 0, -1) if key[:length] in self.places)

    def line(self, key: Key) -> int:
        """Return the line of a key, or of the innermost table around it; 0 if there is none."""
        return next((line for line, _ in self._around(key)), 0)

    def remark(self, key: Key) -> str:
        """Return the comment on a key, or on that of the inline table around it; empty if there is none."""
        return next((remark for _, remark in self._around(key) if remark), "")

    def place(self, key: Key) -> str:
        """Return `file:line` of a key, or `file (changed by the caller)`."""
        if self.is_changed(key):
            return f"{self.file} (changed by the caller)"
        return f"{self.file}:{self.line(key)}" if self.line(key) else self.file

    def report(self, mistakes: Iterable[Mistake]) -> list[str]:
        """Sort mistakes by line and prefix each with its place."""
        ordered = sorted((each for each in mistakes if not each.silent), key=lambda mistake: self.line(mistake.key))
        return [f"{self.place(mistake.key)}: {mistake}" for mistake in ordered]


# --- fields: from pydantic's errors to sentences


PLAIN = {  # words of pydantic in the messages
    "greater than 0$": "positive", "a valid tuple": "a list", "a valid dictionary": "a table",
    "a valid integer": "a whole number", ", unable to parse string as a number": "",
    "a valid boolean": "true or false", "valid ": "", " after validation": "", "match pattern .*": "be a text",
}  # fmt: skip


def field_mistakes(error: ValidationError, scene: type[Table]) -> list[Mistake]:
    """Convert the errors of pydantic on the tables of a scene to mistakes."""
    errors = error.errors(include_url=False)
    # pydantic also reports a list as too short if one of its entries is refused; the entry suffices
    outer = {part["loc"][:length] for part in errors for length in range(len(part["loc"]))}
    tables = dict(declared_tables(scene))
    unknown = [part["loc"] for part in errors if part["type"] == "extra_forbidden"]
    meant = {(*loc[:-1], near) for loc in unknown for near in _near(loc, tables)}  # misspelt, so not missing
    found = [(part, _field_mistake(part, tables)) for part in errors if part["loc"] not in outer]
    return [replace(each, silent=part["type"] == "missing" and part["loc"] in meant) for part, each in found]


def _near(place: tuple[Any, ...], tables: Mapping[Key, type[Table]]) -> list[str]:
    """Return the key that an unknown one at a place resembles, if any."""
    table = tables.get(tuple(part for part in place[:-1] if isinstance(part, str)))
    return [] if table is None else get_close_matches(str(place[-1]), table.model_fields, n=1)


def _field_mistake(error: Mapping[str, Any], tables: Mapping[Key, type[Table]]) -> Mistake:
    place, kind, got = error["loc"], error["type"], f"got {shown(error['input'])}"
    path = tuple(part for part in place if isinstance(part, str))
    key = tuple(takewhile(lambda part: isinstance(part, str), place))
    entry = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place[len(key) :])
    if kind == "extra_forbidden":
        return Mistake(key, _unknown(path, error["input"], tables), entry)
    if kind == "invalid_key":
        return Mistake(key, f"must have texts as keys, {got}")
    info = tables[path[:-1]].model_fields[path[-1]]
    table, header = table_of(info), f"[{'.'.join(path)}]"
    if table and kind == "missing" and not entry:
        words = f"the table {header} is missing; add it with its keys (`compact new DIR` writes a commented scene)"
    elif table and kind == "model_type":
        keys = ", ".join(f"{name} = …" for name in table.model_fields)
        words = f"must be a table, {got}; write {f'{{ {keys} }}' if entry else f'{header} on a line of its own'}"
    else:
        said = "is missing" if kind == "missing" else f"{rule_of(error['msg'])}, {got}"
        words = f"{said}; {_remedy(error, info)}"
    return Mistake(key, words, entry)


def rule_of(message: str) -> str:
    """Return the rule in a message of pydantic in plain words."""
    rule = re.sub(r"^(Input|Tuple|String) should", "must", message)
    for old, new in PLAIN.items():
        rule = re.sub(old, new, rule)
    return rule


def _remedy(error: Mapping[str, Any], info: FieldInfo) -> str:
    kind, value, remedy = error["type"], error["input"], f"give {info.description}"
    if kind == "literal_error" and isinstance(value, str):
        choices = re.findall(r"'([^']+)'", error["ctx"]["expected"])
        if near := get_close_matches(value, choices, n=1):
            return f"did you mean '{near[0]}'?"
    if kind in ("float_type", "int_type") and isinstance(value, str):
        return f"{remedy}, without quotes, decimal comma or unit"
    return f"{remedy} in square brackets" if kind == "tuple_type" else remedy


def shown(value: object) -> str:
    """Return a refused value as TOML writes it, shortened to LONGEST_SHOWN characters."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, date | time):
        return f"the time {value.isoformat()}"
    try:
        text = repr(list(value) if isinstance(value, tuple) else value)
    except ValueError:  # Python prints no integer beyond 4300 digits
        return "a number of thousands of digits"
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}…"


def _within(path: Key) -> str:
    return f"in [{'.'.join(path)}]" if path else "at the top of the file, before any table"


def _unknown(key: Key, value: object, tables: Mapping[Key, type[Table]]) -> str:
    name, here = key[-1], tables[key[:-1]].model_fields
    what = "table" if isinstance(value, dict) else "key"
    unknown = f"unknown {what} {_within(key[:-1])}, got {shown(value)}"
    homes = [_within(path) for path, table in tables.items() if name in table.model_fields]
    if homes:
        return f"{unknown}; `{name}` belongs {' or '.join(homes)}"
    if near := get_close_matches(name, here, n=1):
        return f"{unknown}; did you mean `{near[0]}`?"
    return f"{unknown}; take it out, or choose from {', '.join(here)}"


# --- the text of the file

HEADER = re.compile(r"\s*\[\[?([\w.\"' -]+)\]\]?\s*(?:#.*)?$")
ENTRY = re.compile(r"\s*([\w\"'-]+(?: *\. *[\w\"'-]+)*)\s*=")
COMMENT = re.compile(r"""(?:[^"'#]|"(?:\\.|[^"\\])*"|'[^']*')*#(.*)""")  # behind texts in quotes


def key_places(text: str) -> dict[Key, tuple[int, str]]:
    """Return line and comment of each table header and of each key that begins a line of a TOML text.

    A key inside an inline table has the line and the comment of the key of that table.
    """
    places: dict[Key, tuple[int, str]] = {}
    table: Key = ()
    for number, line in enumerate(text.split("\n"), 1):
        comment = None
        if header := HEADER.match(line):
            path = table = _path(header[1])
        elif entry := ENTRY.match(line):
            path, comment = (*table, *_path(entry[1])), COMMENT.match(line)
        else:
            continue
        for length in range(1, len(path)):
            places.setdefault(path[:length], (number, ""))
        places[path] = number, comment[1].strip("# ") if comment else ""
    return places


def _path(dotted: str) -> Key:
    return tuple(part.strip(" \"'") for part in dotted.split("."))


SLIPS = {  # pattern in the error of tomllib and its line -> remedy
    r"=\s*-?\d+,\d": "write a decimal point in place of the comma",
    r"=\s*-?[\d.e+-]+ *[^\W\d_]": "write the number alone, in SI units, the unit in a comment after #",
    r"=\s*(True|False)$": "write true or false",
    r"Cannot overwrite": "give each key once",
    r"=\s*[a-z][\w-]*$": "write the word in quotes",
    r"Unclosed array": "close the bracket of the list before",
}


def syntax_sentence(error: Exception, text: str) -> str:
    """Return `line: not valid TOML: …` for an error of tomllib, with the offending line where it states one."""
    remedy = "write `key = value`, texts in quotes, units in comments after #; close every quote and bracket"
    at = re.search(r" \(at line (\d+), column (\d+)\)$", str(error))
    if at is None:
        return f" not valid TOML: {error}; {remedy}"
    line = text.split("\n")[int(at[1]) - 1].split(" #")[0].strip()
    remedy = next((words for slip, words in SLIPS.items() if re.search(slip, f"{error} {line}")), remedy)
    return f"{at[1]}: not valid TOML at column {at[2]}: {str(error)[: at.start()]}, got {shown(line)}; {remedy}"


def unreadable_sentence(path: str | Path, error: Exception) -> str:
    """Return the reason why a file cannot be read, with a similar file name in its folder."""
    if isinstance(error, FileNotFoundError):
        known = [*sorted(p.name for p in Path(path).parent.glob("*.toml")), *published_scenes()]
        similar = get_close_matches(Path(path).name, known, n=1)
        hint = f"did you mean '{similar[0]}'?" if similar else "`compact new DIR` writes a scene to start from"
        return f"no such file; {hint}"
    return f"cannot be read: {error}; give the path of a scene file, in UTF-8"
