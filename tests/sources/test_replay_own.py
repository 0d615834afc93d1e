"""Recordings of our own give back what was recorded."""

from __future__ import annotations

import logging
import random
from dataclasses import replace
from itertools import islice

import pytest

from pipeline.errors import InputError
from pipeline.frame import Camera, Pair, Rig, StampOrigin, StampReference, Truth
from sources.replay.settings import ReplaySettings
from sources.replay.source import ReplaySource
from tests.frames import PERIOD_NS, RIG, frame, texture
from tests.recorded import Clock, record, replayed, salvaged, same


def moving(number: int, camera: str = "left", **fields):
    """Frame `number` of a camera, with a picture of its own."""
    made = frame(camera, number * PERIOD_NS, number, image=texture(number, 32, 24), group=number)
    return replace(made, **fields)


def stereo(count: int, **fields):
    return [moving(number, name, **fields) for number in range(count) for name in ("left", "right")]


def by_camera(frames):
    return {name: [item for item in frames if item.camera == name] for name in ("left", "right")}


def assert_same(given, recorded):
    for name, frames in by_camera(given).items():
        back = by_camera(recorded)[name]
        assert len(back) == len(frames)
        assert all(same(one, other) for one, other in zip(frames, back, strict=True))


@pytest.mark.parametrize("pictures", ["raw", "png"])
def test_every_field_and_every_pixel_comes_back(tmp_path, pictures):
    rich = {
        "clock": "ptp",
        "epoch": 2,
        "exposure_ns": 7_000_000,
        "stamp_reference": StampReference.MIDDLE,
        "stamp_origin": StampOrigin.DRIVER,
        "truth": Truth(5, ("slip",), assumed=True),
    }
    colour = texture(9, 96, 24).reshape(24, 32, 3)
    given = [
        *stereo(2, **rich),
        moving(2, "left", sequence=None, group=None),
        moving(2, "right", captured_ns=-5, arrived_ns=2**62, stamp_origin=StampOrigin.ARRIVAL),
    ]
    assert_same(given, replayed(record(tmp_path / "a.mcap", *given, pictures=pictures)))
    in_colour = [replace(item, image=colour) for item in given]
    assert_same(in_colour, replayed(record(tmp_path / "b.mcap", *in_colour, pictures=pictures)))


def test_holes_and_repeated_frames_come_back_as_they_were(tmp_path):
    rng = random.Random(4)
    given = [item for item in stereo(60) if rng.random() > 0.2]
    given[10:10] = [given[9]]
    assert_same(given, replayed(record(tmp_path / "a.mcap", *given, chunk_bytes=4096)))


def test_jpeg_loses_little_and_nothing_but_pixels(tmp_path):
    given = stereo(3)
    back = replayed(record(tmp_path / "a.mcap", *given, pictures="jpeg", jpeg_quality=95))
    assert_same([replace(item, image=other.image) for item, other in zip(given, back, strict=True)], back)
    for item, other in zip(given, back, strict=True):
        assert abs(item.image.astype(int) - other.image.astype(int)).mean() < 4


def test_the_source_knows_cameras_rates_and_the_number_of_frames(tmp_path):
    rig = Rig("bench", (Camera("front", 29.97), Camera("rear", 10), Camera("top", 5)), (Pair("front", "rear"),))
    given = [moving(number, name) for number in range(7) for name in ("front", "rear", "top")]
    path = record(tmp_path / "a.mcap", *given, rig=rig)
    source = ReplaySource(ReplaySettings(path=str(path)), base=tmp_path)
    source.open()
    assert source.cameras == rig.cameras
    assert source.frame_count == 7
    assert source.pairs == (("front", "rear"),)
    source.close()


def test_cameras_can_be_named_anew_and_paired_otherwise(tmp_path):
    path = record(tmp_path / "a.mcap", *stereo(3))
    assert {item.camera for item in replayed(path, cameras=["a", "b"])} == {"a", "b"}
    assert {item.group for item in replayed(path, pair_by="time")} == {None}
    assert [item.sequence for item in replayed(path, from_s=0.1, to_s=0.2)] == [1, 1]
    assert {item.camera for item in replayed(path, format="mcap")} == {"left", "right"}
    shifted = record(tmp_path / "b.mcap", *[replace(item, group=item.group + 5) for item in stereo(3)])
    assert [item.group for item in replayed(shifted, pair_by="index") if item.camera == "left"] == [0, 1, 2]


