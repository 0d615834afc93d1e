"""The JSON schema of a configuration, put together from the models of every kind."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic.json_schema import models_json_schema

from pipeline.config import Config
from pipeline.plan import Kinds
from pipeline.settings import Settings

OWN = {"type": "object", "properties": {"type": {"type": "string", "pattern": ":"}}, "required": ["type"]}
"""An entry whose type is a class of the user's own, `my_module:MyClass`."""


def config_schema(kinds: Kinds) -> dict[str, Any]:
    """A JSON schema (2020-12) that editors check and complete config.yaml with."""
    models: list[type[Settings]] = [
        Config,
        *(kind.settings for table in kinds.tables.values() for kind in table.values()),
    ]
    references, definitions = models_json_schema([(model, "validation") for model in models])
    schema: dict[str, Any] = definitions["$defs"].pop(Config.__name__)
    properties = schema["properties"]
    refs = {
        section: {name: references[(kind.settings, "validation")] for name, kind in table.items()}
        for section, table in kinds.tables.items()
    }
    entry = {section: {"anyOf": [*_typed(refs[section]), *([OWN] if section in kinds.own else [])]} for section in refs}
    properties["source"] = {"anyOf": [entry["source"], {"type": "array", "items": entry["source"], "minItems": 1}]}
    properties["faults"] = {"type": "array", "items": entry["faults"], "default": []}
    for section in ("detectors", "sinks"):
        named = {name: {"anyOf": [ref, {"type": "null"}]} for name, ref in refs[section].items()}
        properties[section] = {"type": "object", "properties": named, "additionalProperties": entry[section]}
    properties["pairs"] = {
        "type": "array",
        "items": {
            "anyOf": [{"type": "string", "pattern": "^[a-z0-9_]+-[a-z0-9_]+$"}, {"$ref": "#/$defs/PairSettings"}]
        },
    }
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "$defs": definitions["$defs"]}


def _typed(references: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Each kind's model, with the `type` that an entry must give to mean it."""
    return [{"allOf": [ref], "required": ["type"]} for ref in references.values()]
