"""The typed scene: machine, product, mix, layer, motion, drive; read from TOML, checked once, immutable.

    scene = load_scene("studies/scenes/loveikin-2015.toml")
    wetter = scene.replaced(**{"mix.moisture": 0.11})

SI units everywhere; every physical number is stated in the file, none has a default here. A scene comes only out of
`load_scene`, `parse_scene` and `Scene.replaced`: these check the fields and the rules between them, and report all
mistakes of one file together.
"""

import json
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import Field, PrivateAttr, ValidationError

from compact.scene import plausible_ranges
from compact.scene.constraints import ADVICE, RULES, Rule, sentences, tables_exist
from compact.scene.engine_capabilities import LIMITS, adapt, replaced
from compact.scene.errors import (
    Mistake,
    SceneError,
    Source,
    field_mistakes,
    key_lines,
    key_remarks,
    syntax_sentence,
    undecodable_sentence,
    unreadable_sentence,
)
from compact.scene.former_names import current_key, current_path, current_tables, current_value
from compact.scene.schema import (
    LAW_NAMES,
    Accuracy,
    Cam,
    Compare,
    Contact,
    Drive,
    Layer,
    Machine,
    Mix,
    Motion,
    Names,
    Output,
    Product,
    Table,
)

__all__ = ["LAW_NAMES", "Scene", "SceneError", "load_scene", "parse_scene", "read_change", "starter_scene"]


