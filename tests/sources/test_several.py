"""Several sources as one: what is kept apart, what goes on when one dies, and how it begins and ends."""

from __future__ import annotations

import threading
from collections import Counter

import numpy as np
import pytest

from pipeline.buffer import BufferSettings
from pipeline.errors import InputError, RunError
from pipeline.frame import Camera, StampOrigin, Truth
from sources.push import PushSettings, PushSource
from sources.several import SeveralSources
from sources.v4l2.settings import V4l2Settings
from sources.v4l2.source import V4l2Source
from syncwatch.testing import ScriptedSource
from tests.frames import PERIOD_NS, frame
from tests.network import wait_for
from tests.sources.v4l2_kernel import FakeCamera, Machine, Shot


def refuse(number, text):
    return InputError(f"{number}: {text}")


def several(*sources) -> SeveralSources:
    return SeveralSources(sources, refuse=refuse, pairing=BufferSettings())


def scripted(camera, steps=(), *, live=True, fps=10) -> ScriptedSource:
    names = camera.split()
    return ScriptedSource([Camera(name, fps) for name in names], steps, live=live)


def run(*sources):
    made = several(*sources)
    made.open()
    frames = list(made.frames())
    made.close()
    return frames


def test_cameras_of_all_are_there_in_order():
    made = several(scripted("left right"), scripted("top"))
    made.open()
    assert [camera.name for camera in made.cameras] == ["left", "right", "top"]
    assert made.live
    assert made.frame_count is None
    made.close()


@pytest.mark.parametrize("live", [True, False])
def test_clocks_groups_and_truths_of_different_sources_are_kept_apart(live):
    def steps(camera):
        return [frame(camera, n * PERIOD_NS, n, group=n + 7, truth=Truth(n)) for n in range(3)]

    frames = run(scripted("left", steps("left"), live=live), scripted("top", steps("top"), live=live))
    assert {(item.camera, item.clock) for item in frames} == {("left", "rig@0"), ("top", "rig@1")}
    assert {item.truth for item in frames} == {None}
    groups = [item.group for item in frames]
    assert groups == [None] * 6 if live else groups == [0, 0, 1, 1, 2, 2]


@pytest.mark.parametrize("clock", ["monotonic", "realtime", "ptp"])
def test_clocks_that_are_common_to_live_sources_keep_their_names(clock):
    steps = [[frame(name, 5, 1, clock=clock)] for name in ("left", "top")]
    assert {item.clock for item in run(scripted("left", steps[0]), scripted("top", steps[1]))} == {clock}
    recorded = run(scripted("left", steps[0], live=False), scripted("top", steps[1], live=False))
    assert {item.clock for item in recorded} == {f"{clock}@0", f"{clock}@1"}


def test_frames_that_gave_way_are_counted_wherever_they_did():
    pushed = PushSource(PushSettings(cameras={"left": 10}, frames_ahead=1))
    pushed.attach()
    made = several(pushed, scripted("top", [frame("top", n * PERIOD_NS, n) for n in range(20)]))
    made.open()
    for _ in range(3):
        pushed.push("left", np.zeros((8, 8), np.uint8))
    frames = made.frames()
    next(frames)
    wait_for(lambda: made.dropped["top"] > 0)
    assert made.dropped["left"] == 2
    made.close()


def test_everything_else_of_a_frame_is_as_its_source_gave_it():
    given = frame("left", 5, 3, epoch=2, exposure_ns=7, stamp_origin=StampOrigin.DRIVER, arrived_ns=9)
    taken, _ = run(scripted("left", [given]), scripted("top", [frame("top", 5, 1)]))
    assert (taken.sequence, taken.captured_ns, taken.epoch, taken.exposure_ns) == (3, 5, 2, 7)
    assert (taken.stamp_origin, taken.arrived_ns) == (StampOrigin.DRIVER, 9)
    assert taken.image is given.image


