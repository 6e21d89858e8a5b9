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
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

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
    """

    key: Key
    sentence: str
    entry: str = ""

    def __str__(self) -> str:
        return f"{'.'.join(self.key)}{self.entry}: {self.sentence}"


@dataclass(frozen=True)
class Source:
    """Origin of a scene. Two sources always compare equal, so that scenes compare by content.

    Parameters
    ----------
    changes : frozenset
        Key paths that the caller has replaced.
    """

    file: str = field(default="<text>", compare=False)
    lines: Mapping[Key, int] = field(default_factory=dict, compare=False)
    changes: frozenset[Key] = field(default=frozenset(), compare=False)
    remarks: Mapping[Key, str] = field(default_factory=dict, compare=False)

    @property
    def folder(self) -> Path:
        """Folder of the scene file."""
        return Path(self.file).parent

    def changed(self, key: Key) -> "Source":
        """Return the source with one more key that the caller has replaced."""
        return replace(self, changes=self.changes | {key})

    def of_comparison(self, engine: str, changed: "Source") -> "Source":
        """Return the source of the scene of a compared engine: keys of `[compare.ENGINE]` have their own remarks."""
        table = ("compare", engine)

        def moved(entries: Mapping[Key, Any]) -> dict[Key, Any]:
            return {**entries, **{key[2:]: value for key, value in entries.items() if key[:2] == table}}

        own = {key[2:] for key in self.remarks if key[:2] == table}
        return replace(changed, lines=moved(self.lines), remarks=moved(self.remarks), changes=changed.changes - own)

    def line(self, key: Key) -> int:
        """Return the line of a key, or of the innermost table around it; 0 if there is none."""
        around = (key[:length] for length in range(len(key), 0, -1))
        return next((self.lines[part] for part in around if part in self.lines), 0)

    def place(self, key: Key) -> str:
        """Return `file:line` of a key, or `file (changed by the caller)`."""
        if any(key[: len(change)] == change for change in self.changes):
            return f"{self.file} (changed by the caller)"
        return f"{self.file}:{self.line(key)}" if self.line(key) else self.file

    def report(self, mistakes: Iterable[Mistake]) -> list[str]:
        """Sort mistakes by line and prefix each with its place."""
        ordered = sorted(mistakes, key=lambda mistake: self.line(mistake.key))
        return [f"{self.place(mistake.key)}: {mistake}" for mistake in ordered]


# --- fields: from pydantic's errors to sentences


def field_mistakes(error: ValidationError, scene: type[BaseModel]) -> list[Mistake]:
    """Convert the errors of pydantic to mistakes."""
    errors = error.errors(include_url=False)
    # pydantic also reports a list as too short if one of its entries is refused; the entry suffices
    outer = {part["loc"][:length] for part in errors for length in range(len(part["loc"]))}
    return [_field_mistake(part, scene) for part in errors if part["loc"] not in outer]


def _field_mistake(error, scene):
    path = tuple(part for part in error["loc"] if isinstance(part, str))
    key = tuple(takewhile(lambda part: isinstance(part, str), error["loc"]))
    inside = () if error["type"] == "invalid_key" else error["loc"][len(key) :]
    entry = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in inside)
    return Mistake(key, _field_sentence(path, error, scene), entry)


def _field_sentence(path, error, scene):
    if error["type"] == "extra_forbidden":
        return _unknown(path, error["input"], scene)
    info = dict(_tables(scene))[path[:-1]].model_fields[path[-1]]
    if error["type"] == "model_type" and not table_of(info):
        keys = ", ".join(f"{name} = …" for name in tables_of(info).model_fields)
        return f"must be a table, got {shown(error['input'])}; write {{ {keys} }}"
    if table_of(info):
        return _no_table(path, error)
    return f"{_rule(error, info)}; {_remedy(error, info)}"


def _rule(error, info):
    got = f", got {shown(error['input'])}"
    match error["type"]:
        case "missing":
            return "is missing"
        case "literal_error":
            return f"must be one of {', '.join(_choices(error))}{got}"
        case "too_short" | "too_long":
            low, high = (_limits(info).get(end) for end in ("min_length", "max_length"))
            length = f"exactly {low} entries" if high == low else f"at least {low} entry"
            return f"must have {length}, got {len(error['input'])}"
        case "float_type" if isinstance(error["input"], int) and not isinstance(error["input"], bool):
            return f"must be finite and below 1.8e308{got}"
        case kind if kind in TYPE_WORDS:
            return f"must be {TYPE_WORDS[kind]}{got}"
        case _:
            return f"must be {_bounds(info)}{got}"


TYPE_WORDS = {
    "float_type": "a number",
    "finite_number": "finite",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "a text in quotes",
    "string_unicode": "a text in quotes",
    "tuple_type": "a list",
    "dict_type": "a table",
}


def _remedy(error, info):
    value, meaning = error["input"], info.description
    if error["type"] == "literal_error" and isinstance(value, str):
        near = get_close_matches(value, _choices(error), n=1)
        return f"did you mean '{near[0]}'?" if near else f"give {meaning}"
    if error["type"] in ("float_type", "int_type") and isinstance(value, str):
        return f"give {meaning}, without quotes, decimal comma or unit"
    if error["type"] == "int_type" and isinstance(value, float):
        return f"give {meaning}, without a decimal point"
    return f"give {meaning} in square brackets" if error["type"] == "tuple_type" else f"give {meaning}"


def _choices(error):
    return re.findall(r"'([^']+)'", error["ctx"]["expected"])


def _limits(info):
    """Return the bounds of a field, such as {"ge": 0.9, "le": 0.99} or {"min_length": 2}."""
    names = ("gt", "ge", "lt", "le", "min_length", "max_length")
    return {name: getattr(part, name) for part in info.metadata for name in names if hasattr(part, name)}


def _bounds(info):
    match _limits(info):
        case {"gt": 0, **rest} if not rest:
            return "positive"
        case {"ge": 0, **rest} if not rest:
            return "zero or positive"
        case {"ge": low, "le": high}:
            return f"between {low:.15g} and {high:.15g}"
        case limits:
            words = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
            return " and ".join(f"{words[name]} {bound:.15g}" for name, bound in limits.items())


def shown(value: object) -> str:
    """Return a refused value as TOML writes it, shortened to LONGEST_SHOWN characters."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, date | time):
        return f"the time {value.isoformat()}"
    try:
        text = repr(value)
    except ValueError:  # Python prints no integer beyond 4300 digits
        return "a number of thousands of digits"
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}…"


