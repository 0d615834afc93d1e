"""What each recipe does to stamps, ids and pictures, slot by slot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from pipeline.assemble import KINDS
from pipeline.buffer import BufferSettings
from pipeline.errors import InputError
from pipeline.faults.source import FaultedSource
from pipeline.frame import Frame
from tests.frames import PERIOD_NS
from tests.pipeline.faults.streams import COUNT, Rendered, Scripted, faulted


def right(*faults: dict[str, Any], **options: Any) -> dict[int, tuple[int, int | None, int]]:
    """The right camera's slots: stamp in periods, id, picture."""
    source = faulted(*faults, **options)
    source.open()
    frames = [item for item in source.frames() if item.camera == "right"]
    return {item.group: (item.captured_ns // PERIOD_NS, item.sequence, int(item.image[0, 0])) for item in frames}


CLEAN = {100 + n: (n, n, n) for n in range(COUNT)}


def test_a_slip_puts_picture_and_stamp_of_a_later_frame_under_the_slots_id():
    slots = right({"type": "slip", "frames": 1, "start_s": 0.3, "stop_s": 0.6})
    assert slots == {**CLEAN, 103: (4, 3, 4), 104: (5, 4, 5), 105: (6, 5, 6)}


def test_a_stale_slip_leaves_the_first_slot_empty():
    slots = right({"type": "slip", "frames": -1})
    assert slots == {100 + n: (n - 1, n, n - 1) for n in range(1, COUNT)}


def test_a_slip_past_the_end_leaves_the_last_slots_empty():
    assert max(right({"type": "slip", "frames": 3})) == 106


def test_a_content_shift_changes_the_picture_alone():
    assert right({"type": "content_shift", "frames": -2, "start_s": 0.5}) == {
        **CLEAN,
        **{100 + n: (n, n, n - 2) for n in range(5, COUNT)},
    }


def test_a_seq_offset_changes_ids_alone():
    assert right({"type": "seq_offset", "ids": 7}) == {100 + n: (n, n + 7, n) for n in range(COUNT)}


def test_a_drop_leaves_slots_empty_and_a_gap_in_the_ids():
    slots = right({"type": "drop", "every": 4})
    assert slots == {slot: value for slot, value in CLEAN.items() if slot not in {103, 107}}


def test_a_renumbered_drop_shows_no_gap_in_the_ids():
    slots = right({"type": "drop", "every": 4, "renumber": True})
    assert [value[1] for value in slots.values()] == list(range(8))
    assert [value[0] for value in slots.values()] == [0, 1, 2, 4, 5, 6, 8, 9]


def test_a_renumbered_counter_does_not_catch_up_when_the_drops_end():
    slots = right({"type": "drop", "every": 2, "renumber": True, "stop_s": 0.5})
    assert [value[1] for value in slots.values()] == list(range(8))


def test_random_drops_follow_the_seed():
    drop = {"type": "drop", "probability": 0.5}
    assert right(drop, seed=1) == right(drop, seed=1)
    assert len({tuple(right(drop, seed=seed)) for seed in range(8)}) > 4


def test_a_frozen_camera_repeats_its_picture_under_new_stamps_and_ids():
    slots = right({"type": "frozen", "start_s": 0.4, "stop_s": 0.8})
    assert slots == {**CLEAN, **{100 + n: (n, n, 4) for n in range(4, 8)}}


def test_stamps_drift_from_the_onset_and_fast_is_positive():
    source = faulted({"type": "stamp_drift", "ppm": 1000, "start_s": 0.2})
    source.open()
    drifts = [item.captured_ns - item.sequence * PERIOD_NS for item in source.frames() if item.camera == "right"]
    assert drifts == [0, 0, *(n * PERIOD_NS // 1000 for n in range(8))]


def test_the_camera_can_be_named():
    assert right({"type": "seq_offset", "camera": "left"}) == CLEAN


def test_faults_compose_in_order():
    slots = right({"type": "slip", "frames": 1}, {"type": "content_shift", "frames": -1})
    assert slots[105] == (6, 5, 5)


def test_without_groups_the_slots_are_those_of_the_rigs_own_pairing():
    slots = right({"type": "slip", "frames": 1, "start_s": 0.5}, source=Scripted(grouped=False))
    assert slots == {n: (n + (n >= 5), n, n + (n >= 5)) for n in range(COUNT - 1)}


def test_the_truth_of_what_is_shown_is_noted():
    source = faulted({"type": "content_shift", "frames": -1, "start_s": 0.5})
    source.open()
    truths = [item.truth for item in source.frames() if item.camera == "right"]
    assert [truth.shown_ns // PERIOD_NS for truth in truths] == [0, 1, 2, 3, 4, 4, 5, 6, 7, 8]
    assert [truth.faults for truth in truths] == [()] * 5 + [("content_shift",)] * 5


def test_a_fraction_of_a_frame_is_rendered():
    slots = right({"type": "slip", "frames": 0.5, "start_s": 0.5}, source=Rendered())
    assert slots[105] == (5, 5, 55)


def test_a_fraction_of_a_recording_is_refused():
    with pytest.raises(InputError, match="only rendered pictures"):
        faulted({"type": "slip", "frames": 0.5}).open()


def test_a_source_whose_faults_are_refused_is_closed():
    source = Scripted()
    with pytest.raises(InputError):
        faulted({"type": "slip", "frames": 0.5}, source=source).open()
    assert source.closed


def test_a_camera_that_does_not_exist_is_refused_with_those_that_do():
    with pytest.raises(InputError, match="no camera 'top': this rig has left, right"):
        faulted({"type": "slip", "camera": "top"}).open()


@pytest.mark.parametrize(
    "settings", [{"start_s": 2, "stop_s": 1}, {"start_s": -1}, {"probability": 0.1, "every": 3}, {}, {"probability": 2}]
)
def test_settings_that_make_no_sense_are_refused(settings):
    with pytest.raises(ValueError, match=r"stop_s|start_s|either|less than"):
        KINDS.tables["faults"]["drop"].settings.model_validate(
            {"every": 3, **settings} if "_s" in str(settings) else settings
        )


def test_stream_time_is_that_of_the_rig_whatever_a_cameras_clock_shows():
    """The right clock is 5 s ahead and the left camera misses the first frame."""

    class Apart(Scripted):
        def frames(self) -> Iterator[Frame]:
            for item in super().frames():
                if item.camera == "right":
                    yield replace(item, captured_ns=item.captured_ns + 5_000_000_000)
                elif item.sequence not in {0, 5}:
                    yield item

    source = faulted({"type": "seq_offset", "ids": 100, "start_s": 0.4, "stop_s": 0.7}, source=Apart())
    source.open()
    bent = [item.group for item in source.frames() if item.camera == "right" and item.sequence >= 100]
    assert bent == [104, 105, 106]


def test_faults_pair_as_the_rigs_own_buffer_does():
    """The right stamps lie 30 ms off every third frame: beyond a tolerance of 20 ms they stand alone."""

    class Jittery(Scripted):
        def frames(self) -> Iterator[Frame]:
            for item in super().frames():
                off_ns = 30_000_000 * (item.camera == "right" and item.sequence % 3 == 2)
                yield replace(item, captured_ns=item.captured_ns + off_ns)

    counts = []
    for tolerance in ("auto", 20.0):
        source = FaultedSource(Jittery(grouped=False), lambda _: [], BufferSettings(pairing_tolerance_ms=tolerance))
        source.open()
        groups = [item.group for item in source.frames()]
        counts.append(len(set(groups)))
    assert counts == [10, 13]


def test_what_is_assumed_of_a_recording_is_marked_as_such():
    source = faulted({"type": "slip", "frames": 1})
    source.open()
    assert all(item.truth is not None and item.truth.assumed for item in source.frames())


def test_a_source_with_one_camera_cannot_be_tampered_with():
    source = Scripted()
    source.cameras = source.cameras[:1]
    with pytest.raises(InputError, match="one camera only"):
        faulted({"type": "slip"}, source=source).open()
