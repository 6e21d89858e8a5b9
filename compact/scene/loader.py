"""The scene: machine, product, mix, layer, motion, drive; read from TOML, validated once, immutable.

    scene = load_scene("loveikin-2015")
    wetter = scene.replaced(**{"mix.moisture": 0.11})

SI units; every physical number is stated in the file, none has a default here. `load_scene`, `parse_scene` and
`Scene.replaced` are the only constructors. They validate the fields and the rules between them, and report all
mistakes of one file together.

The JSON schema of scenes follows from the tables of `compact.scene.schema`: keys, types, bounds, choices, defaults and
meanings. Editors complete and check the keys of a TOML file by it, with a first line

    #:schema scene.schema.json

as language servers of TOML read it. Rules between keys and plausible ranges are no part of it. The schema of
summary.json is the data file `summary.schema.json`.
"""

import json
import math
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from hashlib import sha256
from importlib.resources import files
from operator import attrgetter
from pathlib import Path
from typing import Any, Self

from pydantic import PrivateAttr, ValidationError
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from compact.engines import BUILT_IN, ENGINES
from compact.engines.interface import Engine, Limit
from compact.files import checksum, scene_file
from compact.machine.drives import DRIVES
from compact.material.mix import is_same_state
from compact.scene import errors, plausible_ranges
from compact.scene.constraints import ADVICE, RULES, Rule, adapt, files_exist, replaced, sentences, value_at
from compact.scene.errors import Key, Mistake, SceneError, Source
from compact.scene.schema import LAW_NAMES, SceneTables, extra_of

__all__ = ["LAW_NAMES", "Scene", "SceneError", "load_scene", "parse_scene", "read_change"]


AUTO = "auto"  # engine that `choose_engine` replaces
ENGINE: Key = ("accuracy", "engine")  # its key
SIZES = ("machine.roller_radius", "mix.density_ratio", "layer.fed_density_ratio")  # of the height over contact length
FILE_KEYS = ("drive.catalogue.file",)  # whose values are names of files
UNHASHED = {"title", "unusual", "output"}  # keys and tables on which no number depends
LONGEST_NAME = 100  # [characters], of changed values in the name of a folder
MEASURED_SPREAD = 0.1  # [-], half-width of a measured value whose comment has no ±, over it
KNOWN_ORIGINS = ("measured", "given", "published")  # first words of the comment on a value that is not assumed
SPREAD = re.compile(r"(?:±|\+/?-) *(\d[\d.]*(?:[eE][+-]?\d+)?) *(%|[\w/]*)")  # of a value, in its comment


