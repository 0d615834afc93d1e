"""A rig that is judged live and its recording that is replayed get the same verdicts."""

from __future__ import annotations

import io
import random
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from queue import Queue
from typing import Any

import pytest
import yaml

from pipeline.assemble import KINDS, assemble, build_source
from pipeline.configtext.document import load_text
from pipeline.frame import Camera, Frame
from pipeline.plan import Plan, make_plan
from pipeline.run import Run
from pipeline.verdict import Event, Message, Report, Verdict

ROOM = {"type": "synthetic", "duration_s": 4.5, "fps": 20, "width": 240, "height": 180}
OWN = ("id", "since_ns", "until_ns")
"""What an event says of its run and of the time of day."""


class Live:
    """A live source: a thread a camera delivers the given frames, as they come, but `lead` slots ahead at most."""

    live = True
    frame_count = None

    def __init__(self, cameras: Sequence[Camera], frames: Sequence[Frame], seed: int, lead: int) -> None:
        self.cameras = cameras
        self._frames = frames
        self._seed = seed
        self._lead = lead
        self._handed: Queue[Frame | None] = Queue(maxsize=1)
        self._turn = threading.Condition()
        self._next = {camera.name: 0 for camera in cameras}

    def open(self) -> None: ...

    def frames(self) -> Iterator[Frame]:
        threads = [threading.Thread(target=self._deliver, args=(camera.name,)) for camera in self.cameras]
        for thread in threads:
            thread.start()
        for _ in range(len(self._frames)):
            frame = self._handed.get()
            assert frame is not None
            yield frame
        for thread in threads:
            thread.join()

    def _deliver(self, camera: str) -> None:
        chance = random.Random(f"{self._seed}/{camera}")
        mine = [frame for frame in self._frames if frame.camera == camera]
        for frame, following in zip(mine, [*mine[1:], None], strict=True):
            assert frame.group is not None
            latest = frame.group - chance.randrange(self._lead + 1)
            with self._turn:
                self._turn.wait_for(lambda latest=latest: latest <= min(self._next.values()), timeout=10)
            self._handed.put(frame)
            with self._turn:
                self._next[camera] = len(self._frames) if following is None else following.group or 0
                self._turn.notify_all()

    def stop(self) -> None: ...

    def close(self) -> None: ...


def plan_of(source: dict[str, Any], faults: Sequence[dict[str, Any]]) -> Plan:
    config = {
        "rig": "bench",
        "source": source,
        "faults": list(faults),
        "detectors": {"timestamp": {}, "offset": {}},
    }
    return make_plan(load_text(yaml.safe_dump(config), "test", {}, quoted=False), KINDS, Path())


def said(plan: Plan, source: Any) -> tuple[list[Message], list[Message]]:
    """Verdicts and events."""
    reports: list[Report] = []
    Run(assemble(plan, source, console=io.StringIO(), on_report=reports.append)).execute()
    events = [report.to_message() for report in reports if isinstance(report, Event)]
    verdicts = [report.to_message() for report in reports if isinstance(report, Verdict)]
    return verdicts, [{key: value for key, value in event.items() if key not in OWN} for event in events]


def replayed_and_live(plan: Plan, seed: int, lead: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.run.WINDOWS_AHEAD", 100_000)
    source = build_source(plan)
    source.open()
    cameras, frames = list(source.cameras), list(source.frames())
    source.close()
    replay = build_source(plan)
    replay.open()
    assert said(plan, replay) == said(plan, Live(cameras, frames, seed, lead))


@pytest.mark.parametrize(
    "faults",
    [
        (),
        ({"type": "slip", "frames": 1, "start_s": 2, "stop_s": 4},),
        ({"type": "drop", "probability": 0.1}, {"type": "content_shift", "frames": -1, "start_s": 2}),
        ({"type": "frame_repeat", "every": 7}, {"type": "stamp_jitter", "sigma_ms": 1}),
        ({"type": "frozen", "start_s": 2},),
        ({"type": "free_run", "ppm": 3000, "start_s": 1},),
        ({"type": "dead", "start_s": 2, "stop_s": 4},),
        ({"type": "dead", "camera": "left", "start_s": 2, "stop_s": 4},),
    ],
    ids=lambda faults: "+".join(fault["type"] for fault in faults) or "clean",
)
@pytest.mark.parametrize("lead", [3])
def test_a_rendered_rig(faults, lead, monkeypatch):
    replayed_and_live(plan_of(ROOM, faults), hash((len(faults), lead)), lead, monkeypatch)


def test_a_real_recording(recordings, monkeypatch):
    source = {"type": "replay", "path": str(recordings / "euroc_v101_start")}
    replayed_and_live(plan_of(source, [{"type": "slip", "frames": 1, "start_s": 3}]), 5, 2, monkeypatch)
