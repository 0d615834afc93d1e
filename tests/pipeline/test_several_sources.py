"""A rig of several sources, from its configuration to what is said of it."""

from __future__ import annotations

import time

import pytest
import yaml

from pipeline.cli.common import execute, open_source, read_plan
from pipeline.configtext.document import ConfigError
from pipeline.verdict import Basis, Cause, Event, State, Verdict
from syncwatch import Monitor
from tests.frames import texture
from tests.halves import FPS
from tests.programs import inside, lines_of, write_folders
from tests.streaming import film

SMALL = {"type": "synthetic", "width": 160, "height": 120, "duration_s": 2, "fps": 20}


def write(folder, source, **more):
    text = {"rig": "bench", "source": source, "detectors": {"timestamp": {}, "offset": {}}, "sinks": {}, **more}
    (folder / "rig.yaml").write_text(yaml.safe_dump(text, sort_keys=False))
    return "rig.yaml"


def synthetic(*names, **more):
    return {**SMALL, "cameras": [{"name": name} for name in names], **more}


def written(folder, name):
    lines = lines_of((folder / name).read_text())
    return [line for line in lines if line["schema"] == "syncwatch.verdict.v1"]


@pytest.mark.parametrize(
    ("source", "faults"),
    [
        (synthetic("left", "right"), [{"type": "slip", "camera": "right", "frames": 1, "start_s": 1}]),
        ({"type": "replay", "path": "rec", "fps": 20, "trust_stamps": True}, []),
    ],
    ids=["synthetic", "replay"],
)
def test_a_list_of_one_source_is_that_source(tmp_path, source, faults):
    write_folders(tmp_path / "rec", 20)
    for name, given in (("one", source), ("list", [source])):
        path = write(tmp_path, given, faults=faults, sinks={"jsonl": {"path": f"{name}.jsonl"}})
        assert inside("run", path, cwd=tmp_path).returncode == 0
    assert written(tmp_path, "one.jsonl") == written(tmp_path, "list.jsonl") != []


def rig(**right):
    return [{"type": "tests.halves:Half", "camera": "left"}, {"type": "tests.halves:Half", "camera": "right", **right}]


@pytest.mark.parametrize(("shows_ms", "state", "offset_frames"), [(0, State.SYNC, 0), (-50, State.ASYNC, -1)])
def test_live_cameras_whose_clocks_differ_are_paired_and_judged_by_their_pictures(
    tmp_path, shows_ms, state, offset_frames
):
    plan = read_plan(str(tmp_path / write(tmp_path, rig(clock_ms=37_000, shows_ms=shows_ms))), ())
    decided = []

    def note(report):
        if isinstance(report, Verdict) and report.basis is Basis.CONTENT:
            decided.append(report)

    execute(plan, on_report=note, until=lambda: len(decided) >= 5, stop_after_s=30)
    assert {one.state for one in decided} == {state}
    assert decided[-1].offset_frames == pytest.approx(offset_frames, abs=0.2)
    assert decided[-1].sequence["left"] == decided[-1].sequence["right"]
    assert {item.reason for item in decided[-1].evidence if item.basis is Basis.TIMESTAMPS} == {
        "stamps of different clocks: device@0 and device@1"
    }


def test_when_one_source_dies_its_camera_is_missing_and_the_others_go_on(tmp_path):
    path = str(tmp_path / write(tmp_path, rig(stop_s=1), detectors={"timestamp": {}}))
    reports = []
    execute(
        read_plan(path, ()),
        on_report=reports.append,
        until=lambda: isinstance(reports[-1], Verdict) and reports[-1].frame == 3 * FPS,
        stop_after_s=30,
    )
    events = [report for report in reports if isinstance(report, Event)]
    assert [(one.camera, one.cause) for one in events if one.phase == "onset"] == [("right", Cause.MISSING)]


def test_a_monitor_takes_frames_beside_another_source(tmp_path):
    film(tmp_path / "top.mp4", count=30, fps=FPS)
    source = [
        {"type": "push", "cameras": {"left": FPS}},
        {"type": "video", "cameras": {"top": str(tmp_path / "top.mp4")}},
    ]
    with Monitor({"source": source, "detectors": {"timestamp": {}}}) as monitor:
        for number in range(30):
            monitor.push("left", texture(number))
            time.sleep(1 / FPS)
        said = list(monitor.verdicts(timeout_s=0.5))
    assert {verdict.pair for verdict in said} == {"left-top"}
    assert any(verdict.captured_ns["left"] and verdict.captured_ns["top"] for verdict in said)


