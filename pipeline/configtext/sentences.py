"""What pydantic finds wrong with a value, in plain words."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from pipeline.configtext.report import likely, show

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

# What a value of the wrong kind should have been.
_KINDS = {
    "string_type": "a text",
    "string_sub_type": "a text",
    "string_unicode": "a text of valid characters",
    "bytes_type": "a text",
    "path_type": "a path",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_parsing_size": "a whole number of fewer digits",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "decimal_type": "a number",
    "decimal_parsing": "a number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "list_type": "a list",
    "tuple_type": "a list",
    "set_type": "a list",
    "frozen_set_type": "a list",
    "iterable_type": "a list",
    "dict_type": "a mapping",
    "mapping_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "dataclass_type": "a mapping",
    "none_required": "no value",
    "date_type": "a date",
    "date_parsing": "a date",
    "date_from_datetime_parsing": "a date",
    "datetime_type": "a date and time",
    "datetime_parsing": "a date and time",
    "time_type": "a time of day",
    "time_parsing": "a time of day",
    "time_delta_type": "a duration",
    "time_delta_parsing": "a duration",
    "url_type": "a URL",
    "url_parsing": "a URL",
}
# What a value of the right kind must be; the braces name pydantic's context.
_RULES = {
    "greater_than": "be greater than {gt}",
    "greater_than_equal": "be at least {ge}",
    "less_than": "be less than {lt}",
    "less_than_equal": "be at most {le}",
    "multiple_of": "be a multiple of {multiple_of}",
    "string_pattern_mismatch": "match the pattern {pattern}",
    "string_too_short": "have at least {min_length} characters",
    "string_too_long": "have at most {max_length} characters",
    "too_short": "have at least {min_length} entries",
    "too_long": "have at most {max_length} entries",
}
_STATEMENTS = {
    "missing": "required, but not given",
    "missing_argument": "required, but not given",
    "union_tag_not_found": "required, but not given",
    "extra_forbidden": "unknown field",
    "unexpected_keyword_argument": "unknown field",
}
_SINGULAR = {"1 characters": "1 character", "1 entries": "1 entry"}
_ONE = re.compile(r"\b1 (?:characters|entries)$")
_CHOICE = re.compile(r"'((?:[^'\\]|\\.)*)'|\"((?:[^\"\\]|\\.)*)\"|([^\s,]+)")


@dataclass(frozen=True, slots=True)
class Finding:
    """One complaint: a wanted kind, a rule, a set of choices, or a statement that needs no value beside it."""

    sort: Literal["kind", "rule", "choice", "statement"]
    texts: tuple[str, ...]
    value: object
    size: int | None = None


def finding(kind: str, message: str, value: object, context: Mapping[str, Any]) -> Finding:
    """What an error of pydantic's `kind` says about the value; unknown kinds keep pydantic's own message."""
    if kind in _KINDS:
        return Finding("kind", (_KINDS[kind],), value)
    if kind in ("string_too_short", "too_short") and context.get("min_length") == 1:
        return Finding("statement", ("must not be empty",), value)
    if kind in _RULES:
        length = context.get("actual_length")
        return Finding("rule", (_rule(kind, context),), value, length if isinstance(length, int) else None)
    if kind in ("literal_error", "enum"):
        return Finding("choice", _choices(str(context.get("expected", ""))), value)
    if kind == "union_tag_invalid":
        return Finding("choice", _choices(str(context.get("expected_tags", ""))), context.get("tag"))
    if kind in ("value_error", "assertion_error"):
        own = context.get("error")
        text = str(own) if own is not None else re.sub(r"^(Value|Assertion) (error|failed), ", "", message)
        return Finding("statement", (text or "is not valid",), value)
    return Finding("statement", (_STATEMENTS.get(kind, message),), value)


def sentence(findings: Sequence[Finding]) -> tuple[str, str | None]:
    """One sentence, and a hint if there is one, for all that was found at one place."""
    texts = {sort: _of(findings, sort) for sort in ("statement", "rule", "kind", "choice")}
    value, choices = findings[0].value, texts["choice"]
    if texts["statement"]:
        return "; ".join(texts["statement"]), None
    hint = likely(value, choices) if isinstance(value, str) else None
    if texts["rule"]:
        size = next((item.size for item in findings if item.size is not None), None)
        found = show(value) if size is None else f"{size}"
        return f"must {_either([*texts['rule'], *(f'be {show(name)}' for name in choices)])}, not {found}", hint
    if len(choices) > 1 and not texts["kind"] and value is not None:
        return f"{show(value)} is not one of: {', '.join(choices)}", hint
    wanted = list(texts["kind"])
    if len(choices) > 1:
        wanted.append(f"one of: {', '.join(choices)}")
    elif choices:
        wanted.append(show(choices[0]))
    found = ", but nothing is given" if value is None else f", not {show(value)}"
    return f"expected {_either(wanted)}{found}", hint or _quoting_hint(value, texts["kind"])


def _of(findings: Sequence[Finding], sort: str) -> list[str]:
    return list(dict.fromkeys(text for item in findings if item.sort == sort for text in item.texts))


def _rule(kind: str, context: Mapping[str, Any]) -> str:
    shown = {name: _number(value) if isinstance(value, float) else value for name, value in context.items()}
    text = _RULES[kind].format_map(shown)
    return _ONE.sub(lambda match: _SINGULAR[match.group()], text)


def _number(value: float) -> str:
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


def _choices(expected: str) -> tuple[str, ...]:
    """The names in pydantic's "'a', 'b' or 'c'"."""
    found = _CHOICE.finditer(expected)
    return tuple(match.group(match.lastindex or 0) for match in found if match.group() != "or")


def _either(texts: Sequence[str]) -> str:
    return " or ".join([", ".join(texts[:-1]), texts[-1]]) if len(texts) > 1 else texts[0]


def _quoting_hint(value: object, wanted: Sequence[str]) -> str | None:
    """Quotes too many or too few are the commonest reason for a wrong kind."""
    if "a text" in wanted and isinstance(value, (bool, int, float)):
        return "put it in quotes"
    if isinstance(value, str) and any("number" in kind for kind in wanted):
        try:
            number = float(value)
        except ValueError:
            return None
        return f"write {_number(number)} without quotes"
    return None
