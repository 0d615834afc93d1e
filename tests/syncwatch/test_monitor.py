"""A program that watches its own frames: what it hears, and that nothing it or the monitor does wrong stops it."""

from __future__ import annotations

import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from pipeline.errors import InputError, RunError
from pipeline.verdict import Basis, Cause, State
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import SyntheticSource
from syncwatch import Monitor
from tests.frames import texture
from tests.network import wait_for
from tests.programs import ROOT, inside

CAMERAS = {"left": 30, "right": 30}
PERIOD_NS = 33_333_333
STAMPS_ONLY = {"detectors": {"timestamp": {}}}
PICTURE = np.full((4, 6), 100, np.uint8)
PACE_S = 0.005


def stamps_only(**options) -> Monitor:
    return Monitor(STAMPS_ONLY, CAMERAS, **options)


def push_pairs(monitor, count, first=0, right_ns=0, cameras=("left", "right")):
    for number in range(first, first + count):
        for name in cameras:
            stamp_ns = number * PERIOD_NS + right_ns * (name == "right")
            monitor.push(name, PICTURE, stamp_ns, number)
        time.sleep(PACE_S)


def test_stamps_that_are_apart_are_told_and_stamps_that_agree_are_not():
    events = []
    with stamps_only(on_event=events.append) as monitor:
        push_pairs(monitor, 60)
        push_pairs(monitor, 60, first=60, right_ns=10_000_000)
        verdicts = list(monitor.verdicts(timeout_s=0.3))
    before = [verdict for verdict in verdicts if 20 <= verdict.frame < 50]
    assert {(verdict.state, verdict.basis) for verdict in before} == {(State.SYNC, Basis.TIMESTAMPS)}
    assert verdicts[-1].state is State.ASYNC
    assert [event.phase for event in events] == ["onset", "end"]
    assert verdicts[-1].sequence["left"] == verdicts[-1].sequence["right"]


def rendered(seconds, **right):
    cameras = ({"name": "left"}, {"name": "right", **right})
    settings = SyntheticSettings(width=192, height=144, fps=30, duration_s=seconds, cameras=cameras)
    source = SyntheticSource(settings, seed=3)
    source.open()
    return list(source.frames())


def test_without_stamps_the_pictures_alone_tell():
    """Both cameras are read one right after the other, but the right one shows what was 12 ms later."""
    config = {"detectors": {"timestamp": {}, "offset": {}}}
    with Monitor(config, CAMERAS) as monitor:
        for item in rendered(2.5, offset_ms=12):
            monitor.push(item.camera, item.image)
            if item.camera == "right":
                time.sleep(1 / 30)
        said = list(monitor.verdicts(timeout_s=0.5))
    decided = [verdict for verdict in said if verdict.state is not State.UNKNOWN]
    assert decided
    assert {verdict.basis for verdict in decided} == {Basis.CONTENT}
    assert said[-1].state is State.ASYNC


def test_stamps_of_arrival_are_no_evidence():
    with stamps_only() as monitor:
        for _ in range(40):
            for name in CAMERAS:
                monitor.push(name, PICTURE)
            time.sleep(PACE_S)
        said = list(monitor.verdicts(timeout_s=0.3))
    assert {verdict.state for verdict in said} == {State.UNKNOWN}


def test_a_camera_that_is_never_pushed_is_missing():
    with stamps_only() as monitor:
        push_pairs(monitor, 40, cameras=("left",))
        said = wait_for(lambda: [one for one in monitor.verdicts(timeout_s=0) if one.cause is Cause.MISSING])
    assert said[0].camera == "right"


def test_cameras_that_fall_silent_are_told():
    with stamps_only() as monitor:
        push_pairs(monitor, 20)
        wait_for(lambda: [one for one in monitor.verdicts(timeout_s=0) if one.cause is Cause.MISSING])


