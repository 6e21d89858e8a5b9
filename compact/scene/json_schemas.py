"""JSON schemas of scenes and of summary.json.

The schema of scenes follows from the tables of `compact.scene.schema`: keys, types, bounds, choices, defaults and
meanings. Editors complete and check the keys of a TOML file by it, with a first line

    #:schema scene.schema.json

as language servers of TOML read it. Rules between keys and plausible ranges are no part of it; `compact` checks them.

The schema of summary.json is the data file `summary.schema.json`: it lists all keys of the first level and describes
those that other programs read, recommended laws, rankings, contacts and errors.
"""

import json
from importlib.resources import files
from typing import Any, Literal

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from compact.engines import ENGINES
from compact.machine.drives import DRIVES
from compact.scene.loader import Scene

SCENE_SCHEMA_FILE = "scene.schema.json"  # file next to the scene of `compact new`
DIALECT = "http://json-schema.org/draft-07/schema#"  # the one that editors of TOML read
SchemaName = Literal["scene", "summary"]


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
    definitions["Accuracy"]["properties"]["engine"]["enum"] = list(ENGINES)  # with those of other packages
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


def schema_of(name: SchemaName) -> dict[str, Any]:
    """Return a schema by its name.

    Parameters
    ----------
    name : {"scene", "summary"}
        File that it describes.
    """
    return scene_schema() if name == "scene" else summary_schema()