class Scene(SceneTables):
    """One machine with one mix and one motion. Scenes compare by content, not by origin."""

    _source: Source = PrivateAttr(default_factory=Source)

    @property
    def law_names(self) -> tuple[str, ...]:
        """Names of the motion laws to compare, with "all" expanded."""
        return LAW_NAMES if "all" in self.motion.laws else self.motion.laws

    @property
    def table_paths(self) -> tuple[Path, ...]:
        """Paths of the motion laws that are given as tables."""
        return tuple(self._source.folder / name for name in self.motion.tables)

    @property
    def catalogue_path(self) -> Path | None:
        """Path of the motors of `[drive.catalogue]`; None without the table or its file."""
        table = self.drive.catalogue
        return None if table is None or table.file is None else self._source.folder / table.file

    @property
    def lift_thickness(self) -> float:
        """Thickness of one compacted lift [m]: that of `[layer]`, or the height of the product."""
        return self.layer.lift_thickness or self.product.height

    @property
    def sleeve_distances(self) -> tuple[float, float]:
        """Distance D from the axle back to the edge of fresh mix at the near and at the far end [m].

        By default the radius: a sleeve that embraces its roller ends about at its flank.
        """
        ends = self.machine.sleeve_distance or (self.machine.roller_radius,)
        return ends[0], ends[-1]

    @property
    def target(self) -> dict[str, float]:
        """Prescribed indentation [m], load of one roller [N] or peak pressure [Pa] of `[contact]` by name, or empty."""
        return {} if self.contact is None else self.contact.model_dump(exclude={"speeds", "held"}, exclude_none=True)

    @property
    def mean_speed(self) -> float:
        """Mean speed of the cart in one pass [m/s]: stroke over duration, without dwells."""
        return self.motion.stroke / self.motion.duration

    @property
    def compared_engines(self) -> tuple[str, ...]:
        """Engines of the comparison; the formulas, and the process of a moving mould, are always among them."""
        given = {} if self.compare is None else self.compare.model_dump(exclude_none=True)
        strokes = ["process"] if self.process is not None and self.process.mould_speed else []
        return tuple(each for each in dict.fromkeys(["formula", *given, *strokes]) if each != self.accuracy.engine)

    @classmethod
    def load(cls, path: str | Path, /, **changes: object) -> Self:
        """Read a scene from a TOML file.

        Parameters
        ----------
        path : str or Path
            Scene file, or name of a published scene, such as "loveikin-2015".
        **changes : object
            Values by key path that replace keys of the file, such as `**{"mix.moisture": 0.11}`.

        Raises
        ------
        SceneError
            If the file cannot be read or the scene has mistakes; the message lists all of them.
        """
        path = scene_file(path)
        try:
            text = _bytes(path).decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise SceneError([f"{path}: {errors.unreadable_sentence(path, error)}"]) from None
        return cls.parse(text, str(path), **changes)

    @classmethod
    def parse(cls, text: str, file: str = "<text>", **changes: object) -> Self:
        """Read a scene from a TOML text.

        Parameters
        ----------
        text : str
            Content of a scene file.
        file : str
            File name for messages; law tables are searched in its folder.
        **changes : object
            As of `load`.
        """
        try:
            data = tomllib.loads(text)
        except (ValueError, RecursionError) as error:  # ValueError: also an integer of thousands of digits
            raise SceneError([f"{file}:{errors.syntax_sentence(error, text)}"]) from None
        if not data:
            raise SceneError([f"{file}: holds no key; `compact new DIR` writes a commented scene"])
        source = Source(file, errors.key_places(text), given=deepcopy(data))
        return cls._checked(data, source, changes, _rules(source))

    @classmethod
    def _checked(
        cls, data: dict[str, Any], source: Source, changes: Mapping[str, object], rules: Iterable[Iterable[Rule]]
    ) -> Self:
        """Return the scene of the changed data, whose fields, rules and compared engines are valid."""
        scene, source, mistakes = cls._validated(data, source, changes)
        for group in rules:  # first a value in other units, which breaks rules as well
            mistakes += sentences(group, data, refused=mistakes)
        if not mistakes:
            scene._source = source
            for engine in scene.compared_engines if scene.compare else ():
                try:
                    scene.with_engine(engine)
                except SceneError as error:
                    said = (each.split(": ", 1)[1] for each in error.mistakes)
                    mistakes += [Mistake(("compare", engine), f"with it {sentence}") for sentence in said]
        if mistakes:
            raise SceneError(source.report(mistakes))
        return scene

    @classmethod
    def _validated(
        cls, data: dict[str, Any], source: Source, changes: Mapping[str, object]
    ) -> tuple[Any, Source, list[Mistake]]:
        """Return the scene of the changed data (None if a field refuses its value), its source and the mistakes."""
        mistakes: list[Mistake] = []
        keys = [tuple(path.split(".")) for path in changes]
        source = replace(source, changes=source.changes.union(keys))
        for key, value in zip(keys, changes.values(), strict=True):
            table, last = data, key[-1]
            for depth, part in enumerate(key[:-1], 1):
                table = table.setdefault(part, {})
                if not isinstance(table, dict):
                    words = f"`{'.'.join(key[:depth])}` is no table, so it has no key `{key[depth]}`"
                    mistakes.append(Mistake(key, words))
                    break
            else:
                if value is None:
                    table.pop(last, None)
                else:
                    table[last] = dict(value) if isinstance(value, dict) else value  # a later change may go into it
        _drop_fits(data, changes)
        if value_at(data, "accuracy.engine") == AUTO:
            data["accuracy"]["engine"], why = choose_engine(data)
            places = {**source.places, ENGINE: (source.line(ENGINE), f"{AUTO}: {why}")}
            source = replace(source, places=places)
        try:
            return cls.model_validate(data), source, mistakes
        except ValidationError as error:
            return None, source, mistakes + errors.field_mistakes(error, cls)

    def _neglected(self, engine: str) -> list[Limit]:
        """Return the limits of the formulas, or of the process, that the scene sets for the engine compared with it."""
        limits = ENGINES[engine].limits if engine in ("formula", "process") else ()
        return [limit for limit in limits if not limit.fixed and limit.value_in(self) not in limit.taken]

    def with_engine(self, engine: str) -> Self:
        """Return the scene of an engine of the comparison, with the keys of `[compare.ENGINE]` and no output items."""
        given = getattr(self.compare, engine, None)
        changes: dict[str, object] = {"accuracy.engine": engine, "compare": None, "output.items": ()}
        if engine == "process" and given is None and self.process is not None and self.process.detail is None:
            changes["process.detail"] = "columns"  # beside a pass it is not asked for in two dimensions
        if self.mix.fitted_at is not None:  # its values are those of the file, not of a caller
            changes["mix.fitted_at"] = self.mix.fitted_at.model_dump()
        changes |= {limit.key: limit.taken[0] for limit in self._neglected(engine)}
        changes |= dict(_flat(given.model_dump(exclude_none=True))) if given else {}
        found = self.replaced(**changes)
        found._source = self._source.of_comparison(engine, found._source)
        return found

    def is_set(self, key: str) -> bool:
        """Return True if the scene file or the caller sets a key such as "machine.gap_geometry"."""
        return value_at(self._given(), key) is not None

    @property
    def engine_reason(self) -> str:
        """Sentence on the engine that "auto" has chosen; empty for a stated one."""
        said = self._source.remark(ENGINE)
        return f"{self.accuracy.engine}: {said}" if said.startswith(f"{AUTO}: ") else ""

    @property
    def replacements(self) -> dict[str, tuple[str, ...]]:
        """Sentences on the values that each engine replaces, by engine."""
        own, fits = self.accuracy.engine, self.mix.fit_remark
        remarks = [f"{own}: {fits}"] if fits else []
        found = {own: (*filter(None, [self.engine_reason]), *adapt(self, own)[1], *remarks)}
        for name in self.compared_engines:
            scene = self.with_engine(name)
            neglected = (replaced(name, limit, limit.value_in(self)) for limit in self._neglected(name))
            remarks = [f"{name}: {scene.mix.fit_remark}"] if scene.mix.fit_remark not in ("", fits) else []
            found[name] = (*neglected, *adapt(scene, name)[1], *remarks)
        return found

    @property
    def advice(self) -> tuple[str, ...]:
        """Sentences on values that are valid but outside the rules of thumb."""
        found = sentences((*ADVICE, *plausible_ranges.ADVICE), self.model_dump(exclude_none=True))
        return tuple(f"{self._source.place(mistake.key)}: {mistake}" for mistake in found)

    @property
    def file(self) -> str:
        """Name of the scene file."""
        return self._source.file

    def remark(self, key: str) -> str:
        """Return the comment on a key in the file, "default" or "changed by the caller"."""
        path = tuple(key.split("."))
        if self._source.is_changed(path):
            return "changed by the caller"
        return self._source.remark(path) if self.is_set(key) else "default"

    def is_marked(self, key: str, word: str) -> bool:
        """Return True if a clause of the comment on a key begins with a word, such as "measured" or "calibrated"."""
        return any(clause.strip().startswith(word) for clause in self.remark(key).split(";"))

    def stated_spread(self, key: str, item: int = 0) -> float | None:
        """Return the half-width that the comment on a known number, or on an item of several, states, over it [-].

        `measured ± 5 %`, `given ± 2e4` in the unit of the key, `measured ± 5 mm` in another one.

        Returns
        -------
        float or None
            0 where a known value has no such words; None for a value that is assumed.
        """
        if not any(self.is_marked(key, word) for word in KNOWN_ORIGINS):
            return None
        if not (found := SPREAD.search(self.remark(key))):
            return 0.0
        width, unit = float(found[1]), found[2]
        if unit == "%":
            return width / 100
        factors = dict(plausible_ranges.OTHER_UNITS.get(extra_of(key).get("unit", "1"), ()))
        value = attrgetter(key)(self)
        return width * factors.get(unit, 1.0) / abs(value[item] if isinstance(value, tuple) else value)

    def measured_spread(self, key: str) -> float | None:
        """Return the half-width over a value that its comment states as measured [-], `MEASURED_SPREAD` without ±."""
        return self.stated_spread(key) or MEASURED_SPREAD if self.is_marked(key, "measured") else None

    @property
    def measured_forces(self) -> float | None:
        """Half-width of the measured forces to which the engine of the scene is fitted [-]; None elsewhere."""
        fit, here = self.mix.fitted_at, (self.mix.moisture, self.mix.density_ratio)
        if fit is None or fit.engine != self.accuracy.engine:
            return None
        there = is_same_state((fit.moisture, fit.density_ratio), here)
        return self.measured_spread("mix.fitted_at.parameters") if there else None

    @property
    def known_origins(self) -> dict[str, str]:
        """Comments that state a known origin, by key."""
        keys = map(".".join, self._source.places)
        return {key: self.remark(key) for key in keys if any(self.is_marked(key, word) for word in KNOWN_ORIGINS)}

    @property
    def hash(self) -> str:
        """Hash of every key but `title`, `unusual` and `[output]`, and of the contents of the files that it names."""
        digest = sha256(json.dumps(self.model_dump(exclude_none=True, exclude=UNHASHED), sort_keys=True).encode())
        for found in self.checksums.values():
            digest.update(bytes.fromhex("".join(found)))
        return digest.hexdigest()

    @property
    def owner(self) -> str:
        """Hash, and of a file on a second line that of its path and changed values: whose results a folder holds."""
        path = Path(self.file)
        place = checksum(f"{path.resolve()} {self.changed_values}".encode()) if path.is_file() else ""
        return f"{self.hash}\n{place}".strip()

    @property
    def changed_values(self) -> str:
        """Keys to which the caller gives another value than the file, such as "moisture=0.12", for names of folders."""
        now, before, found = self._given(), self._source.given, []
        for key in sorted(self._source.changes):
            value = value_at(now, key)
            if key[0] not in UNHASHED and value != value_at(before, key):
                short = "none" if value is None else f"{value:g}" if isinstance(value, float) else value
                text = short if isinstance(short, str) else checksum(json.dumps(value).encode())[:8]
                found.append(re.sub(r"[^\w.=+-]+", "_", f"{key[-1]}={text}"))
        return name if len(name := "-".join(found)) <= LONGEST_NAME else checksum(name.encode())[:8]

    @property
    def checksums(self) -> dict[str, tuple[str, ...]]:
        """Checksums of the contents of the files that the scene names, by key."""
        catalogue = () if self.catalogue_path is None else (self.catalogue_path,)
        named = {"motion.tables": self.table_paths, "drive.catalogue.file": catalogue}
        return {key: tuple(checksum(_bytes(path)) for path in paths) for key, paths in named.items()}

    def checksum_of(self, file: str) -> str:
        """Return the checksum of a file that a change of the scene names; empty if it cannot be read."""
        try:
            return checksum(_bytes(self._source.folder / file))
        except SceneError:
            return ""

    def replaced(self, **changes: object) -> Self:
        """Return a new scene, validated like a file, with some keys changed.

        Parameters
        ----------
        **changes : object
            Values by key path; None removes an optional key.

        Raises
        ------
        SceneError
            If the changed scene has mistakes.

        Examples
        --------
        ::

            scene.replaced(**{"mix.moisture": 0.11, "mix.overrides.effective_modulus": None})
        """
        rules = [_involving(changes, group) for group in _rules(self._source)]  # the others hold as they did
        return self._checked(self._given(), self._source, changes, rules)

    def require_fields(self, **changes: object) -> None:
        """Validate changed keys one by one, without the rules between keys.

        Raises
        ------
        SceneError
            If a key is unknown, or its value is out of bounds or implausible.
        """
        data = self._given()
        _, source, mistakes = self._validated(data, self._source, changes)
        mistakes += sentences(_involving(changes, plausible_ranges.REFUSALS), data, refused=mistakes)
        if mistakes:
            raise SceneError(source.report(mistakes))

    def _given(self) -> dict[str, Any]:
        """Return the keys that the scene sets, as nested tables."""
        return self.model_dump(exclude_none=True, exclude_unset=True)


