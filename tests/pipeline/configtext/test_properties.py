"""What holds for every configuration text, every data and every override."""

from __future__ import annotations

import copy
import re
import tempfile
from pathlib import Path

import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.configtext.document import ConfigError, Document, Problem, load_file, load_text
from pipeline.errors import InputError

# Pieces that YAML's grammar turns on: random characters hardly ever get past the first token.
PIECES = [
    "a", "b", "1", "-", "- ", ": ", ":", "\n", "\n  ", "\n    ", "\t", "[", "]", "{", "}", ", ", "#", " #",
    "&a ", "*a", "!", "!!int ", "!!str ", "!!python/x ", "|", ">", "'", '"', "\\", "\\x", "\\U0011",
    "%YAML 1.1\n", "%TAG ! a\n", "---\n", "...\n", "? ", "<<: ", "=", "~", "yes", "0x", "0b_", "1_", ".", "1e3",
    ".inf", "1:59", "2001-02-30", "${", "}", "${A}", "${B:-", "$${", "@", "`", "\r", "\x85", "\u2028", "\ufeff",
    "\x00", "\ud800", "é", "日", "!<", ">", "!a!", "%41", "!!binary ", "!!set ", "!!timestamp ", "!!bool ",
    "!!null ",
]  # fmt: skip
yamlish = st.lists(st.sampled_from(PIECES), max_size=30).map("".join)
scalars = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False)
    | st.text()
    | st.sampled_from(["${A}", "=", "<<", "on"])
)
trees = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4), max_leaves=20
)
names = st.from_regex(r"[a-z_][a-z0-9_-]{0,3}", fullmatch=True)
named_trees = st.dictionaries(
    names,
    st.recursive(
        st.none() | st.integers(0, 9) | names,
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(names, inner, max_size=3),
        max_leaves=10,
    ),
    max_size=3,
)


def is_plain(value):
    if isinstance(value, dict):
        return all(isinstance(key, str) and is_plain(item) for key, item in value.items())
    return all(map(is_plain, value)) if isinstance(value, list) else True


def paths(value, path=()):
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from paths(item, (*path, key))


def escape(value):
    """The data as a user has to write it so that ``${`` stays as it is."""
    if isinstance(value, dict):
        return {key: escape(item) for key, item in value.items()}
    if isinstance(value, list):
        return [escape(item) for item in value]
    return value.replace("${", "$${") if isinstance(value, str) else value


def outcome(load, *arguments):
    """The document, or the error that the user sees; every other exception fails the test."""
    try:
        return load(*arguments)
    except InputError as error:
        return error


@given(st.text() | yamlish, st.lists(st.text(max_size=8) | yamlish.map("a.b=".__add__), max_size=2))
@settings(max_examples=1000, deadline=None)
def test_any_text_gives_data_or_one_of_our_errors(text, overrides):
    result = outcome(load_text, text, "c.yaml", {"A": "1", "B": ""}, overrides)
    if isinstance(result, ConfigError):
        assert all(problem.startswith(("c.yaml:", "--set ")) for problem in result.problems)
        assert result.problems
    else:
        assert isinstance(result.data, dict)
        assert is_plain(result.data)


@given(yamlish.filter(lambda text: "${" not in text))
@settings(max_examples=500, deadline=None)
def test_what_is_accepted_is_what_pyyaml_reads(text):
    result = outcome(load_text, text, "c.yaml", {})
    if isinstance(result, Document):
        try:
            expected = yaml.safe_load(text)
        except yaml.constructor.ConstructorError as error:
            # PyYAML reads a lone '=' or '<<' as a kind it cannot build; here it is text.
            expected = result.data if re.search("2002:(value|merge)'", str(error)) else error
        assert result.data == expected


@given(st.binary() | yamlish.map(lambda text: text.encode("utf-8", "replace")))
@settings(deadline=None)
def test_any_bytes_in_a_file_give_data_or_one_of_our_errors(raw):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "c.yaml"
        path.write_bytes(raw)
        result = outcome(load_file, path, {})
    assert str(path) in str(result) if isinstance(result, InputError) else isinstance(result, Document)


@given(st.dictionaries(st.text(), trees, max_size=4), st.sampled_from([None, False, True]))
@settings(deadline=None)
def test_dumped_data_comes_back_unchanged(data, flow):
    text = yaml.safe_dump(escape(data), default_flow_style=flow)
    assert load_text(text, "c.yaml", {}).data == data


@given(st.dictionaries(names, trees, max_size=4))
@settings(deadline=None)
def test_a_problem_anywhere_in_the_data_can_be_shown(data):
    document = load_text(yaml.safe_dump(escape(data)), "c.yaml", {})
    for path in paths(document.data):
        for at in ("key", "value"):
            header = str(document.error([Problem(path, "wrong", at=at)])).splitlines()[0]
            assert header.startswith("c.yaml:")
            assert header.endswith("wrong")


@given(
    named_trees,
    st.data(),
    st.none() | st.integers() | st.booleans() | st.lists(names, max_size=2) | st.dictionaries(names, names),
)
@settings(deadline=None)
def test_an_override_sets_its_path_and_nothing_else(data, draw, value):
    known = [path for path in paths(data) if path]
    grown = [(*path, "new") for path in paths(data) if isinstance(_at(data, path), (dict, type(None)))]
    path = draw.draw(st.sampled_from(known + grown))
    brackets = draw.draw(st.booleans())
    key = "".join(f"[{part}]" if isinstance(part, int) and brackets else f".{part}" for part in path).removeprefix(".")
    expected = copy.deepcopy(data)
    if path in grown and path not in known and _at(expected, path[:-1]) is None:
        _put(expected, path[:-1], {})
    _put(expected, path, value)
    text = yaml.safe_dump(value, default_flow_style=True).removesuffix("...\n").strip()
    assert load_text(yaml.safe_dump(data), "c.yaml", {}, [f"{key}={text}"]).data == expected


def _at(data, path):
    for part in path:
        data = data[part]
    return data


def _put(data, path, value):
    _at(data, path[:-1])[path[-1]] = value