def test_a_live_source_that_ends_does_not_end_the_others():
    go_on = threading.Event()
    left = scripted("left", [frame("left", 0, 0), go_on, *(frame("left", n, n) for n in range(1, 6))])
    made = several(left, scripted("top", [frame("top", 0, 0)]))
    made.open()
    seen = []
    for item in made.frames():
        seen.append(item.camera)
        if len(seen) == 2:
            go_on.set()
    made.close()
    assert sorted(seen) == ["left"] * 6 + ["top"]
    assert not made.ended, "a live camera that is silent is missing, whatever the reason"


def test_a_source_that_floods_costs_the_other_no_frame():
    flooded, go_on = threading.Event(), threading.Event()

    def flood():
        yield from (frame("left", n, n) for n in range(500))
        flooded.set()
        yield go_on

    made = several(scripted("left", flood()), scripted("top", [frame("top", 0, 0)]))
    made.open()
    reader = made.frames()
    seen = [next(reader)]
    assert flooded.wait(10)
    go_on.set()
    seen += reader
    made.close()
    left = [item.sequence for item in seen if item.camera == "left"]
    assert left[-1] == 499
    assert len(left) <= 17
    assert [item.camera for item in seen].count("top") == 1


def test_cameras_of_this_machine_and_frames_of_a_program_are_one_rig(tmp_path):
    machine = Machine(tmp_path)
    machine.plug("video0", FakeCamera([Shot()] * 5, bus="usb-1"))
    cameras = V4l2Source(V4l2Settings(cameras={"left": {"device": "usb-1"}}), host=machine.host)
    program = PushSource(PushSettings(cameras={"right": 30}))
    program.attach()
    for number in range(5):
        program.push("right", np.full((4, 6), 100, np.uint8), captured_ns=number)
    made = several(cameras, program)
    made.open()
    seen = Counter()
    clocks = set()
    for item in made.frames():
        seen[item.camera] += 1
        clocks.add((item.camera, item.clock))
        if seen == {"left": 5, "right": 5}:
            made.stop()
    made.close()
    assert seen == {"left": 5, "right": 5}
    assert clocks == {("left", "monotonic"), ("right", "rig@1")}
    assert not machine.cameras["video0"].is_open


@pytest.mark.parametrize("live", [True, False])
def test_one_that_fails_ends_it_with_an_error_that_says_which(live):
    never = threading.Event()
    good = scripted("left", [frame("left", 0, 0), *([never] if live else [])], live=live)
    bad = scripted("top", [frame("top", 0, 0), OSError("cable")], live=live)
    made = several(good, bad)
    made.open()
    seen = []
    with pytest.raises(RunError, match=r"^source\[1\] failed: OSError: cable$"):
        seen.extend(made.frames())
    if live:
        assert {item.camera for item in seen} >= {"top"}
    made.close()
    assert (good.calls[-1], bad.calls[-1]) == ("close", "close")


class Failing(ScriptedSource):
    def __init__(self, name, **failures) -> None:
        super().__init__([Camera(name, 10)], [], live=True)
        self._failures = failures

    def open(self) -> None:
        super().open()
        self._fail("open")

    def stop(self) -> None:
        super().stop()
        self._fail("stop")

    def close(self) -> None:
        super().close()
        self._fail("close")

    def _fail(self, when):
        if when in self._failures:
            raise self._failures[when]


@pytest.mark.parametrize(
    ("error", "kind", "words"),
    [
        (InputError("no such rig"), InputError, "source[1]: no such rig"),
        (InputError("source.cameras.top.device: gone"), InputError, "source[1].cameras.top.device: gone"),
        (RunError("burnt"), RunError, "source[1]: burnt"),
        (KeyError("x"), RunError, "source[1] cannot be opened: KeyError: 'x'"),
    ],
)
def test_one_that_cannot_be_opened_closes_those_before_it_and_says_which(error, kind, words):
    first, last = scripted("left"), scripted("right")
    with pytest.raises(kind) as caught:
        several(first, Failing("top", open=error), last).open()
    assert str(caught.value) == words
    assert first.calls == ["open", "close"]
    assert last.calls == []