load_scene, parse_scene = Scene.load, Scene.parse


def read_change(text: str) -> tuple[str, object]:
    """Split "KEY=VALUE" into key path and value; the value is TOML or a bare word."""
    key, equals, value = text.partition("=")
    if not (key and equals):
        raise ValueError(f"--set takes KEY=VALUE, such as mix.moisture=0.11, got {text!r}")
    return key.strip(), read_value(value.strip())


def read_value(text: str) -> Any:
    """Return the value of a TOML text, a bare word as it is, or None of an empty text, which removes a key."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text or None


def _bytes(path: str | Path) -> bytes:
    try:
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        raise SceneError([f"{path}: {errors.unreadable_sentence(path, error)}"]) from None


def _flat(keys: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, object]]:
    """Yield (key path, value) of nested tables."""
    for key, value in keys.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _rules(source: Source) -> tuple[Sequence[Rule], ...]:
    return plausible_ranges.REFUSALS, (*RULES, *files_exist(source))


def _involving(changes: Iterable[str], rules: Iterable[Rule]) -> list[Rule]:
    """Return the rules that involve changed keys."""
    keys = [tuple(key.split(".")) for key in changes]
    return [rule for rule in rules if rule.involves(keys)]


def _drop_fits(data: dict[str, Any], changes: Mapping[str, object]) -> None:
    """Drop from `[mix.fitted_at]` the parameters that a caller gives: given values hold as they are."""
    names = value_at(data, "mix.fitted_at.parameters")
    valid = isinstance(names, tuple) and all(isinstance(name, str) for name in names)
    if not valid or any(f"{key}.".startswith("mix.fitted_at.") for key in changes):
        return
    given = {key.rpartition(".")[2] for key in changes}.union(*(new for new in changes.values() if type(new) is dict))
    kept = [name for name in names if name not in given]
    if kept:
        data["mix"]["fitted_at"]["parameters"] = kept
    elif names:
        del data["mix"]["fitted_at"]


def choose_engine(data: Mapping[str, Any]) -> tuple[str, str]:
    """Return the cheapest engine that may size the drive of a scene, of nested tables, and the reason as a clause.

    Irreversible compaction causes most of the resistance, so that an engine must have a density of the fed mix. The
    height of the layer over the contact length is estimated without a contact:

        H/L,    L = sqrt(2 R depth),    depth = H (k/k_fed - 1)

    The model that another engine corrects, columns, needs a fit to forces of a roller as well: without one it has 0.3
    to 0.7 of the resistance by finite elements on lifts of 0.5 to 1.7 contact lengths (R 0.09 m, k_fed 0.85 and 0.94).
    Where no engine may size the drive, it is the last of them.
    """
    sizes = [value_at(data, key) for key in SIZES]
    radius, density_ratio, fed = sizes
    height = value_at(data, "layer.lift_thickness") or value_at(data, "product.height")
    known = all(isinstance(each, float) and each > 0 for each in (*sizes, height))
    strain = density_ratio / fed - 1 if known else 0.0
    ratio = math.sqrt(height / (2 * radius * strain)) if strain > 0 else None
    able = sorted((each for each in BUILT_IN.values() if each.reads(SIZES[-1])), key=lambda each: each.cost)
    against = {each.name: _reason_against(each, data, ratio) for each in able}
    chosen = next((name for name, words in against.items() if not words), able[-1].name)
    passed = [f"{name} has {words}" for name, words in against.items() if words and name != chosen]
    return chosen, "; ".join(["the cheapest that may size this scene", *passed])


def _reason_against(engine: Engine, data: Mapping[str, Any], ratio: float | None) -> str:
    """State what an engine lacks on a scene; empty if nothing."""
    if found := engine.valid(ratio):
        return found
    fitted = {"heckel_slope", "fed_density_ratio"} <= {*(value_at(data, "mix.fitted_at.parameters") or ())}
    fitted = fitted and value_at(data, "mix.fitted_at.engine") in (None, engine.name)
    if not fitted and any(each.low_fidelity == engine.name for each in BUILT_IN.values()):
        return "no fit to forces of a roller"
    for limit in engine.limits:
        given = value_at(data, limit.key)
        if not (given is None or limit.fixed or limit.takes(given, value_at(data, "mix.overrides.steel_friction"))):
            return f"no {limit.key} = {given}"
    return ""


SCENE_SCHEMA_FILE = "scene.schema.json"  # file next to the scene of `compact new`
DIALECT = "http://json-schema.org/draft-07/schema#"  # the one that editors of TOML read


class _TomlSchema(GenerateJsonSchema):
    """Generator for TOML, which has no null: an optional key is absent; and without titles that repeat the keys."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        found = super().default_schema(schema)
        return {key: value for key, value in found.items() if (key, value) != ("default", None)}

    def field_title_should_be_set(self, schema: Any) -> bool:  # noqa: ARG002
        return False


def scene_schema() -> dict[str, Any]:
    """Return the JSON schema of a scene file.

    Returns
    -------
    dict
        Schema of the dialect DIALECT.
    """
    schema = Scene.model_json_schema(schema_generator=_TomlSchema, ref_template="#/definitions/{model}")
    definitions = schema.pop("$defs")
    for table in definitions.values():
        table.pop("title", None)
    definitions["Accuracy"]["properties"]["engine"]["enum"] = [AUTO, *ENGINES]  # with those of other packages
    definitions["Drive"]["properties"]["kind"]["enum"] = list(DRIVES)
    return {"$schema": DIALECT, **schema, "title": "Scene of compact", "definitions": definitions}


def summary_schema() -> dict[str, Any]:
    """Return the JSON schema of summary.json.

    Returns
    -------
    dict
        Schema of the dialect DIALECT.
    """
    return json.loads((files("compact") / "data" / "summary.schema.json").read_text("utf-8"))
