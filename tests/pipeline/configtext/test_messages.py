"""The messages that a user sees for a bad configuration, word for word."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pipeline.configtext.document import ConfigError, Document, Problem, load_file, load_text, nearest, problems_from

CONFIGS = Path(__file__).parents[2] / "data" / "config"


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Replay(Strict):
    type: Literal["replay"]
    fps: Annotated[float, Field(gt=0)] | None = None
    speed: Annotated[float, Field(gt=0)] | Literal["max"] = "max"


class Synthetic(Strict):
    type: Literal["synthetic"]
    cameras: list[str] = Field(default=["left", "right"], min_length=2)
    size: tuple[int, int] = (640, 480)


Source = Annotated[Replay | Synthetic, Field(discriminator="type")]


class Fault(Strict):
    type: str
    camera: Annotated[str, Field(pattern="^[a-z0-9_]+$")]
    frames: Annotated[int, Field(ge=1)] = 1


class Judge(Strict):
    sync_tolerance_ms: Literal["auto"] | Annotated[float, Field(gt=0)] = "auto"


class Console(Strict):
    style: Literal["live", "classic"] = "live"


class Zenoh(Strict):
    mode: Literal["peer", "client", "router"] = "peer"
    prefix: str = "syncwatch"
    connect: list[str] = []
    listen: list[str] = []
    required: bool = False


class Sinks(Strict):
    console: Console | None = None
    zenoh: Zenoh | None = None


class Rig(Strict):
    rig: str = "bench"
    source: Source | list[Source]
    faults: list[Fault] = []
    detectors: dict[str, dict[str, Any]] = {}
    judge: Judge = Judge()
    sinks: Sinks = Sinks()


def check(document: Document) -> Rig:
    """The validated configuration; raises the error that a user would see."""
    try:
        return Rig.model_validate(document.data)
    except ValidationError as error:
        raise document.error(problems_from(error, (), Rig)) from None


def complaint(text: str) -> str:
    """What a user reads about this text, without carets and places."""
    document = load_text(text, "c.yaml", {})
    with pytest.raises(ValidationError) as caught:
        Rig.model_validate(document.data)
    lines = str(document.error(problems_from(caught.value, (), Rig))).splitlines()
    return "\n".join(line.partition("error: ")[2] for line in lines if "error: " in line)


def test_a_typo_is_shown_with_its_line_a_caret_and_the_nearest_spelling():
    document = load_text((CONFIGS / "typo.yaml").read_text(), "config.yaml", {})
    with pytest.raises(ConfigError) as caught:
        check(document)
    assert str(caught.value) == (
        "config.yaml:13:5: error: sinks.zenoh.prefx: unknown field - did you mean 'prefix'?\n    prefx: site/a\n    ^"
    )


@pytest.mark.parametrize("expected", sorted(CONFIGS.glob("*.txt")), ids=lambda path: path.stem)
def test_a_bad_file_gets_exactly_the_message_that_stands_beside_it(expected):
    text = expected.with_suffix(".yaml").read_text(encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        check(load_text(text, expected.with_suffix(".yaml").name, {}))
    assert f"{caught.value}\n" == expected.read_text(encoding="utf-8")


def test_every_bad_file_has_its_message():
    assert {path.stem for path in CONFIGS.glob("*.yaml")} == {path.stem for path in CONFIGS.glob("*.txt")}
    assert len(list(CONFIGS.glob("*.yaml"))) >= 15


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}", "source: required, but not given"),
        ("source: {}", "source.type: required, but not given"),
        ("source: 3", "source: expected a mapping or a list, not 3"),
        ("source: {type: replay, fps: x}", "source.fps: expected a number, not 'x'"),
        ("source: [{type: replay, fps: 0}]", "source[0].fps: must be greater than 0, not 0"),
        ("source: [{type: synthetic, size: [1]}]", "source[0].size[1]: required, but not given"),
        ("source: {type: replay, spede: 1}", "source.spede: unknown field - did you mean 'speed'?"),
        ("source: {type: replay, x: 1}", "source.x: unknown field - allowed: type, fps, speed"),
        ("source: {type: synthetic, x: 1}", "source.x: unknown field - allowed: type, cameras, size"),
        ("source: [{type: synthetic, sise: 1}]", "source[0].sise: unknown field - did you mean 'size'?"),
        ("source: {type: replay, size: [1, 1]}", "source.size: unknown field - allowed: type, fps, speed"),
        ("source: {type: synthetic, cameras: [a, 1]}", "source.cameras[1]: expected a text, not 1 - put it in quotes"),
        ("{source: {type: replay}, detectors: {offset: 1}}", "detectors.offset: expected a mapping, not 1"),
    ],
)
def test_the_path_of_a_problem_is_the_path_in_the_data_whatever_unions_lie_between(text, message):
    assert complaint(text) == message


def test_the_prefix_stands_before_every_path():
    with pytest.raises(ValidationError) as caught:
        Zenoh.model_validate({"prefx": 1, "mode": "peer", "connect": [1]})
    problems = problems_from(caught.value, ("sinks", "zenoh"), Zenoh)
    assert {problem.path for problem in problems} == {("sinks", "zenoh", "prefx"), ("sinks", "zenoh", "connect", 0)}


def test_a_missing_key_points_at_the_key_of_the_mapping_that_lacks_it():
    document = load_text("rig: a\nfaults:\n  - type: drop\n  - camera: left\n    type: x\nsource:\n  fps: 1\n", "c", {})
    with pytest.raises(ConfigError) as caught:
        check(document)
    places = [problem.partition(" error")[0] for problem in caught.value.problems]
    assert places == ["c:3:5:", "c:6:1:"]


def test_a_wrong_block_is_shown_at_its_key_and_a_wrong_scalar_where_it_stands():
    document = load_text("a:\n  b: 1\nc:\n  - 1\nd:\n  text\n", "c", {})
    error = document.error([Problem((key,), "wrong") for key in "acd"])
    assert [problem.partition(" error")[0] for problem in error.problems] == ["c:1:1:", "c:3:1:", "c:6:3:"]


def test_problems_stand_in_the_order_of_lines_and_once_each():
    document = load_text("a: 1\nb: 2\nc: 3\n", "c", {})
    late, early = Problem(("c",), "late"), Problem(("a",), "early")
    assert document.error([late, early, late]).problems == (
        "c:1:4: error: a: early\na: 1\n   ^",
        "c:3:4: error: c: late\nc: 3\n   ^",
    )


def test_a_problem_of_an_override_shows_the_argument_with_a_caret_below_its_value():
    document = load_text("source: {type: replay}", "config.yaml", {}, ["source.fps=abc", "source.sped=1"])
    with pytest.raises(ConfigError) as caught:
        check(document)
    assert str(caught.value) == (
        "--set source.fps=abc: error: source.fps: expected a number, not 'abc'\n"
        "                 ^\n"
        "--set source.sped=1: error: source.sped: unknown field - did you mean 'speed'?\n"
        "             ^"
    )


def test_a_problem_deep_in_an_overridden_value_has_its_caret_there():
    document = load_text("source: {type: replay}", "c", {}, ["judge={sync_tolerance_ms: x}"])
    with pytest.raises(ConfigError) as caught:
        check(document)
    first, caret = str(caught.value).splitlines()
    assert first.startswith("--set judge={sync_tolerance_ms: x}: error: judge.sync_tolerance_ms: expected")
    assert first[len(caret) - 1] == "x"


def test_an_override_of_several_lines_stays_on_one_line_and_has_no_caret():
    document = load_text("source: {type: replay}", "c", {}, ["judge=\n  sync_tolerance_ms: x"])
    with pytest.raises(ConfigError) as caught:
        check(document)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(("before", "width"), [("\t", "\t"), ("日本", "    "), ("e\u0301", " "), ("é", " ")])
def test_the_caret_stands_below_its_character_whatever_stands_before_it(before, width):
    document = load_text(f'{{"{before}": 1, b: 2}}', "c", {})
    text = str(document.error([Problem(("b",), "wrong")]))
    assert text.splitlines()[-1] == "  " + width + " " * len('": 1, b: ') + "^"


def test_characters_that_move_the_cursor_are_not_printed():
    document = load_text('a: "\u202e\u2066evil"', "c", {})
    text = str(document.error([Problem(("a",), "wrong")]))
    assert not re.search("[\u202e\u2066]", text)
    assert "evil" in text


def test_the_nearest_word_is_asked_for_and_else_all_are_listed():
    assert nearest("prefx", ["mode", "prefix"]) == " - did you mean 'prefix'?"
    assert nearest("PREFIX", ["mode", "prefix"]) == " - did you mean 'prefix'?"
    assert nearest("q", ["mode", "prefix"]) == " - allowed: mode, prefix"
    assert nearest("q", []) == ""


def test_a_file_and_its_text_get_the_same_message():
    path = CONFIGS / "duplicate.yaml"
    with pytest.raises(ConfigError) as from_file:
        load_file(path, {})
    with pytest.raises(ConfigError) as from_text:
        load_text(path.read_text(), str(path), {})
    assert str(from_file.value) == str(from_text.value)