def test_recordings_with_clocks_of_their_own_are_one_rig_with_faults_and_pairs(tmp_path):
    ahead = synthetic("c", "d")
    ahead["cameras"] = [{"name": name, "clock": {"offset_ms": 37_000}} for name in ("c", "d")]
    path = write(
        tmp_path,
        [synthetic("a", "b"), ahead],
        pairs=["a-b", "b-c"],
        faults=[{"type": "content_shift", "camera": "c", "frames": -1, "start_s": 0.5}],
        sinks={"jsonl": {"path": "out.jsonl"}},
    )
    done = inside("run", path, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    lines = written(tmp_path, "out.jsonl")
    said = {pair: [line for line in lines if line["pair"] == pair] for pair in ("a-b", "b-c")}
    assert {line["state"] for line in said["a-b"]} <= {"sync", "unknown"}
    assert said["b-c"][-1]["state"] == "async"
    assert said["b-c"][-1]["offset_frames"] == pytest.approx(-1, abs=0.3)
    assert all(line["sequence"]["b"] == line["sequence"]["c"] == line["frame"] for line in said["b-c"])


def test_two_recordings_on_disk_are_one_rig(tmp_path):
    write_folders(tmp_path / "one", 20)
    write_folders(tmp_path / "two", 20)
    source = [
        {"type": "replay", "path": "one", "fps": 20, "cameras": ["a", "b"]},
        {"type": "replay", "path": "two", "fps": 20, "cameras": ["c", "d"]},
    ]
    path = write(tmp_path, source, detectors={"timestamp": {}}, sinks={"jsonl": {"path": "out.jsonl"}})
    assert inside("run", path, cwd=tmp_path).returncode == 0
    lines = written(tmp_path, "out.jsonl")
    assert [line["pair"] for line in lines[:3]] == ["a-b", "a-c", "a-d"]
    assert [line["frame"] for line in lines if line["pair"] == "a-d"] == list(range(20))


def test_commands_take_a_rig_of_several_sources(tmp_path):
    sources = [synthetic("a", "b", duration_s=0.5), synthetic("c", "d", duration_s=0.5)]
    path = write(tmp_path, sources, detectors={"timestamp": {}})
    done = inside("validate", path, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "  source     synthetic, synthetic\n" in done.stdout
    assert "a (20 fps), b (20 fps), c (20 fps), d (20 fps)" in done.stdout
    recorded = inside("record", path, "-o", "out.mcap", "--for", "20s", cwd=tmp_path)
    assert recorded.returncode == 0, recorded.stderr
    for checked in (inside("check", "out.mcap", cwd=tmp_path), inside("check", path, "--for", "10s", cwd=tmp_path)):
        assert checked.returncode in {0, 4}, checked.stderr
        assert "a-d" in checked.stdout


@pytest.mark.parametrize("key", ["source.1.fps", "source[1].fps"])
def test_a_value_of_one_source_is_set_by_its_number(tmp_path, key):
    path = str(tmp_path / write(tmp_path, [synthetic("a", "b"), synthetic("c", "d")]))
    source = open_source(read_plan(path, (f"{key}=5",)))
    source.close()
    assert [camera.fps for camera in source.cameras] == [20, 20, 5, 5]


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("source: []", "c.yaml:1:9: error: source: at least one source is required, but the list is empty"),
        ("source: [5]", "c.yaml:1:10: error: source[0]: expected a mapping with a 'type', not 5"),
        (
            "source:\n- {type: synthetic}\n- {type: syntetic}",
            "c.yaml:3:10: error: source[1].type: unknown type 'syntetic' - did you mean 'synthetic'?",
        ),
        (
            "source:\n- {type: synthetic}\n- {type: synthetic, fsp: 3}",
            "c.yaml:3:21: error: source[1].fsp: unknown field - did you mean 'fps'?",
        ),
        (
            "source:\n- {type: push, cameras: {left: 30, right: 30}}\n- {type: video, cameras: {right: x.mp4}}",
            "c.yaml:3:34: error: source[1].cameras.right: source[0] has a camera 'right', too: "
            "every camera of the rig needs a name of its own",
        ),
        (
            "source:\n- {type: push, cameras: {left: 30}}\n- type: synthetic",
            "c.yaml:3:3: error: source[1].cameras.left: source[0] has a camera 'left', too: "
            "every camera of the rig needs a name of its own",
        ),
    ],
)
def test_what_is_wrong_with_one_of_several_is_told_with_its_place(tmp_path, monkeypatch, text, error):
    (tmp_path / "c.yaml").write_text(f"{text}\ndetectors: {{timestamp: {{}}}}\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError) as caught:
        read_plan("c.yaml", ())
    assert str(caught.value).splitlines()[0] == error


@pytest.mark.parametrize(
    ("sources", "error"),
    [
        (
            "- {type: synthetic, cameras: [{name: right}, {name: b}]}\n- {type: replay, path: rec}",
            "c.yaml:3:3: error: source[1]: source[0] has a camera 'right', too: "
            "every camera of the rig needs a name of its own",
        ),
        (
            "- {type: push, cameras: {a: 30}}\n- {type: replay, path: rec}",
            "c.yaml:3:3: error: source[1]: is a recording, and source[0] is live: what was recorded then cannot be in "
            "sync with what happens now; record all of the rig, or play files as `type: video`",
        ),
        (
            "- {type: synthetic}\n- {type: replay, path: nowhere}",
            "syncwatch: error: source[1]: no such file or folder: {folder}/nowhere",
        ),
        (
            "- {type: push, cameras: {a: 30}}\n- {type: video, cameras: {b: nowhere.mp4}}",
            "syncwatch: error: source[1].cameras.b.url: {folder}/nowhere.mp4: No such file or directory "
            "(wait: true waits for it)",
        ),
    ],
)
def test_what_only_opening_shows_is_told_with_its_source(tmp_path, sources, error):
    write_folders(tmp_path / "rec", 3)
    (tmp_path / "c.yaml").write_text(f"source:\n{sources}\ndetectors: {{timestamp: {{}}}}\n")
    for command in ("run", "validate"):
        done = inside(command, "c.yaml", cwd=tmp_path)
        assert done.returncode == 2
        assert done.stdout == ""
        assert error.replace("{folder}", str(tmp_path)) in done.stderr.splitlines()
        assert "Traceback" not in done.stderr
