"""Loading a configuration: what becomes of its text, its variables and its overrides, and what is refused."""

from __future__ import annotations

import datetime as dt
import os
import pickle

import pytest

from pipeline.configtext.document import ConfigError, Place, load_file, load_text
from pipeline.errors import InputError


def data(text, environ=None, *overrides):
    return load_text(text, "c.yaml", environ or {}, overrides).data


def refusal(text, environ=None, *overrides):
    with pytest.raises(ConfigError) as caught:
        load_text(text, "c.yaml", environ or {}, overrides)
    return str(caught.value)


def test_scalars_mean_what_pyyaml_says():
    text = "{a: 1, b: 0x10, c: 1.5, d: yes, e: off, f: ~, g: '1', h: 2024-01-02, i: 1:30, j: '=', k: =, l: <<, m: }"
    assert data(text) == {
        "a": 1, "b": 16, "c": 1.5, "d": True, "e": False, "f": None, "g": "1",
        "h": dt.date(2024, 1, 2), "i": 90, "j": "=", "k": "=", "l": "<<", "m": None,
    }  # fmt: skip


def test_an_alias_repeats_a_value_without_sharing_it():
    loaded = data("{a: &a [1, {b: 2}], c: *a}", None, "a[0]=9")
    assert loaded == {"a": [9, {"b": 2}], "c": [1, {"b": 2}]}


def test_own_keys_win_over_merged_ones_and_earlier_merges_over_later():
    text = "a: &a {x: 1, y: 1}\nb: &b {y: 2, z: 2}\nc: {<<: [*a, *b], x: 3}\nd: &d {<<: *b, z: 9}\ne: {<<: *d}"
    loaded = data(text)
    assert loaded["c"] == {"x": 3, "y": 1, "z": 2}
    assert loaded["e"] == {"y": 2, "z": 9}


def test_a_mapping_cannot_be_merged_into_its_own_part():
    assert "a.b['<<']: a mapping cannot be merged into itself" in refusal("a: &a {b: {<<: *a}}")


def test_only_mappings_merge():
    assert "merges mappings only" in refusal("a: {<<: 3}")


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("${N}", 30), ("'${N}'", "30"), ('"${N}"', "30"), ("${N}fps", "30fps"), ("${N}.5", 30.5), ("!!str ${N}", "30"),
        ("${NONE:-7}", 7), ("${NONE:-}", None), ("'${NONE:-}'", ""), ("${EMPTY:-7}", 7), ("${EMPTY}", None),
        ("${N:-7}", 30),        ("${ON}", True), ("a${N}b${N}", "a30b30"),
        ("$${N}", "${N}"), ("'$${N} ${N}'", "${N} 30"), ("$N $", "$N $"),
        ("${NESTED}", "${N}"), ("${LIST}", "[1, 2]"), ("|-\n  ${N}\n  x", "30\nx"),
        ("${NONE:-a:b}", "a:b"), ("!!int ${N}", 30),
    ],
)  # fmt: skip
def test_variables_in_values(value, expected):
    environ = {"N": "30", "EMPTY": "", "ON": "on", "NESTED": "${N}", "LIST": "[1, 2]"}
    assert data(f"a: {value}", environ) == {"a": expected}


def test_keys_are_never_substituted():
    assert data("${A}: 1", {"A": "x"}) == {"${A}": 1}


def test_every_unset_variable_is_reported_at_its_value():
    text = refusal("a: ${ONE}\nb: [1, '${TWO} ${THREE}']")
    assert "c.yaml:1:4: error: a: environment variable ONE is not set; write ${ONE:-default} to give a default" in text
    assert "c.yaml:2:8: error: b[1]: environment variable TWO is not set" in text
    assert "variable THREE is not set" in text


@pytest.mark.parametrize("value", ["${", "${A", "${}", "${1A}", "${A-b}", "${A B}", "${A:-${B}}"])
def test_a_malformed_variable_is_refused(value):
    assert refusal(f"a: '{value}'", {"A": "x", "B": "x"}).startswith("c.yaml:1:4: error: a: ")


def test_a_value_that_becomes_no_number_is_refused():
    assert "'x' cannot be read as a number" in refusal("a: !!int ${A}", {"A": "x"})


def test_places_are_those_of_key_and_value():
    document = load_text("a:\n  - b: 1\n    c: [x, y]\n", "c.yaml", {})
    assert document.place(("a", 0, "b")) == (Place("c.yaml", 2, 5), Place("c.yaml", 2, 8))
    assert document.place(("a", 0, "c", 1)) == (Place("c.yaml", 3, 12), Place("c.yaml", 3, 12))
    assert document.place(("a",)) == (Place("c.yaml", 1, 1), Place("c.yaml", 2, 3))


def test_a_path_that_does_not_exist_has_the_place_of_the_nearest_above_it():
    document = load_text("a:\n  b: {c: 1}\n", "c.yaml", {})
    assert document.place(("a", "b", "x", 3, "y")) == document.place(("a", "b"))
    assert document.place(("x",)) == (Place("c.yaml", 1, 1), Place("c.yaml", 1, 1))


