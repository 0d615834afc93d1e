"""What was learned of a rig survives a round trip through its file, and nothing else gets in."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.detectors.offset.geometry import PRIOR, Memory, design
from pipeline.detectors.offset.rig_file import SavedPair, check_rig_path, load_rig, load_rig_if_any, save_rig
from pipeline.errors import InputError, RunError

as_root = pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")


def pair(**changes):
    return replace(
        SavedPair(
            size=(640, 480),
            terms=np.arange(8) / 100,
            information=np.diag(PRIOR**-2),
            windows=900,
            floor_frames=0.004,
            saved_at_ns=1_790_000_000_123_456_789,
            version="0.1.0",
        ),
        **changes,
    )


def same(one, other):
    plain = ("size", "windows", "floor_frames", "saved_at_ns", "version")
    assert [getattr(one, name) for name in plain] == [getattr(other, name) for name in plain]
    np.testing.assert_array_equal(one.terms, other.terms)
    np.testing.assert_array_equal(one.information, other.information)


"""Without those whose squares vanish."""
number = st.floats(-1e3, 1e3).map(lambda x: x if abs(x) > 1e-9 else 0.0)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    pairs=st.dictionaries(
        st.from_regex("[a-z0-9_]{1,9}-[a-z0-9_]{1,9}", fullmatch=True),
        st.builds(
            lambda size, terms, rows, windows, floor, at, version: SavedPair(
                size, np.array(terms), np.array(rows).reshape(-1, 8).T @ np.array(rows).reshape(-1, 8), windows, floor,
                at, version,
            ),
            st.tuples(st.integers(1, 9999), st.integers(1, 9999)),
            st.lists(number, min_size=8, max_size=8),
            st.lists(number, min_size=8, max_size=8) | st.lists(number, min_size=24, max_size=24),
            st.integers(0, 10**9),
            st.none() | st.floats(0, 10),
            st.integers(0, 4 * 10**18),
            st.text(st.characters(codec="utf-8", exclude_categories=["C"]), max_size=9),
        ),
        max_size=3,
    )
)  # fmt: skip
def test_everything_comes_back_as_it_was_saved(tmp_path, pairs):
    path = tmp_path / "rig.yaml"
    save_rig(path, pairs)
    loaded = load_rig(path)
    assert list(loaded) == list(pairs)
    for name, saved in pairs.items():
        same(loaded[name], saved)


def test_what_a_memory_learned_can_be_saved(tmp_path):
    """A thousand windows of very unequal information: rounding makes it no less than semi-definite."""
    rng = np.random.default_rng(0)
    memory = Memory()
    for _ in range(1000):
        u, v = rng.uniform(-0.5, 0.5, (2, 40))
        columns = design(u, v, -rng.uniform(0, 0.1, 40)) * 640 / 0.05
        memory.learn(columns.T @ columns, columns.T @ columns @ (np.arange(8) / 1000))
    path = tmp_path / "rig.yaml"
    saved = pair(terms=memory.terms, information=memory.information, windows=memory.windows)
    save_rig(path, {"left-right": saved})
    same(load_rig(path)["left-right"], saved)


def test_the_file_can_be_read_by_people(tmp_path):
    path = tmp_path / "rig.yaml"
    save_rig(path, {"left-right": pair(floor_frames=None)})
    lines = [line.strip() for line in path.read_text().splitlines()]
    assert lines[0].startswith("# What syncwatch learned")
    assert lines[1] == "schema: syncwatch.rig.v1"
    assert "size: [640, 480]" in lines
    assert "saved_at: 2026-09-21 14:13:20 UTC" in lines
    assert "terms: {one: 0.0, u: 0.01, v: 0.02, d: 0.03, uv: 0.04, vv: 0.05, vd: 0.06, vrr: 0.07}" in lines
    assert sum(line.startswith(("- [", "- - [")) for line in lines) == 8


def test_saving_replaces_the_file_and_leaves_nothing_else(tmp_path):
    path = tmp_path / "rig.yaml"
    for windows in (1, 2):
        save_rig(path, {"left-right": pair(windows=windows)})
    assert load_rig(path)["left-right"].windows == 2
    assert [entry.name for entry in tmp_path.iterdir()] == ["rig.yaml"]
    assert path.stat().st_mode & 0o777 == 0o644


def test_the_file_behind_a_link_is_replaced_and_its_mode_kept(tmp_path):
    (tmp_path / "real").mkdir()
    real, link = tmp_path / "real" / "rig.yaml", tmp_path / "rig.yaml"
    real.write_text("")
    real.chmod(0o600)
    link.symlink_to(real)
    save_rig(link, {"left-right": pair()})
    assert link.is_symlink()
    assert load_rig(real).keys() == {"left-right"}
    assert real.stat().st_mode & 0o777 == 0o600


def test_an_interrupted_save_keeps_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "rig.yaml"
    save_rig(path, {"left-right": pair()})

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(RunError, match=r"cannot be saved to .*rig\.yaml: No space left on device"):
        save_rig(path, {"left-right": pair(windows=7)})
    assert load_rig(path)["left-right"].windows == 900
    assert [entry.name for entry in tmp_path.iterdir()] == ["rig.yaml"]


def test_without_a_file_there_is_nothing_yet(tmp_path):
    assert load_rig_if_any(tmp_path / "rig.yaml") == {}
    with pytest.raises(InputError, match="No such file"):
        load_rig(tmp_path / "rig.yaml")


def test_a_dangling_link_is_not_taken_for_nothing(tmp_path):
    (tmp_path / "rig.yaml").symlink_to(tmp_path / "gone" / "rig.yaml")
    with pytest.raises(InputError, match="No such file"):
        load_rig_if_any(tmp_path / "rig.yaml")


def test_a_directory_is_no_rig_file(tmp_path):
    with pytest.raises(InputError, match="directory"):
        load_rig_if_any(tmp_path)
    with pytest.raises(InputError, match="is a directory"):
        check_rig_path(tmp_path)
    with pytest.raises(RunError, match="directory"):
        save_rig(tmp_path, {})
    assert not list(tmp_path.parent.glob(f".{tmp_path.name}.*"))


def test_a_folder_that_is_not_there(tmp_path):
    path = tmp_path / "no" / "rig.yaml"
    with pytest.raises(InputError, match="there is no folder"):
        check_rig_path(path)
    with pytest.raises(RunError, match="No such file or directory"):
        save_rig(path, {})
    check_rig_path(tmp_path / "rig.yaml")


@as_root
def test_a_folder_that_may_not_be_written(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="may not be written"):
        check_rig_path(tmp_path / "rig.yaml")
    with pytest.raises(RunError, match="Permission denied"):
        save_rig(tmp_path / "rig.yaml", {})


INFORMATION = "    - [11.111111111111112, 0.0, 0.0"


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("schema: syncwatch.rig.v1", "schema: syncwatch.rig.v2", r"schema 'syncwatch\.rig\.v2', syncwatch\.rig\.v1 is"),
        ("schema: syncwatch.rig.v1\n", "", r"no schema, syncwatch\.rig\.v1 is needed: delete it"),
        ("windows: 900", "windows: -1", r"pairs\.left-right: -1 windows learned"),
        ("windows: 900", "windows: many", r":\d+:\d+: error: pairs\.left-right\.windows: .*'many'"),
        (
            "windows: 900",
            "windows: 900\n    window: 900",
            r"pairs\.left-right\.window: unknown field - did you mean 'windows'",
        ),
        ("size: [640, 480]", "size: [640]", r"pairs\.left-right\.size"),
        ("size: [640, 480]", "size: [640, 0]", r"a picture of 640 x 0 px"),
        ("u: 0.01, ", "", r"pairs\.left-right\.terms: .*the terms must be one, u, v"),
        ("u: 0.01", "u: .nan", r"pairs\.left-right\.terms\.u"),
        ("u: 0.01", "u: .inf", r"pairs\.left-right\.terms\.u"),
        (INFORMATION, INFORMATION.replace("11.1", "-11.1"), r"not positive semi-definite"),
        (INFORMATION, INFORMATION.replace("0.0", "2.0", 1), r"not symmetric"),
        (INFORMATION, INFORMATION.replace("11.111111111111112, ", ""), r"pairs\.left-right\.information"),
        ("floor_frames: 0.004", "floor_frames: -0.004", r"a systematic error of -0\.004 frames"),
        ("left-right:", "left:", r"pairs\.left: "),
        ("pairs:", "pears:", r":2:1: error: pairs: required, but not given"),
    ],
)
def test_one_clear_line_for_what_is_broken(tmp_path, old, new, says):
    path = tmp_path / "rig.yaml"
    save_rig(path, {"left-right": pair()})
    content = path.read_text()
    assert content.count(old) >= 1, content
    path.write_text(content.replace(old, new, 1))
    with pytest.raises(InputError, match=says) as error:
        load_rig(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_cut_anywhere_is_refused(tmp_path):
    path = tmp_path / "rig.yaml"
    save_rig(path, {"left-right": pair(), "left-top": pair()})
    content = path.read_bytes()
    whole, second = len(content.rstrip()), content.index(b"  left-top:")
    for end in [*range(0, whole - 1, 41), second, whole - 4, whole - 1]:
        path.write_bytes(content[:end])
        with pytest.raises(InputError) as error:
            load_rig(path)
        assert len(str(error.value).splitlines()) == 1


def test_what_is_no_text_is_refused(tmp_path):
    path = tmp_path / "rig.yaml"
    for content, says in ((b"\x89PNG", "not a text"), (b"#" * 1_000_001, "larger than"), (b"[1, 2]", "mapping")):
        path.write_bytes(content)
        with pytest.raises(InputError, match=says):
            load_rig(path)


@pytest.mark.parametrize(
    "changes",
    [
        {"terms": np.zeros(7)},
        {"terms": np.full(8, np.nan)},
        {"information": np.zeros((7, 7))},
        {"information": np.full((8, 8), np.inf)},
        {"information": -np.eye(8)},
        {"floor_frames": float("nan")},
        {"size": (0, 480)},
    ],
)
def test_what_could_not_be_loaded_cannot_be_saved(changes):
    with pytest.raises(ValueError):
        pair(**changes)


def test_what_was_learned_suits_scaled_pictures_only():
    assert pair().suits((320, 240))
    assert pair(size=(640, 193)).suits((1226, 370))
    assert not pair().suits((640, 360))
    assert not pair().suits((480, 640))