def test_repeated_it_goes_on_counting(tmp_path):
    given = [*stereo(3), *stereo(3, epoch=1)]
    path = record(tmp_path / "a.mcap", *given)
    source = ReplaySource(ReplaySettings(path=str(path), loop=True), base=tmp_path)
    source.open()
    rounds = list(islice(source.frames(), 36))
    source.close()
    left = [item for item in rounds if item.camera == "left"]
    epochs = [item.epoch for item in left]
    assert epochs == sorted(epochs)
    for before, after in zip(left, left[6:], strict=False):
        assert after.captured_ns - before.captured_ns == after.arrived_ns - before.arrived_ns > 0
        assert after.sequence > before.sequence


def cut(path, size):
    shorter = path.with_name(f"cut-{size}.mcap")
    shorter.write_bytes(path.read_bytes()[:size])
    return shorter


def test_a_file_that_breaks_off_anywhere_is_read_up_to_its_last_whole_chunk(tmp_path, caplog):
    path = record(tmp_path / "a.mcap", *stereo(40), chunk_bytes=4096)
    rng = random.Random(1)
    whole = path.stat().st_size
    for size in [whole - 1, whole - 40, *(rng.randrange(whole // 4, whole) for _ in range(20))]:
        caplog.clear()
        shorter = cut(path, size)
        messages = salvaged(shorter)
        back = replayed(shorter)
        for name in ("left", "right"):
            told = {item.sequence for item in messages[f"/{name}/frame"]}
            expected = [item.sequence for item in messages[f"/{name}/image"] if item.sequence in told]
            assert [item.sequence for item in back if item.camera == name] == expected
        warnings = [entry for entry in caplog.records if "has no end" in entry.message]
        assert len(warnings) == 1
        assert all(entry.levelno <= logging.WARNING for entry in caplog.records)


def test_a_file_without_one_whole_chunk_is_refused_in_one_sentence(tmp_path):
    path = record(tmp_path / "a.mcap", *stereo(4))
    with pytest.raises(InputError, match="there is no frame of left in it"):
        replayed(cut(path, 700))
    with pytest.raises(InputError, match="damaged or no recording"):
        replayed(cut(path, 20))
    with pytest.raises(InputError, match=r"is empty \(0 bytes\)"):
        replayed(cut(path, 0))


def test_zeros_at_the_end_are_left_alone(tmp_path):
    path = record(tmp_path / "a.mcap", *stereo(10), chunk_bytes=4096)
    shorter = cut(path, path.stat().st_size // 2)
    frames = len(replayed(shorter))
    shorter.write_bytes(shorter.read_bytes() + bytes(5000))
    assert len(replayed(shorter)) == frames


def test_a_damaged_chunk_is_a_gap_that_is_said(tmp_path, caplog):
    path = record(tmp_path / "a.mcap", *stereo(40), chunk_bytes=4096)
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 200] = bytes(200)
    path.write_bytes(data)
    back = replayed(path)
    assert 30 < len(back) < 80
    assert all(same(item, moving(item.sequence, item.camera)) for item in back)
    assert back[-1].sequence == 39
    assert f"{path}: damaged at byte " in caplog.text


def test_a_recording_without_pictures_says_so(tmp_path):
    path = record(tmp_path / "a.mcap", *stereo(3), pictures="none")
    with pytest.raises(InputError, match="left was recorded without pictures"):
        replayed(path)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"pair_by": "number"}, "not by number"),
        ({"cameras": ["a"]}, "1 names (a) for the 2 cameras"),
        ({"topics": ["/left/image", "/right/image"]}, "format: mcap only"),
        ({"format": "euroc"}, "it looks like 'syncwatch'"),
    ],
)
def test_what_does_not_fit_is_said(tmp_path, settings, said):
    path = record(tmp_path / "a.mcap", *stereo(3))
    with pytest.raises(InputError) as error:
        replayed(path, **settings)
    assert said in str(error.value)


def test_a_lone_camera_is_not_enough(tmp_path):
    rig = Rig("bench", RIG.cameras[:1], ())
    path = record(tmp_path / "a.mcap", moving(0), rig=rig)
    with pytest.raises(InputError, match="one camera only"):
        replayed(path)


def test_live_frames_come_back_in_the_order_in_which_they_arrived(tmp_path):
    clock = Clock(10**12)
    given = []
    for number in range(8):
        given += [
            moving(number, "right", arrived_ns=clock() + number * PERIOD_NS, group=None),
            moving(number, "left", arrived_ns=clock() + number * PERIOD_NS + 1000, group=None),
        ]
    clock.now_ns += 8 * PERIOD_NS
    back = replayed(record(tmp_path / "a.mcap", *given, live=True, clock=clock))
    assert [item.camera for item in back] == ["right", "left"] * 8