class Scene(Table):
    """One machine with one mix and one motion. Two scenes are equal when their content is, wherever they came from."""

    title: str = Field(default="", description="a title in quotes")
    unusual: Names = Field(default=(), description="keys whose values are meant as given, though implausible")
    machine: Machine
    product: Product
    mix: Mix
    layer: Layer
    motion: Motion
    drive: Drive
    cam: Cam | None = None
    contact: Contact | None = None
    accuracy: Accuracy
    compare: Compare | None = None
    output: Output
    _source: Source = PrivateAttr(default_factory=Source)

    @property
    def law_names(self) -> tuple[str, ...]:
        """The laws to compare, "all" spelt out."""
        return LAW_NAMES if "all" in self.motion.laws else self.motion.laws

    @property
    def table_paths(self) -> tuple[Path, ...]:
        """Where the laws given as tables lie."""
        return tuple(self._source.folder / name for name in self.motion.tables)

    @property
    def lift_thickness(self) -> float:
        """Thickness of one compacted lift [m]: that of `[layer]`, or the height of the product."""
        return self.layer.lift_thickness or self.product.height

    @property
    def target(self) -> dict[str, float]:
        """The indentation [m], load on one roller [N] or peak pressure [Pa] that `[contact]` prescribes; else empty."""
        return {} if self.contact is None else self.contact.model_dump(exclude={"speeds", "held"}, exclude_none=True)

    @property
    def mean_speed(self) -> float:
        """Mean speed of the cart in one pass [m/s], dwells left out: stroke over duration."""
        return self.motion.stroke / self.motion.duration

    @property
    def compared_engines(self) -> tuple[str, ...]:
        """The engines that answer beside that of [accuracy]; the formulas beside every engine of a layer."""
        given = {} if self.compare is None else self.compare.model_dump(exclude_none=True)
        return tuple(dict.fromkeys(([] if self.accuracy.engine == "formula" else ["formula"]) + list(given)))

    def with_engine(self, engine: str) -> "Scene":
        """The scene as an engine beside it is given it, for the numbers alone."""
        given = None if self.compare is None else getattr(self.compare, engine)
        changes = {"accuracy.engine": engine, "compare": None, "output.items": ()}
        if engine == "formula":  # compared with every engine, whatever the scene sets for that engine
            changes |= {limit.key: limit.taken[0] for limit in LIMITS[engine] if not limit.fixed}
        for table, keys in (given.model_dump(exclude_none=True) if given else {}).items():
            changes |= {f"{table}.{key}": value for key, value in _flat(keys)}
        return self.replaced(**changes)

    def is_set(self, key: str) -> bool:
        """True if the scene file, or a change by the caller, sets a key such as "machine.gap_geometry"."""
        part: Any = self
        for name in key.split("."):
            if part is None or name not in part.model_fields_set:
                return False
            part = getattr(part, name)
        return True

    @property
    def replacements(self) -> dict[str, tuple[str, ...]]:
        """Sentences on the keys that each engine of the scene is given in place of the scene's, by engine."""
        engines = {self.accuracy.engine: self} | {name: self.with_engine(name) for name in self.compared_engines}
        return {name: (*self._left_out(name), *adapt(scene, name)[1]) for name, scene in engines.items()}

    def _left_out(self, engine: str) -> Iterator[str]:
        """Sentences on the keys that the formulas do not take where they only answer beside another engine."""
        if engine == "formula" != self.accuracy.engine:
            for limit in LIMITS[engine]:
                table, key = limit.key.split(".")
                value = getattr(getattr(self, table), key, None)
                if not limit.fixed and value not in limit.taken:
                    yield replaced(engine, limit, value)

    @property
    def advice(self) -> tuple[str, ...]:
        """Sentences on what is allowed but unusual; empty for a scene within the rules of thumb."""
        found = sentences((*ADVICE, *plausible_ranges.ADVICE), self.model_dump(exclude_none=True))
        return tuple(f"{self._source.place(mistake.key)}: {mistake}" for mistake in found)

    @property
    def file(self) -> str:
        """The name of the file it was read from."""
        return self._source.file

    def remark(self, table: str, key: str) -> str:
        """The comment behind a key of a table in the file, or that the caller has changed it."""
        path = (*table.split("."), key)
        if any(path[: len(change)] == change for change in self._source.changes):
            return "changed by the caller"
        if not self.is_set(".".join(path)):
            return "default"
        return self._source.remarks.get(path, "")

    @property
    def hash(self) -> str:
        """Fingerprint of all that decides a number: every key but `title`, `unusual` and `[output]`, and the tables'
        contents."""
        content = self.model_dump(exclude_none=True, exclude={"title", "unusual", "output"})
        digest = sha256(json.dumps(content, sort_keys=True).encode())
        for path in self.table_paths:
            digest.update(sha256(_bytes(path)).digest())
        return digest.hexdigest()

    def replaced(self, **changes: object) -> "Scene":
        """A new scene, checked like a file, with some keys changed; None takes an optional key out.

        scene.replaced(**{"mix.moisture": 0.11, "mix.overrides.effective_modulus": None})
        """
        keys = [current_key(tuple(key.split("."))) for key in changes]
        rules = [rule for rule in _rules(self._source) if rule.involves(keys)]  # the others hold as they did
        return _checked(self._given(), self._source, changes, rules)

    def refuse_fields(self, **changes: object) -> None:
        """SceneError where a key to be changed is unknown, its field refuses the value or the value is implausible,
        whatever the rules between the keys say of the scene that results."""
        data = self._given()
        source, mistakes = _validated(data, self._source, changes)[1:]
        keys = [current_key(tuple(key.split("."))) for key in changes]
        mistakes += sentences(
            [rule for rule in plausible_ranges.REFUSALS if rule.involves(keys)], data, refused=mistakes
        )
        if mistakes:
            raise SceneError(source.report(mistakes))

    def _given(self) -> dict[str, Any]:
        """The keys that the scene sets, as nested tables."""
        return self.model_dump(exclude_none=True, exclude_unset=True)


