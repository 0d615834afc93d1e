"""`--set` arguments: each sets one value, knows its places, and is refused where it does not fit."""

from __future__ import annotations

import pytest

from pipeline.configtext.document import ConfigError, Place, load_text


def data(text, environ=None, *overrides):
    return load_text(text, "c.yaml", environ or {}, overrides).data


def refusal(text, environ=None, *overrides):
    with pytest.raises(ConfigError) as caught:
        load_text(text, "c.yaml", environ or {}, overrides)
    return str(caught.value)


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("a.b=2", {"a": {"b": 2}, "l": [{"x": 1}, {"x": 2}], "n": None}),
        ("a.c.d=x", {"a": {"b": 1, "c": {"d": "x"}}, "l": [{"x": 1}, {"x": 2}], "n": None}),
        ("l[1].x=9", {"a": {"b": 1}, "l": [{"x": 1}, {"x": 9}], "n": None}),
        ("l.0.x=9", {"a": {"b": 1}, "l": [{"x": 9}, {"x": 2}], "n": None}),
        ("l[0]={}", {"a": {"b": 1}, "l": [{}, {"x": 2}], "n": None}),
        ("n.m=[1, two]", {"a": {"b": 1}, "l": [{"x": 1}, {"x": 2}], "n": {"m": [1, "two"]}}),
        ("a={b: 'x=y'}", {"a": {"b": "x=y"}, "l": [{"x": 1}, {"x": 2}], "n": None}),
        ("a=k=v", {"a": "k=v", "l": [{"x": 1}, {"x": 2}], "n": None}),
        ("a=", {"a": None, "l": [{"x": 1}, {"x": 2}], "n": None}),
        ("a=${HOME}", {"a": "${HOME}", "l": [{"x": 1}, {"x": 2}], "n": None}),
        ("a=\n  b: 1\n  c: 2", {"a": {"b": 1, "c": 2}, "l": [{"x": 1}, {"x": 2}], "n": None}),
        ("a=b: 1\nc: 2", {"a": {"b": 1, "c": 2}, "l": [{"x": 1}, {"x": 2}], "n": None}),
        ("7=x", {"a": {"b": 1}, "l": [{"x": 1}, {"x": 2}], "n": None, "7": "x"}),
    ],
)
def test_an_override_sets_one_value(override, expected):
    assert data("{a: {b: 1}, l: [{x: 1}, {x: 2}], n: }", {"HOME": "/root"}, override) == expected


def test_the_last_override_of_a_path_wins():
    assert data("a: 1", None, "a=2", "b.c=1", "b.c=2", "a=3") == {"a": 3, "b": {"c": 2}}


@pytest.mark.parametrize("override", ["foo", "=1", "", "a b=1", "a..b=1", ".a=1", "a.=1", "[0]=1", "a[x]=1", "a[-1]=1"])
def test_an_override_that_is_not_key_and_value_is_refused(override):
    assert refusal("a: [1]", None, override) == f"--set '{override}': expected KEY=VALUE, e.g. --set source.fps=10"


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("l[2]=1", "l[2]: index beyond the end: the list has 2 entries"),
        ("l.x=1", "l: is a list, whose parts are numbered from 0, not named 'x'"),
        ("a.b.c=1", "a.b.c: a.b is 1, not a mapping"),
        ("a[0]=1", "a[0]: a is a mapping, not a list"),
        ("z[0].b=1", "z[0]: z is missing, not a list"),
        ("a={b: 1, b: 2}", "a.b: given twice, first in line 1"),
        ("a=[1", "not valid YAML: expected ',' or ']'"),
        ("a=!!python/none x", "a: the tag !!python/none is not supported here"),
    ],
)
def test_an_override_that_does_not_fit_is_refused(override, message):
    assert refusal("{a: {b: 1}, l: [1, 2]}", None, override).startswith(f"--set {override}: error: {message}")


def test_an_override_of_nothing_but_a_comment_is_refused():
    assert "YAML comment" in refusal("a: 1", None, "a=#fff")


def test_an_overridden_value_may_hold_a_variable_that_is_not_set():
    assert data("a: ${NONE}\nb: {c: '${NONE}'}", None, "a=1", "b={}") == {"a": 1, "b": {}}
    assert "NONE is not set" in refusal("a: ${NONE}", None, "b=1")


def test_a_key_given_twice_is_refused_even_where_it_is_overridden():
    assert "a.b: given twice" in refusal("a: {b: 1, b: 2}", None, "a.b=3")


def test_an_overridden_value_has_its_places_in_the_argument():
    document = load_text("a: {b: {c: 1}}", "c.yaml", {}, ["a.b={d: 2}"])
    label = "--set a.b={d: 2}"
    assert document.place(("a", "b")) == (Place(label, 1, 9), Place(label, 1, 11))
    assert document.place(("a", "b", "d")) == (Place(label, 1, 12), Place(label, 1, 15))
    assert document.place(("a", "b", "c")) == document.place(("a", "b"))
    assert document.place(("a",))[0].label == "c.yaml"


def test_problems_of_text_and_overrides_are_reported_together():
    text = refusal("a: 1\na: 2\nb: ${NONE}", None, "foo", "a.b=1", "c=[")
    for part in (
        "given twice",
        "NONE is not set",
        "--set 'foo': expected",
        "a is 1, not a mapping",
        "--set c=[: error",
    ):
        assert part in text
