"""Rigs of streams, judged live from a configuration, and what the commands say of those that cannot be read."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from pipeline.cli.common import execute, read_plan
from pipeline.configtext.document import ConfigError
from pipeline.verdict import Basis, Cause, Event, State, Verdict
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import SyntheticSource
from tests.network import wait_for
from tests.programs import inside
from tests.streaming import Streams, film, jpeg, plain

FPS = 20
SECRET = "rosebud"  # noqa: S105 - nobody's


def rendered(count):
    """JPEGs of both cameras of a rig."""
    settings = SyntheticSettings(width=192, height=144, fps=FPS, duration_s=count / FPS)
    source = SyntheticSource(settings, seed=3)
    source.open()
    pictures = {"left": [], "right": []}
    for frame in source.frames():
        pictures[frame.camera].append(cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, 97])[1].tobytes())
    source.close()
    return pictures


def config(folder, urls, fps=FPS, detectors="offset", **settings):
    cameras = {name: {"url": url, "fps": fps} for name, url in urls.items()}
    text = {
        "rig": "bench",
        "source": {"type": "video", "cameras": cameras, **settings},
        "detectors": {"timestamp": {}, **({detectors: {}} if detectors else {})},
        "sinks": {},
    }
    (folder / "rig.yaml").write_text(yaml.safe_dump(text))
    return str(folder / "rig.yaml")


def test_a_slip_of_one_frame_is_found_from_the_pictures(tmp_path):
    pictures = rendered(8 * FPS)
    decided, events = [], []

    def note(report):
        if isinstance(report, Event):
            events.append(report)
        if isinstance(report, Verdict) and report.state is not State.UNKNOWN:
            decided.append(report)
            if len(decided) == 10:
                right = streams.pictures["right"]
                streams.pictures["right"] = [right[-1], *right[:-1]]

    with Streams(pictures, FPS) as streams:
        path = config(tmp_path, {name: streams.url(name) for name in pictures})
        execute(read_plan(path, ()), on_report=note, stop_after_s=30, until=lambda: bool(events))
    assert {one.basis for one in decided} == {Basis.CONTENT}
    assert {one.state for one in decided[:10]} == {State.SYNC}
    assert (events[0].phase, events[0].cause) == ("onset", Cause.SLIP)
    assert decided[-1].state is State.ASYNC
    assert decided[-1].offset_frames == pytest.approx(-1, abs=0.2)


def test_a_camera_that_stalls_is_missing_until_it_is_back(tmp_path):
    missing = []

    def note(report):
        if isinstance(report, Verdict) and report.frame == 10:
            streams.stalled.add("right")
        if isinstance(report, Event) and report.cause is Cause.MISSING and streams.stalled:
            missing.append(report)
            streams.stalled.clear()
        elif missing and isinstance(report, Event) and report.id == missing[0].id:
            missing.append(report)

    with Streams({"left": plain(1), "right": plain(7)}, FPS) as streams:
        path = config(tmp_path, {name: streams.url(name) for name in streams.pictures}, detectors="")
        execute(read_plan(path, ()), on_report=note, stop_after_s=30, until=lambda: len(missing) == 2)
    assert [(one.phase, one.camera) for one in missing] == [("onset", "right"), ("end", "right")]


def test_a_file_that_has_ended_is_not_missing(tmp_path):
    for name, seconds in (("left", 2), ("right", 1)):
        film(tmp_path / f"{name}.mp4", count=seconds * FPS, fps=FPS)
    reports = []
    path = config(tmp_path, {"left": "left.mp4", "right": "right.mp4"}, detectors="")
    assert execute(read_plan(path, ()), on_report=reports.append) == 0
    verdicts = [report for report in reports if isinstance(report, Verdict)]
    assert len(verdicts) > FPS
    assert {one.state for one in verdicts} == {State.UNKNOWN}
    assert not [report for report in reports if isinstance(report, Event) and report.cause is Cause.MISSING]


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("gone.mp4", "{folder}/gone.mp4: No such file or directory (wait: true waits for it)"),
        (".", "{folder}: is a folder (source replay reads folders) (wait: true waits for it)"),
        (
            "/dev/null",
            "/dev/null: is a device (source v4l2 reads the cameras of this machine) (wait: true waits for it)",
        ),
        ("a\0b", "{folder}/a\0b: cannot be the name of a file (wait: true waits for it)"),
        ("rig.yaml", "{folder}/rig.yaml: it is no video, or a damaged one (wait: true waits for it)"),
        (
            f"rtsp://user:{SECRET}@127.0.0.1:1/x?token={SECRET}",
            "rtsp://127.0.0.1:1/x: Connection refused (wait: true waits for it)",
        ),
        (f"gopher2://user:{SECRET}@127.0.0.1/x", "gopher2://127.0.0.1/x: Protocol not found (wait: true waits for it)"),
        ("http://[::1/x", "http://...: it is no URL (wait: true waits for it)"),
        (f"gopher2://user:a/{SECRET}@127.0.0.1/x", "gopher2://...: Protocol not found (wait: true waits for it)"),
    ],
)
def test_what_cannot_be_read_is_told_in_one_line(tmp_path, url, words):
    path = config(tmp_path, {"left": url, "right": "other.mp4"}, detectors="")
    done = inside("run", path, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    said = words.replace("{folder}", str(tmp_path))
    assert done.stderr.splitlines() == [f"syncwatch: error: source.cameras.left.url: {said}"]


def test_a_server_that_has_no_such_stream_is_told(tmp_path):
    with Streams({"left": [jpeg(np.zeros((8, 8), np.uint8))]}) as streams:
        path = config(tmp_path, {"left": streams.url("nothing", f"user:{SECRET}@"), "right": "x"}, detectors="")
        done = inside("validate", path, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        f"syncwatch: error: source.cameras.left.url: {streams.url('nothing')}: Server returned 404 Not Found "
        "(wait: true waits for it)"
    ]


@pytest.mark.parametrize(
    ("cameras", "words"),
    [
        ("{left: {url: x, fsp: 30}}", "source.cameras.left.fsp: unknown field - did you mean 'fps'?"),
        ("{left: {fps: 30}}", "source.cameras.left.url: required"),
        ("{left: ''}", "source.cameras.left.url: must"),
        ("{left: 5}", "source.cameras.left: "),
        ("{Left: x}", "source.cameras.Left: "),
        ("{}", "source.cameras: "),
        ("{left: {url: x, options: {a: 'b;c'}}}", "'b;c' cannot be told to FFmpeg"),
        ("{left: x, right: x}", "left and another camera have the same url: one stream cannot be two cameras"),
        (
            f"{{left: {{url: 'rtsp://user:{SECRET}@cam/x?stream={SECRET}', fsp: 30}}}}",
            "rtsp://************@cam/x?**************', fsp: 30}",
        ),
        (f"{{left: {{url: ['rtsp://user:{SECRET}@cam/x']}}}}", "source.cameras.left.url: "),
        (f"{{left: {{url: 'rtsp://user:a/{SECRET}@cam/x', fsp: 30}}}}", "@cam/x', fsp: 30}"),
        (f"{{left: {{url: 'rtsp://user:{SECRET}@cam/x', options: 5}}}}", "source.cameras.left.options: "),
    ],
)
def test_a_wrong_configuration_is_told_with_its_place_and_no_secret(tmp_path, cameras, words):
    (tmp_path / "c.yaml").write_text(f"source: {{type: video, cameras: {cameras}}}\ndetectors: {{timestamp: {{}}}}\n")
    with pytest.raises(ConfigError) as caught:
        read_plan(str(tmp_path / "c.yaml"), ())
    assert words in str(caught.value)
    assert SECRET not in str(caught.value)


def test_the_settings_of_the_manual_are_read(tmp_path):
    text = """