def test_what_was_pushed_before_the_end_is_judged():
    told = []
    with stamps_only(on_verdict=told.append) as monitor:
        push_pairs(monitor, 30)
    assert told[-1].frame == 29
    assert told[-1].sequence == {"left": 29, "right": 29}


def test_status_is_there_while_it_runs():
    with stamps_only() as monitor:
        push_pairs(monitor, 30)
        wait_for(lambda: monitor.status is not None and monitor.status.cameras["left"].frames >= 10)


@pytest.mark.parametrize("copy", [True, False])
def test_the_program_may_write_to_a_picture_unless_it_handed_it_over(copy):
    """Eight different pictures lie in one array: only copies are told apart."""
    frames = []
    with Monitor({**STAMPS_ONLY, "align": {}}, CAMERAS) as monitor:
        push = monitor._source._inbox.put
        monitor._source._inbox.put = lambda frame: frames.append(frame) or push(frame)
        image = PICTURE.copy()
        for number in range(8):
            image[:] = number
            monitor.push("left", image, number * PERIOD_NS, copy=copy)
    assert [int(frame.image[0, 0]) for frame in frames] == (list(range(8)) if copy else [7] * 8)
    assert all(not frame.image.flags.writeable for frame in frames)


@pytest.mark.parametrize(
    ("camera", "image", "text"),
    [
        ("middle", PICTURE, "no camera 'middle': this rig has left, right"),
        (
            "left",
            PICTURE.astype(np.uint16),
            "left: a picture must be uint8, .* not uint16 \\(4, 6\\): convert it first",
        ),
        ("left", np.zeros((4, 6, 4), np.uint8), "left: a picture must be uint8, H x W or H x W x 3, not uint8"),
        ("left", None, "left: a picture must be uint8, H x W or H x W x 3, not object"),
        ("left", np.zeros((5, 6), np.uint8), "left: 6x5 pixels, but the pictures before had 6x4"),
    ],
)
def test_a_picture_that_cannot_be_is_refused_and_the_monitor_goes_on(camera, image, text):
    with stamps_only() as monitor:
        assert monitor.push("left", PICTURE, 0)
        with pytest.raises(InputError, match=text):
            monitor.push(camera, image, PERIOD_NS)
        assert monitor.push("left", PICTURE, PERIOD_NS)


def test_a_camera_that_was_started_anew_may_have_another_size():
    with stamps_only() as monitor:
        assert monitor.push("left", PICTURE, 0)
        assert monitor.push("left", np.zeros((5, 6), np.uint8), PERIOD_NS, epoch=1)


def test_a_callback_that_hangs_neither_blocks_pushing_nor_hides_the_end(caplog):
    held = threading.Event()
    monitor = stamps_only(on_verdict=lambda _: held.wait(10))
    began = time.monotonic()
    push_pairs(monitor, 100)
    assert time.monotonic() - began < 5
    held.set()
    monitor.close()


def test_a_callback_that_raises_ends_the_monitor_and_no_push_does():
    def fail(verdict):
        raise ZeroDivisionError("my own bug")

    monitor = stamps_only(on_verdict=fail)
    push_pairs(monitor, 40)
    wait_for(lambda: monitor.failure is not None)
    assert monitor.push("left", PICTURE, 0) is False
    assert list(monitor) == []
    for _ in range(2):
        with pytest.raises(RunError, match="sink 'monitor' failed: ZeroDivisionError: my own bug"):
            monitor.close()


def test_a_flood_gives_up_the_oldest_frames_of_its_camera_only(caplog):
    monitor = stamps_only()
    stuck = threading.Event()
    real = monitor._run._parts.observer.push
    monitor._run._parts.observer.push = lambda frame: (stuck.wait(5), real(frame))
    monitor.push("right", PICTURE, 0)
    for number in range(100):
        assert monitor.push("left", PICTURE, number * PERIOD_NS)
    assert monitor.dropped["right"] == 0
    assert monitor.dropped["left"] >= 80
    stuck.set()
    monitor.close()
    assert any("left: frames were not taken fast enough" in line for line in caplog.messages)
    told = {name: camera.overwritten for name, camera in monitor.status.cameras.items()}
    assert told == monitor.dropped


