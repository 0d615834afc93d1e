"""Messages against their JSON schemas."""

from __future__ import annotations

from functools import cache
from typing import Any

from jsonschema import Draft202012Validator

from pipeline.messages import message_schema


def check(message: Any, name: str) -> None:
    """Raises ValidationError for a message that breaks its schema, or that has a member which is not described."""
    _validator(name).validate(message)


@cache
def _validator(name: str) -> Draft202012Validator:
    schema = _sealed(message_schema(name))
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


def _sealed(schema: Any) -> Any:
    """The schema without room for members that it does not describe."""
    if isinstance(schema, dict):
        inner = {key: _sealed(value) for key, value in schema.items()}
        return {**inner, "additionalProperties": False} if "properties" in schema else inner
    return [_sealed(item) for item in schema] if isinstance(schema, list) else schema