source:
  - type: video
    cameras:
      left:  {url: "rtsp://${LOGIN:-me}@10.0.0.11/stream1", fps: 25, options: {rtsp_transport: udp, buffer_size: 65536}}
      right: rtsp://10.0.0.12/stream1
    wait: true
    open_within_s: 3
    silent_after_s: 1
    frames_ahead: 4
  - {type: oak, devices: [{cameras: {top: CAM_C}}], fps: 30}
detectors: {timestamp: {}}
"""
    (tmp_path / "c.yaml").write_text(text)
    video, oak = read_plan(str(tmp_path / "c.yaml"), ("source.0.cameras.left.fps=15",)).source.settings.sources
    assert video.cameras["left"].url.get_secret_value() == "rtsp://me@10.0.0.11/stream1"
    assert (video.cameras["left"].fps, video.cameras["right"].fps) == (15, None)
    assert oak.camera_names == ("top",)


def test_a_plan_that_is_printed_holds_no_secret(tmp_path):
    with Streams({"left": plain(1), "right": plain(7)}) as streams:
        path = config(tmp_path, {name: streams.url(name, f"user:{SECRET}@") for name in streams.pictures})
        done = inside("--verbose", "validate", path, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "cameras    left (20 fps), right (20 fps)" in done.stdout
    assert SECRET not in done.stdout + done.stderr + repr(read_plan(path, ()).source)


def test_a_signal_ends_a_run_whose_streams_stall_and_its_readers(tmp_path):
    with Streams({"left": plain(1), "right": plain(7)}, FPS) as streams:
        path = config(tmp_path, {name: streams.url(name) for name in streams.pictures}, silent_after_s=60)
        text = yaml.safe_load((tmp_path / "rig.yaml").read_text())
        (tmp_path / "rig.yaml").write_text(yaml.safe_dump({**text, "sinks": {"jsonl": {"path": "out.jsonl"}}}))
        command = [sys.executable, "-m", "syncwatch", "run", path]
        out = tmp_path / "out.jsonl"
        with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as program:
            try:
                wait_for(lambda: out.exists() and out.read_text().count("\n") > 5, seconds=60)
                readers = children(program.pid)
                streams.stalled |= {"left", "right"}
                program.send_signal(signal.SIGTERM)
                assert program.wait(30) == 143
                assert "Traceback" not in program.stderr.read()
            finally:
                program.kill()
    assert len(readers) == 2
    assert json.loads(out.read_text().splitlines()[0])["rig"] == "bench"
    wait_for(lambda: not any(is_alive(pid) for pid in readers))


def test_readers_do_not_outlive_a_program_that_is_killed(tmp_path):
    with Streams({"left": plain(1), "right": plain(7)}, FPS) as streams:
        path = config(tmp_path, {name: streams.url(name) for name in streams.pictures}, silent_after_s=600)
        command = [sys.executable, "-m", "syncwatch", "run", path]
        with subprocess.Popen(command, cwd=tmp_path) as program:
            try:
                wait_for(lambda: len(children(program.pid)) == 2 and len(streams.watched) == 2, seconds=60)
                readers = children(program.pid)
                streams.stalled |= {"left", "right"}
            finally:
                program.kill()
        wait_for(lambda: not any(is_alive(pid) for pid in readers))


def children(pid):
    tasks = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for task in tasks for child in task.read_text().split()]


def is_alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