def test_closing_twice_or_from_a_callback_is_safe_and_leaves_no_thread():
    before = threading.active_count()
    closing = []
    monitor = stamps_only(on_verdict=lambda _: closing.append(monitor.close()))
    push_pairs(monitor, 40)
    wait_for(lambda: closing)
    monitor.close()
    monitor.close()
    assert monitor.push("left", PICTURE, 0) is False
    wait_for(lambda: threading.active_count() <= before)


def test_an_error_of_the_program_itself_is_not_covered_up():
    def broken(_):
        raise OSError("disk full")

    def work():
        with stamps_only(on_verdict=broken) as monitor:
            push_pairs(monitor, 40)
            wait_for(lambda: monitor.failure is not None)
            raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        work()


def test_verdicts_nobody_takes_are_bounded_and_the_latest_are_kept():
    with stamps_only(verdicts_ahead=5) as monitor:
        push_pairs(monitor, 40)
    assert [verdict.frame for verdict in monitor] == [35, 36, 37, 38, 39]


def test_a_configuration_file_is_used_with_its_source_replaced(tmp_path):
    file = tmp_path / "rig.yaml"
    file.write_text(
        "rig: cart\nsource: {type: synthetic}\ndetectors: {timestamp: {}}\nsinks: {jsonl: {path: out.jsonl}}\n"
    )
    with Monitor(file, {"a": 30, "b": 30}, overrides=["judge.sync_tolerance_ms=2"]) as monitor:
        push_pairs(monitor, 30, cameras=("a", "b"))
    lines = (tmp_path / "out.jsonl").read_text().splitlines()
    assert '"rig": "cart"' in lines[-1] or '"rig":"cart"' in lines[-1]
    assert '"pair":"a-b"' in lines[-1].replace(" ", "")


@pytest.mark.parametrize(
    ("config", "cameras", "text"),
    [
        ({"source": {"type": "synthetic"}}, None, "a monitor needs one source of type push, not 0"),
        ({}, None, "source: required, but not given"),
        ({"detectors": {"ofset": {}}}, CAMERAS, "unknown type 'ofset'"),
        (None, {"left": 30}, "two or more cameras"),
        (None, {"Left": 30, "right": 30}, "source.cameras.Left"),
        (None, {"left": 0, "right": 30}, "source.cameras.left: must be at least 0.001"),
        ("nowhere.yaml", CAMERAS, "configuration 'nowhere.yaml' does not exist"),
        ({"sinks": {"own": object()}}, CAMERAS, "the configuration holds what YAML cannot"),
    ],
)
def test_a_configuration_that_cannot_be_used_is_said_at_once(config, cameras, text):
    with pytest.raises(InputError, match=text):
        Monitor(config, cameras)


def test_on_the_command_line_nobody_hands_over_frames(tmp_path):
    (tmp_path / "config.yaml").write_text(
        "source: {type: push, cameras: {left: 30, right: 30}}\ndetectors: {timestamp: {}}\n"
    )
    assert inside("validate", cwd=tmp_path).returncode == 0
    done = inside("run", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "syncwatch: error: source push: a program has to hand over the frames: see syncwatch.Monitor"
    ]


def test_a_program_that_forgets_to_close_ends_all_the_same():
    code = "from syncwatch import Monitor\nMonitor(cameras={'left': 30, 'right': 30})\nprint('done')\n"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, check=False, cwd=ROOT, capture_output=True, text=True, timeout=30)
    assert (done.returncode, done.stdout, done.stderr) == (0, "done\n", "")


def test_pictures_in_colour_are_taken():
    colour = np.dstack([texture(1)] * 3)
    with stamps_only() as monitor:
        assert monitor.push("left", colour, 0)
