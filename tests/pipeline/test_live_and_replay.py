"""A rig that is judged live and its recording that is replayed get the same verdicts."""

from __future__ import annotations

import io
import random
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from queue import Queue
from typing import Any

import pytest
import yaml

from pipeline.assemble import KINDS, assemble, build_source
from pipeline.configtext.document import load_text
from pipeline.frame import Camera, Frame
from pipeline.pairing import Pairer
from pipeline.plan import Plan, make_plan
from pipeline.run import Run
from pipeline.verdict import Event, Message, Report, Verdict

ROOM = {"type": "synthetic", "duration_s": 4, "fps": 20, "width": 240, "height": 180}
SMALL = {"type": "synthetic", "duration_s": 4, "fps": 20, "width": 96, "height": 72}
SLOT_NS = 50_000_000
OWN = ("id", "since_ns", "until_ns")
"""What an event says of its run and of the time of day."""


class Recorded:
    """A recording of the given frames."""

    live = False
    frame_count = None

    def __init__(self, cameras: Sequence[Camera], frames: Sequence[Frame]) -> None:
        self.cameras = cameras
        self._frames = frames

    def open(self) -> None: ...

    def frames(self) -> Iterator[Frame]:
        yield from self._frames

    def stop(self) -> None: ...

    def close(self) -> None: ...


class Live:
    """A live source: a thread a camera delivers the given frames, as they come, but `lead` slots ahead at most.

    slots: of which slot each frame is. moved: how many frames came in another place than the recording has them in.
    now_ns: the time on the clock that frames arrive by, which stands still while this machine is slow.
    """

    live = True
    frame_count = None

    def __init__(
        self, cameras: Sequence[Camera], frames: Sequence[Frame], slots: Sequence[int], seed: int, lead: int
    ) -> None:
        self.cameras = cameras
        self.moved = 0
        self.now_ns = 0
        self._frames = frames
        self._slots = slots
        self._seed = seed
        self._lead = lead
        self._handed: Queue[Frame] = Queue(maxsize=1)
        self._turn = threading.Condition()
        self._next = {camera.name: 0 for camera in cameras}

    def open(self) -> None: ...

    def frames(self) -> Iterator[Frame]:
        threads = [threading.Thread(target=self._deliver, args=(camera.name,)) for camera in self.cameras]
        for thread in threads:
            thread.start()
        for recorded in self._frames:
            frame = self._handed.get(timeout=20)
            self.moved += frame is not recorded
            self.now_ns = max(self.now_ns, frame.arrived_ns)
            yield frame
        for thread in threads:
            thread.join()

    def _deliver(self, camera: str) -> None:
        chance = random.Random(f"{self._seed}/{camera}")
        mine = [(n, frame) for n, frame in zip(self._slots, self._frames, strict=True) if frame.camera == camera]
        following = [*(n for n, _ in mine[1:]), max(self._slots) + 1]
        for (slot, frame), next_slot in zip(mine, following, strict=True):
            latest = slot - chance.randrange(self._lead + 1)
            with self._turn:
                self._turn.wait_for(lambda latest=latest: latest <= min(self._next.values()), timeout=10)
            self._handed.put(frame)
            with self._turn:
                self._next[camera] = next_slot
                self._turn.notify_all()

    def stop(self) -> None: ...

    def close(self) -> None: ...


def plan_of(source: dict[str, Any], faults: Sequence[dict[str, Any]], detectors: Sequence[str]) -> Plan:
    config = {
        "rig": "bench",
        "source": source,
        "faults": list(faults),
        "detectors": {name: {} for name in detectors},
    }
    return make_plan(load_text(yaml.safe_dump(config), "test", {}, quoted=False), KINDS, Path())


def delivered(plan: Plan) -> tuple[list[Camera], list[Frame], list[int]]:
    """Cameras, frames in the order of the recording, and the slot of each."""
    source = build_source(plan)
    source.open()
    cameras, frames = list(source.cameras), list(source.frames())
    source.close()
    return cameras, frames, [frame.group for frame in frames if frame.group is not None]


def without_groups(frames: Sequence[Frame], slots: Sequence[int], *, own_clocks: bool) -> list[Frame]:
    """As live cameras deliver them: in no slots, a few milliseconds late, on one clock or each on its own."""
    chance = random.Random(3)
    made, latest = [], dict.fromkeys((frame.camera for frame in frames), 0)
    for frame, slot in zip(frames, slots, strict=True):
        arrived_ns = 10**12 + slot * SLOT_NS + round(chance.expovariate(1 / 4e6))
        arrived_ns = latest[frame.camera] = max(arrived_ns, latest[frame.camera] + 1)
        clock = frame.camera if own_clocks else frame.clock
        made.append(replace(frame, group=None, clock=clock, arrived_ns=arrived_ns))
    return made


def said(plan: Plan, source: Any) -> tuple[list[Message], list[Message]]:
    """Verdicts and events."""
    reports: list[Report] = []
    clock = (lambda: source.now_ns) if isinstance(source, Live) else time.monotonic_ns
    parts = assemble(plan, source, console=io.StringIO(), on_report=reports.append)
    Run(parts, monotonic_ns=clock).execute()
    events = [report.to_message() for report in reports if isinstance(report, Event)]
    verdicts = [report.to_message() for report in reports if isinstance(report, Verdict)]
    return verdicts, [{key: value for key, value in event.items() if key not in OWN} for event in events]