def load_scene(path: str | Path, /, **changes: object) -> Scene:
    """The scene in a TOML file, with some keys changed as by `Scene.replaced`; SceneError names all its mistakes."""
    try:
        text = _bytes(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise SceneError([f"{path}:{undecodable_sentence(error)}"]) from None
    return _parsed(text, str(path), changes)


def parse_scene(text: str, file: str = "<text>") -> Scene:
    """The scene in a TOML text; `file` is the name mistakes are reported under, and tables are looked for beside it."""
    return _parsed(text, file, {})


def read_change(text: str) -> tuple[str, object]:
    """Key path and value of "KEY=VALUE"; the value is read as in a scene, or as a bare word."""
    key, equals, value = text.partition("=")
    if not (key and equals):
        raise ValueError(f"--set takes KEY=VALUE, such as mix.moisture=0.11, got {text!r}")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()


def starter_scene() -> str:
    """The text of the commented scene that `compact new` writes."""
    return (files("compact") / "data" / "new.toml").read_text("utf-8")


def _bytes(path: str | Path) -> bytes:
    try:
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        raise SceneError([f"{path}: {unreadable_sentence(path, error)}"]) from None


def _parsed(text: str, file: str, changes: Mapping[str, object]) -> Scene:
    if sentence := _unparsable(text):
        raise SceneError([f"{file}:{sentence}"])
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: also an integer of thousands of digits
        raise SceneError([f"{file}:{syntax_sentence(error, text)}"]) from None
    source = current_tables(data, Source(file, key_lines(text), remarks=key_remarks(text)))
    if isinstance(data.get("unusual"), list):
        data["unusual"] = [current_path(key) if isinstance(key, str) else key for key in data["unusual"]]
    return _checked(data, source, changes, _rules(source))


def _unparsable(text: str) -> str:
    if text.startswith("\ufeff"):
        return "1: starts with a byte-order mark; save the file as UTF-8 without BOM"
    if not text.strip():
        return " is empty; `compact new DIR` writes a commented scene to start from"
    return ""


def _flat(keys: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, object]]:
    """(key path, value) of nested tables."""
    for key, value in keys.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _rules(source: Source) -> tuple[Rule, ...]:
    return (*RULES, *plausible_ranges.REFUSALS, tables_exist(source))


def _checked(data: dict[str, Any], source: Source, changes: Mapping[str, object], rules: Iterable[Rule]) -> Scene:
    scene, source, mistakes = _validated(data, source, changes)
    mistakes += sentences(rules, data, refused=mistakes)
    if not mistakes:
        scene._source = source
        mistakes = [
            Mistake(("compare", engine), said) for engine in scene.compared_engines for said in _refused(scene, engine)
        ]
    if mistakes:
        raise SceneError(source.report(mistakes))
    return scene


def _refused(scene: Scene, engine: str) -> Iterator[str]:
    """What an engine beside is given and cannot take."""
    if scene.compare is None:
        return
    try:
        scene.with_engine(engine)
    except SceneError as error:
        yield from (f"with it {said.split(': ', 1)[1]}" for said in error.mistakes)


def _validated(
    data: dict[str, Any], source: Source, changes: Mapping[str, object]
) -> tuple[Any, Source, list[Mistake]]:
    """The scene of changed `data`, None where a field refuses its value; where it comes from; the mistakes."""
    mistakes: list[Mistake] = []
    for path, value in changes.items():
        key = tuple(current_path(path).split("."))
        mistakes += _change(data, key, current_value(key, value))
        source = source.changed(key)
    try:
        return Scene.model_validate(data), source, mistakes
    except ValidationError as error:
        return None, source, mistakes + field_mistakes(error, Scene)


def _change(data: dict[str, Any], key: tuple[str, ...], value: object) -> list[Mistake]:
    """Put a value, or for None nothing, at a key of nested tables; what stands in the way."""
    for depth, part in enumerate(key[:-1], 1):
        data = data.setdefault(part, {})
        if not isinstance(data, dict):
            return [Mistake(key, f"`{'.'.join(key[:depth])}` is no table, so it has no key `{key[depth]}`")]
    if value is None:
        data.pop(key[-1], None)
    else:
        data[key[-1]] = dict(value) if isinstance(value, dict) else value  # a later change may go into it
    return []
