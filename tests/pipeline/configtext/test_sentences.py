"""The sentence for everything that pydantic can find wrong with a value of a configuration."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from pipeline.configtext.document import Problem, load_text, problems_from


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Judge(Strict):
    sync_tolerance_ms: Literal["auto"] | Annotated[float, Field(gt=0)] = "auto"


def complaint(text: str, model: type[BaseModel]) -> str:
    """What a user reads about this text, without carets and places."""
    document = load_text(text, "c.yaml", {})
    with pytest.raises(ValidationError) as caught:
        model.model_validate(document.data)
    lines = str(document.error(problems_from(caught.value, (), model))).splitlines()
    return "\n".join(line.partition("error: ")[2] for line in lines if "error: " in line)


def field(annotation: Any, value: str) -> str:
    """What a user reads about the value of a field `x` of this type."""
    model = type("Model", (Strict,), {"__annotations__": {"x": annotation}, "__module__": __name__})
    return complaint(f"x: {value}", model)


@pytest.mark.parametrize(
    ("annotation", "value", "message"),
    [
        (str, "5", "expected a text, not 5 - put it in quotes"),
        (str, "on", "expected a text, not true - put it in quotes"),
        (str, "[a]", "expected a text, not a list"),
        (str, "", "expected a text, but nothing is given"),
        (str, "2024-01-02", "expected a text, not 2024-01-02"),
        (int, "abc", "expected a whole number, not 'abc'"),
        (int, "2.5", "expected a whole number, not 2.5"),
        (int, "[1]", "expected a whole number, not a list"),
        (Annotated[int, Field(strict=True)], "'10'", "expected a whole number, not '10' - write 10 without quotes"),
        (float, "abc", "expected a number, not 'abc'"),
        (float, "{a: 1}", "expected a number, not a mapping"),
        (Annotated[float, Field(strict=True)], "1e3", "expected a number, not '1e3' - write 1000 without quotes"),
        (Annotated[float, Field(allow_inf_nan=False)], ".inf", "expected a finite number, not inf"),
        (bool, "perhaps", "expected true or false, not 'perhaps'"),
        (bool, "[]", "expected true or false, not a list"),
        (list[int], "a", "expected a list, not 'a'"),
        (tuple[int, ...], "a", "expected a list, not 'a'"),
        (set[int], "a", "expected a list, not 'a'"),
        (dict[str, int], "a", "expected a mapping, not 'a'"),
        (Judge, "a", "expected a mapping, not 'a'"),
        (Judge, "", "expected a mapping, but nothing is given"),
        (Path, "3", "expected a path, not 3"),
        (Annotated[float, Field(gt=0)], "0", "must be greater than 0, not 0"),
        (Annotated[float, Field(ge=0.5)], "0.25", "must be at least 0.5, not 0.25"),
        (Annotated[float, Field(lt=9)], "9", "must be less than 9, not 9"),
        (Annotated[int, Field(le=9)], "10", "must be at most 9, not 10"),
        (Annotated[int, Field(multiple_of=2)], "3", "must be a multiple of 2, not 3"),
        (Annotated[str, Field(pattern="^[a-z]+$")], "A", "must match the pattern ^[a-z]+$, not 'A'"),
        (Annotated[str, Field(min_length=1)], "''", "must not be empty"),
        (Annotated[str, Field(min_length=3)], "ab", "must have at least 3 characters, not 'ab'"),
        (Annotated[str, Field(max_length=1)], "ab", "must have at most 1 character, not 'ab'"),
        (Annotated[list[int], Field(min_length=2)], "[1]", "must have at least 2 entries, not 1"),
        (Annotated[list[int], Field(max_length=1)], "[1, 2]", "must have at most 1 entry, not 2"),
        (tuple[int, int], "[1, 2, 3]", "must have at most 2 entries, not 3"),
        (Literal["peer", "client"], "pear", "'pear' is not one of: peer, client - did you mean 'peer'?"),
        (Literal["peer", "client"], "3", "3 is not one of: peer, client"),
        (Literal["or", 2], "x", "'x' is not one of: or, 2"),
        (Literal["peer"], "x", "expected 'peer', not 'x'"),
        (Literal["peer", "client"], "", "expected one of: peer, client, but nothing is given"),
        (
            enum.Enum("Colour", {"RED": "red", "BLUE": "blue"}),
            "rad",
            "'rad' is not one of: red, blue - did you mean 'red'?",
        ),
        (int | None, "abc", "expected a whole number, not 'abc'"),
        (int | list[int], "abc", "expected a whole number or a list, not 'abc'"),
        (Literal["a", "b"] | int, "x", "expected a whole number or one of: a, b, not 'x'"),
        (Literal["auto"] | Annotated[float, Field(gt=0)], "-1", "must be greater than 0 or be 'auto', not -1"),
    ],
)
def test_the_sentence_for_a_wrong_value(annotation, value, message):
    assert field(annotation, value) == f"x: {message}"


def test_a_key_of_the_wrong_kind_is_named_at_its_place():
    class Numbers(Strict):
        x: dict[int, str]

    document = load_text("x:\n  one: a", "c.yaml", {})
    with pytest.raises(ValidationError) as caught:
        Numbers.model_validate(document.data)
    (problem,) = problems_from(caught.value, (), Numbers)
    assert problem == Problem(("x", "one"), "expected a whole number, not 'one'", None, "key")


def test_the_words_of_our_own_validators_stand_alone():
    class Judged(Strict):
        fps: int = 1

        @field_validator("fps")
        @classmethod
        def _even(cls, value: int) -> int:
            if value % 2:
                raise ValueError("an odd rate cannot be halved")
            return value

        @model_validator(mode="after")
        def _whole(self) -> Judged:
            assert self.fps < 10, "too fast for one cable"
            return self

    assert complaint("fps: 3", Judged) == "fps: an odd rate cannot be halved"
    assert complaint("fps: 12", Judged) == "too fast for one cable"


def test_an_error_pydantic_only_knows_keeps_its_message():
    assert field(Annotated[bytes, Field(max_length=1)], "ab") == "x: Data should have at most 1 byte"


def test_among_models_without_a_tag_the_one_with_the_fewest_complaints_speaks():
    class Disk(Strict):
        path: str
        size: int

    class Net(Strict):
        host: str

    class Either(Strict):
        to: Disk | Net

    assert complaint("to: {path: a, size: b}", Either) == "to.size: expected a whole number, not 'b'"
    assert complaint("to: {host: 1}", Either) == "to.host: expected a text, not 1 - put it in quotes"


def test_a_field_is_known_by_its_alias():
    class Aliased(Strict):
        rate: int = Field(default=1, validation_alias="fps")
        rule: Judge = Field(default=Judge(), validation_alias="judge")

    assert complaint("fsp: 1", Aliased) == "fsp: unknown field - did you mean 'fps'?"
    assert complaint("judge: {sync_tolerance: 1}", Aliased).endswith("did you mean 'sync_tolerance_ms'?")
    assert complaint("fps: a", Aliased) == "fps: expected a whole number, not 'a'"