# --- tables and unknown keys

REMOVED: dict[Key, str] = {  # keys of earlier releases without an equivalent, and the remedy
    ("mix", "reference_speed"): (
        "the yield pressure depends on the rate of compaction, and the Heckel slope is that at rest; take the key out, "
        "and multiply a slope that was measured under a roller by 1 + m ln(1 + rate/reference_rate), about 1.1, with "
        "rate = v ln(k_out/k_in)/contact length in 1/s and m, reference_rate of mix.overrides "
        "(docs/theory/resistance.md)"
    ),
}


def table_of(info: FieldInfo) -> type[BaseModel] | None:
    """Return the table class of a field, or None for a field with a value."""
    return _first_table((info.annotation, *get_args(info.annotation)))


def tables_of(info: FieldInfo) -> type[BaseModel] | None:
    """Return the class of the table, or of the tables in the list, of a field; else None."""
    return _first_table(_kinds(info.annotation))


def _first_table(kinds: Iterable[object]) -> type[BaseModel] | None:
    return next((kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)), None)


def _kinds(annotation: object) -> Iterator[object]:
    yield annotation
    for part in get_args(annotation):
        yield from _kinds(part)


def _tables(model: type[BaseModel], path: Key = ()) -> Iterator[tuple[Key, type[BaseModel]]]:
    yield path, model
    for name, info in model.model_fields.items():
        if inner := tables_of(info):
            yield from _tables(inner, (*path, name))


def _within(path):
    return f"in [{'.'.join(path)}]" if path else "at the top of the file, before any table"


def _no_table(key, error):
    header = f"[{'.'.join(key)}]"
    if error["type"] == "invalid_key":
        return f"must have texts as keys, got {shown(error['loc'][-1])}"
    if error["type"] == "missing":
        return f"the table {header} is missing; add it with its keys (`compact new DIR` writes a commented scene)"
    return f"must be a table, got {shown(error['input'])}; write {header} on a line of its own, its keys below"


def _unknown(key, value, scene):
    if key in REMOVED:
        return f"is no longer a key, got {shown(value)}: {REMOVED[key]}"
    tables = dict(_tables(scene))
    name, here = key[-1], tables[key[:-1]].model_fields
    what = "table" if isinstance(value, dict) else "key"
    unknown = f"unknown {what} {_within(key[:-1])}, got {shown(value)}"
    homes = [_within(path) for path, table in tables.items() if name in table.model_fields]
    if homes:
        return f"{unknown}; `{name}` belongs {' or '.join(homes)}"
    if near := get_close_matches(name, here, n=1):
        return f"{unknown}; did you mean `{near[0]}`?"
    for path, table in tables.items():
        if near := get_close_matches(name, table.model_fields, n=1, cutoff=0.8):
            return f"{unknown}; did you mean `{near[0]}`, which belongs {_within(path)}?"
    return f"{unknown}; take it out, or choose from {', '.join(here)}"