@pytest.mark.parametrize("line_break", ["\n", "\r\n", "\r", "\x85", "\u2028"])
def test_places_count_the_line_breaks_that_yaml_knows(line_break):
    text = refusal(line_break.join(["a: 1", "b: 2", "a: 3"]))
    assert text == "c.yaml:3:1: error: a: given twice, first in line 1\na: 3\n^"


def test_a_byte_order_mark_is_no_part_of_the_text():
    assert load_text("\ufeffa: 1", "c.yaml", {}).place(("a",))[0] == Place("c.yaml", 1, 1)
    assert data("\ufeffa: 1") == {"a": 1}
    assert refusal("\ufeffa: *b") == "c.yaml:1:4: error: not valid YAML: found undefined alias 'b'\na: *b\n   ^"


def test_aliases_that_multiply_are_stopped_soon():
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n + 1}: &a{n + 1} [{', '.join([f'*a{n}'] * 10)}]" for n in range(30)]
    assert "more than 100000 values" in refusal("\n".join(lines))
    merges = ["a0: &a0 {x: 1}"] + [f"a{n + 1}: &a{n + 1} {{<<: [{', '.join([f'*a{n}'] * 10)}]}}" for n in range(30)]
    assert "more than 100000 values" in refusal("\n".join(merges))


@pytest.mark.parametrize("text", ["a: " + "[" * 5000, "a: " + "{a: " * 5000, "- " * 5000, "? " * 5000])
def test_deep_nesting_is_refused(text):
    assert "nested more than 100 levels deep" in refusal(text)


def test_nesting_that_aliases_deepen_is_refused():
    lines = ["a0: &a0 x"] + [f"a{n + 1}: &a{n + 1} {'[' * 20}*a{n}{']' * 20}" for n in range(200)]
    assert "nested more than 100 levels deep" in refusal("\n".join(lines))
    merges = ["a0: &a0 {x: 1}"] + [f"a{n + 1}: &a{n + 1} {{<<: *a{n}}}" for n in range(2000)]
    assert "nested more than 100 levels deep" in refusal("\n".join(merges))


@pytest.mark.parametrize(
    "value",
    [
        "!!int x",
        "!!bool x",
        "!!timestamp x",
        "!!binary é",
        "!!float x",
        "0b_",
        "2001-13-45",
        "1" * 5000,
        "1:" + "0:" * 400 + "0.5",
    ],
)
def test_a_scalar_that_python_cannot_build_is_refused(value):
    assert refusal(f"a: {value}").startswith("c.yaml:1:4: error: a: ")


def test_an_escape_beyond_unicode_is_refused():
    assert "out of range" in refusal('a: "\\UFFFFFFFF"')


@pytest.mark.parametrize("text", ["", "# only a comment", "---\n", "~", "\n\n"])
def test_an_empty_configuration_names_the_command_that_writes_one(text):
    assert "the configuration is empty - `syncwatch init` writes a starting one" in refusal(text)


def test_a_file_is_loaded_with_variables_and_overrides(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text("a: ${A}\nb: é\n", encoding="utf-8")
    document = load_file(path, {"A": "1"}, ["c=2"])
    assert document.data == {"a": 1, "b": "é", "c": 2}
    assert document.place(("b",))[0] == Place(str(path), 2, 1)


def test_a_file_that_cannot_be_read_is_refused_in_one_line(tmp_path):
    (tmp_path / "latin.yaml").write_bytes("a: 1\nb: é\n".encode("latin-1"))
    (tmp_path / "large.yaml").write_bytes(b"#" * 2_000_000)
    cases = {
        tmp_path / "none.yaml": "does not exist - `syncwatch init`",
        tmp_path: "is a directory, not a file",
        tmp_path / "latin.yaml": "is not UTF-8 text (byte 0xe9 in line 2)",
        tmp_path / "large.yaml": "is larger than 1000 kB",
        tmp_path / "latin.yaml" / "below": "cannot be read: Not a directory",
        "nul\0.yaml": "cannot be read: embedded null byte",
        tmp_path / ("x" * 300): "cannot be read: File name too long",
    }
    for path, message in cases.items():
        with pytest.raises(InputError) as caught:
            load_file(path, {})
        assert message in str(caught.value)
        assert len(str(caught.value).splitlines()) == 1


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads every file")
def test_a_file_without_permission_is_refused(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text("a: 1")
    path.chmod(0)
    with pytest.raises(InputError, match="cannot be read: Permission denied"):
        load_file(path, {})


def test_an_endless_file_is_refused():
    with pytest.raises(InputError, match="larger than"):
        load_file("/dev/zero", {})


def test_the_error_survives_a_process_boundary():
    error = ConfigError(["one", "two", "one"])
    again = pickle.loads(pickle.dumps(error))  # noqa: S301  # our own bytes
    assert str(again) == "one\ntwo"
    assert again.problems == ("one", "two")
