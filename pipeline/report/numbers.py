"""The numbers of a report, as one JSON message.

`syncwatch.report.v1`:

- `schema`, `version` (of syncwatch), `rig`
- `state`: `sync`, `async` or `unknown` over all pairs; `text`: the paragraph of `syncwatch check`; `advice`: what to do
- `unread`: why the recording could not be read to its end, null where it could
- `dropped_windows`: frames that were not judged because detection was too slow, on live rigs only
- `cameras`, by name: what `syncwatch.status.v1` says of a camera at the end (`fps`, `expected_fps`, `frames`, `drops`,
  `unpaired`, `duplicates`, `restarts`, `jitter_p50_ms`, `jitter_p99_ms`, `conditions`), and `width`, `height` (px),
  `stamps_made_up`, `interval_ms` (mean, min and max of the time between two frames by the camera's own stamps, or null)
- `pairs`, by name:
  - `state`, `text`: of this pair; `told`: the sentences at the top of the page
  - `frames`, `decided`, `coverage` (decided by all), `duration_s`; frames by `states`, `causes`, `reasons`, and by
    `basis` those that were decided; `silences`: why the pictures did not speak, by frames
  - `tolerance_ms`, `expected_offset_ms`
  - `offset_ms`: mean, min and max of what was told, or null; `stamps_ms`, `pictures_ms`: likewise of what the stamps
    and the pictures said, each by themselves; `contradictions`: the share of frames in which these disagree, or null
  - `drift`: as it was last seen, as in `syncwatch.verdict.v1`
  - `stretches`: out of sync, each with `first_frame`, `last_frame`, `frames`, `cause`, `offset_ms` (mean)
  - `events`: each with `at_s`, `since_s`, `kind` (`async onset`, `geometry_shift end`, ...), `cause`, `camera`,
    `offset_ms`, `drift_ppm`, `text`; `events_left_out`: how many more there were; `notes`: what was noticed besides
  - `moments`: the worst ones, each with `frame`, `at_s`, `state`, `cause`, `offset_ms`
  - `series`: curves, as lists of one length: `from_s`, `to_s` of each bin; means over it of `sync`, `async`, `unknown`
    (shares), `offset_ms`, `sigma_ms`, `stamps_ms`, `pictures_ms`, `differ` (share), `drift_stamps_ppm`,
    `drift_stamps_sigma_ppm`, `drift_pictures_ppm`, `drift_pictures_sigma_ppm`; null where nothing was known

Offsets are the second camera's against the first's, positive means a later moment. Seconds count from the first frame
that was judged, by the first camera's nominal rate.
"""

from __future__ import annotations

from collections import Counter
from typing import TypeVar

import numpy as np

from pipeline.answer import Answer
from pipeline.detectors.offset.arrays import Floats
from pipeline.report.advice import advice
from pipeline.report.lead import told
from pipeline.report.moments import Moment
from pipeline.report.recorder import VALUES, CameraRecord, PairRecord, Recorder
from pipeline.tally import Stretch
from pipeline.timeline import Mark
from pipeline.verdict import Basis, Cause, Message, Reason, State, ms, rounded

Kind = TypeVar("Kind", Cause, Reason, Basis)

REPORT_SCHEMA = "syncwatch.report.v1"
NOT_SEEN = Answer(State.UNKNOWN, "No two frames came together.")


def to_message(recorder: Recorder, answer: Answer, version: str, unread: str | None = None) -> Message:
    return {
        "schema": REPORT_SCHEMA,
        "version": version,
        "rig": recorder.rig.name,
        "state": answer.state.value,
        "text": answer.text,
        "unread": unread,
        "advice": advice(recorder, answer),
        "dropped_windows": recorder.dropped_windows,
        "cameras": {name: _camera(record) for name, record in recorder.cameras.items()},
        "pairs": {name: _pair(record, answer.pairs.get(name, NOT_SEEN)) for name, record in recorder.pairs.items()},
    }


def _camera(record: CameraRecord) -> Message:
    width, height = record.size or (None, None)
    return {
        **({} if record.status is None else record.status.to_json()),
        "width": width,
        "height": height,
        "stamps_made_up": record.synthesised,
        "interval_ms": None if record.synthesised else _summary(record.series.summary("interval_ms")),
    }


def _pair(record: PairRecord, said: Answer) -> Message:
    tally, series = record.tally, record.series
    compared = float(series.known("differ").sum())
    return {
        "state": said.state.value,
        "text": said.text,
        "told": told(record, said),
        "frames": tally.total,
        "decided": tally.decided,
        "coverage": rounded(record.coverage),
        "duration_s": rounded(record.duration_s, 3),
        "states": {state.value: tally.states[state] for state in State},
        "causes": _counted(record.causes),
        "reasons": _counted(tally.reasons),
        "basis": _counted(record.bases),
        "silences": _counted(record.silences),
        "tolerance_ms": rounded(record.tolerance_ms, 3),
        "expected_offset_ms": ms(record.pair.expected_offset_ns),
        **{name: _summary(series.summary(name)) for name in ("offset_ms", "stamps_ms", "pictures_ms")},
        "contradictions": rounded(float(series.sums("differ").sum()) / compared) if compared else None,
        "drift": record.drift.to_json(),
        "stretches": [_stretch(stretch) for stretch in tally.stretches],
        "events": [_event(mark) for mark in record.marks.marks if mark.kind != "note"],
        "events_left_out": record.marks.left_out,
        "notes": [mark.text for mark in record.marks.marks if mark.kind == "note"],
        "moments": [_moment(moment) for moment in record.moments.worst()],
        "series": _series(record),
    }


def _counted(counts: Counter[Kind]) -> Message:
    return {what.value: count for what, count in counts.most_common()}


def _summary(values: dict[str, float] | None) -> Message | None:
    return None if values is None else {name: rounded(value, 3) for name, value in values.items()}


def _stretch(stretch: Stretch) -> Message:
    return {
        "first_frame": stretch.first.frame,
        "last_frame": stretch.last_frame,
        "frames": stretch.frames,
        "cause": stretch.first.cause and stretch.first.cause.value,
        "offset_ms": ms(stretch.offset_ns),
    }


def _event(mark: Mark) -> Message:
    return {
        "at_s": rounded(mark.at_s, 3),
        "since_s": rounded(mark.since_s, 3),
        "kind": mark.kind,
        "cause": mark.cause,
        "camera": mark.camera,
        "offset_ms": rounded(mark.offset_ms, 3),
        "drift_ppm": rounded(mark.drift_ppm, 3),
        "text": mark.text,
    }


def _moment(moment: Moment) -> Message:
    verdict = moment.verdict
    return {
        "frame": verdict.frame,
        "at_s": rounded(moment.at_s, 3),
        "state": verdict.state.value,
        "cause": verdict.cause and verdict.cause.value,
        "offset_ms": ms(verdict.offset_ns),
    }


def _series(record: PairRecord) -> Message:
    edges_s = record.series.edges() / record.fps
    curves = {name: _listed(record.series.mean(name)) for name in VALUES}
    return {"from_s": _listed(edges_s[:-1]), "to_s": _listed(edges_s[1:]), **curves}


def _listed(values: Floats) -> list[float | None]:
    return [round(float(value), 4) if np.isfinite(value) else None for value in values]