def same_live(
    plan: Plan, replay: Any, frames: Sequence[Frame], slots: Sequence[int], leads: Sequence[int]
) -> tuple[list[Message], list[Message]]:
    """What is said of the replay, after it was found to be what is said of every live delivery; one a lead."""
    verdicts, events = said(plan, replay)
    assert len(verdicts) > 30
    for seed, lead in enumerate(leads):
        source = Live(replay.cameras, frames, slots, seed, lead)
        live_verdicts, live_events = said(plan, source)
        assert source.moved > 10, "cameras interleave in another order"
        assert [message["frame"] for message in live_verdicts] == [message["frame"] for message in verdicts]
        for live, recorded in zip(live_verdicts, verdicts, strict=True):
            assert live == recorded
        assert live_events == events
    return verdicts, events


@pytest.fixture(autouse=True)
def _nothing_is_dropped(monkeypatch):
    monkeypatch.setattr("pipeline.run.WINDOWS_AHEAD", 100_000)


CLEAN: Any = ()
DEAD: Any = ({"type": "dead", "start_s": 2, "stop_s": 3.5},)
REPEATED: Any = ({"type": "frame_repeat", "every": 7}, {"type": "stamp_jitter", "sigma_ms": 1})
FAULTS: list[Any] = [
    CLEAN,
    ({"type": "slip", "frames": 1, "start_s": 2, "stop_s": 4},),
    ({"type": "drop", "probability": 0.1}, {"type": "content_shift", "frames": -1, "start_s": 2}),
    REPEATED,
    ({"type": "frozen", "start_s": 2},),
    ({"type": "free_run", "ppm": 3000, "start_s": 1},),
    DEAD,
    ({"type": "dead", "camera": "left", "start_s": 2, "stop_s": 3.5},),
]
MORE_FAULTS: list[Any] = [
    *FAULTS,
    ({"type": "seq_wrap", "bits": 4},),
    ({"type": "stamp_repeat", "every": 9},),
    ({"type": "stamp_offset", "ms": 37_000},),
    ({"type": "drop", "every": 7, "renumber": True},),
    ({"type": "dark", "start_s": 2},),
]


def _named(faults: Sequence[dict[str, Any]]) -> str:
    return "+".join(f"{fault['type']}{'_of_left' * ('camera' in fault)}" for fault in faults) or "clean"


@pytest.mark.parametrize("faults", [one for one in FAULTS if one not in (CLEAN, DEAD)], ids=_named)
def test_a_rendered_rig(faults):
    plan = plan_of(ROOM, faults, ["timestamp", "offset"])
    cameras, frames, slots = delivered(plan)
    verdicts, _ = same_live(plan, Recorded(cameras, frames), frames, slots, [3])
    assert {"content"} <= {verdict["basis"] for verdict in verdicts}


@pytest.mark.parametrize("faults", MORE_FAULTS, ids=_named)
def test_a_rig_judged_by_stamps_however_its_cameras_interleave(faults):
    plan = plan_of(SMALL, faults, ["timestamp"])
    cameras, frames, slots = delivered(plan)
    same_live(plan, Recorded(cameras, frames), frames, slots, [0, 5])


@pytest.mark.parametrize(
    ("faults", "own_clocks"),
    [*((one, False) for one in MORE_FAULTS), *((one, True) for one in FAULTS if one is not REPEATED)],
    ids=lambda value: _named(value) if isinstance(value, tuple) else "own_clocks" * value or "one_clock",
)
def test_cameras_without_groups_that_come_a_frame_late(faults, own_clocks):
    """A frame late at most: a camera that was silent is waited for no longer than that when it comes back."""
    plan = plan_of(SMALL, faults, ["timestamp"])
    cameras, grouped, slots = delivered(plan)
    frames = without_groups(grouped, slots, own_clocks=own_clocks)
    same_live(plan, Recorded(cameras, frames), frames, slots, [1])


def test_a_repeated_frame_of_a_clock_of_its_own_opens_no_slot():
    cameras, grouped, slots = delivered(plan_of(SMALL, REPEATED, ["timestamp"]))
    pairer = Pairer(cameras)
    made = [slot for frame in without_groups(grouped, slots, own_clocks=True) for slot in pairer.push(frame)]
    made += pairer.flush()
    assert [slot["right"] for slot in made if slot["left"] is None] == []


def test_a_real_recording(recordings):
    source = {"type": "replay", "path": str(recordings / "euroc_v101_start")}
    plan = plan_of(source, [{"type": "slip", "frames": 1, "start_s": 3}], ["timestamp", "offset"])
    _, frames, slots = delivered(plan)
    replay = build_source(plan)
    replay.open()
    _, events = same_live(plan, replay, frames, slots, [2])
    assert [event["cause"] for event in events if event["kind"] == "async"][:1] == ["slip"]