# --- the text of the file

STRING_OR_COMMENT = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}|' r"'''.*?'{3,5}|" r'"(?:\\.|[^"\\\n])*"|' r"'[^'\n]*'|#[^\n]*", re.DOTALL
)
# Possessive repetitions (++) never try again, so that a line of blanks takes linear time
HEADER = re.compile(r"\s*+\[\[?([^\[\]]++)\]")
KEY = re.compile(r"([\w\s.-]++)=(.*)")
INLINE_KEY = re.compile(r"[{,]([\w\s.-]++)=")


def key_lines(text: str) -> dict[Key, int]:
    """Return the line number of each table header and each key of a valid TOML text."""
    lines: dict[Key, int] = {}
    table: Key = ()
    depth = 0  # of brackets open from the lines before
    for number, line in enumerate(STRING_OR_COMMENT.sub(_plain, text).split("\n"), 1):
        if depth == 0 and (header := HEADER.match(line)):
            table = _parts(header[1])
            _note(lines, table, number)
        elif depth == 0 and (key := KEY.match(line)):
            path = (*table, *_parts(key[1]))
            _note(lines, path, number)
            for inline in INLINE_KEY.finditer(key[2]):
                _note(lines, (*path, *_parts(inline[1])), number)
        depth += len(re.findall(r"[\[{]", line)) - len(re.findall(r"[\]}]", line))
    return lines


def key_remarks(text: str) -> dict[Key, str]:
    """Return the comment on the line of each key of a valid TOML text."""
    comments: dict[int, str] = {}
    line, known = 1, 0  # line of the character `known`
    for token in STRING_OR_COMMENT.finditer(text):
        line, known = line + text.count("\n", known, token.start()), token.start()
        if token[0][0] == "#":
            comments[line] = token[0].strip("# ")
    return {key: comments[line] for key, line in key_lines(text).items() if line in comments}


def _plain(match):
    """Remove a comment, and the quotes of a string that can be a key; keep line ends."""
    token = match[0]
    bare = token.strip("\"'")
    word = bare if re.fullmatch(r"[\w-]+", bare) else "_"
    return "" if token[0] == "#" else word + "\n" * token.count("\n")


def _parts(dotted):
    return tuple(part.strip() for part in dotted.split("."))


def _note(lines, path, number):
    for length in range(1, len(path)):
        lines.setdefault(path[:length], number)
    lines[path] = number


def syntax_sentence(error: Exception, text: str) -> str:
    """Return `line: not valid TOML: …` for an error of tomllib, with the offending line."""
    if isinstance(error, RecursionError):
        return " not valid as a scene: brackets nested too deep; no key needs more than a list"
    if str(error).startswith("Exceeds the limit"):
        return " not valid TOML: a whole number has thousands of digits; write it as 1e300 or shorter"
    said = str(error).split(" (at ")[0]
    at = re.search(r"\(at line (\d+), column (\d+)\)$", str(error))
    if at is None:
        return f" not valid TOML: {said}; is a quote or a bracket left open at the end?"
    line = text.split("\n")[int(at[1]) - 1].split(" #")[0].strip()
    rule, remedy = _syntax_words(said)
    return f"{at[1]}: not valid TOML at column {at[2]}: {rule}, got {shown(line)}; {remedy}"


def _syntax_words(said):
    if said.startswith(("Cannot overwrite", "Duplicate")):
        return "a key must be given once", "take one of the two out"
    if said.startswith(("Cannot declare", "Cannot mutate")):
        return "a table must be given once", "put its keys together"
    return said, "write `key = value`, texts in quotes, decimal point, units only in comments after #"


def undecodable_sentence(error: UnicodeDecodeError) -> str:
    """Return `line: not UTF-8 …` for a file in another encoding."""
    line = error.object[: error.start].count(b"\n") + 1
    return f"{line}: not UTF-8 text (byte 0x{error.object[error.start]:02x}); save the file as UTF-8"


def unreadable_sentence(path: str | Path, error: Exception) -> str:
    """Return the reason why a file cannot be read, with a similar file name in its folder."""
    if isinstance(error, FileNotFoundError):
        similar = get_close_matches(Path(path).name, sorted(p.name for p in Path(path).parent.glob("*.toml")), n=1)
        hint = f"did you mean '{similar[0]}'?" if similar else "`compact new DIR` writes a scene to start from"
        return f"no such file; {hint}"
    if isinstance(error, IsADirectoryError):
        return "is a directory; give the scene file in it, DIR/NAME.toml"
    return f"cannot be read: {error}; give the path of a scene file"