def test_all_are_stopped_and_closed_though_one_fails_at_it(caplog):
    first, bad, last = scripted("left"), Failing("top", stop=OSError("a"), close=OSError("b")), scripted("right")
    made = several(first, bad, last)
    made.open()
    with pytest.raises(RunError, match=r"^source\[1\] cannot be stopped: OSError: a$"):
        made.close()
    assert [source.calls[-1] for source in (first, bad, last)] == ["close"] * 3


def test_a_name_that_two_have_is_refused_once_it_is_known():
    first = scripted("left right")
    with pytest.raises(InputError) as caught:
        several(first, scripted("right top")).open()
    assert (
        str(caught.value) == "1: source[0] has a camera 'right', too: every camera of the rig needs a name of its own"
    )
    assert first.calls == ["open", "close"]


@pytest.mark.parametrize(("lives", "number", "other"), [((True, False), 1, 0), ((False, True), 0, 1)])
def test_a_recording_beside_live_cameras_is_refused_before_anything_is_opened(lives, number, other):
    sources = [scripted(name, live=live) for name, live in zip(("left", "top"), lives, strict=True)]
    with pytest.raises(InputError, match=rf"^{number}: is a recording, and source\[{other}\] is live"):
        several(*sources).open()
    assert [source.calls for source in sources] == [[], []]


def slots(frames):
    made = {}
    for item in frames:
        made.setdefault(item.group, []).append((item.camera, item.sequence))
    return list(made.values())


def test_recordings_are_merged_from_their_beginnings_whatever_their_clocks_show():
    def steps(camera, zero_ns, count):
        return [frame(camera, zero_ns + n * PERIOD_NS, n) for n in range(count)]

    left, top = (
        scripted("left", steps("left", 10**18, 40), live=False),
        scripted("top", steps("top", 5, 40), live=False),
    )
    assert slots(run(left, top)) == [[("left", n), ("top", n)] for n in range(40)]


def test_clocks_of_recordings_that_drift_apart_are_followed():
    left = [frame("left", n * PERIOD_NS, n) for n in range(1500)]
    top = [frame("top", round(n * PERIOD_NS * 1.0008), n) for n in range(1500)]
    together = slots(run(scripted("left", left, live=False), scripted("top", top, live=False)))
    assert together == [[("left", n), ("top", n)] for n in range(1500)]


def test_what_a_recording_holds_together_stays_together():
    """Group n of the first holds what its right camera took a frame later: stamps would pair it anew."""
    first = [
        frame(name, (n + (name == "right")) * PERIOD_NS, n, group=n) for n in range(20) for name in ("left", "right")
    ]
    top = [frame("top", n * PERIOD_NS, n) for n in range(20)]
    together = slots(run(scripted("left right", first, live=False), scripted("top", top, live=False)))
    assert together == [[("left", n), ("right", n), ("top", n)] for n in range(20)]


def test_a_frame_that_a_recording_lacks_is_a_hole_and_no_shift():
    left = [frame("left", n * PERIOD_NS, n) for n in range(20)]
    top = [frame("top", n * PERIOD_NS, n) for n in range(20) if n not in {5, 6}]
    together = slots(run(scripted("left", left, live=False), scripted("top", top, live=False)))
    assert together == [[("left", n), ("top", n)] if n not in {5, 6} else [("left", n)] for n in range(20)]


def test_the_cameras_of_a_recording_that_is_over_have_ended():
    made = several(
        scripted("left", [frame("left", n * PERIOD_NS, n) for n in range(60)], live=False),
        scripted("top", [frame("top", n * PERIOD_NS, n) for n in range(9)], live=False),
    )
    made.open()
    ended = [made.ended for item in made.frames() if item.camera == "left"]
    made.close()
    assert set() in ended
    assert ended[-1] >= {"top"}
