"""What a recording holds, for the libraries and programs of others."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import cv2
import jsonschema
import numpy as np
import pytest
from mcap.reader import make_reader

from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, Camera, Pair, Rig
from pipeline.mcap.timeline import Timeline
from pipeline.verdict import Event
from sinks.mcap.settings import McapSettings
from sinks.mcap.sink import McapSink
from tests.contract.test_sinks import REPORTS
from tests.frames import PERIOD_NS, RIG, frame, texture
from tests.recorded import WALL_NS, Clock, decoded, mcap_sink, record, replayed, salvaged, schemas

PICTURE = texture(3, 40, 24)


def numbered(number: int, camera: str = "left", **fields):
    return replace(frame(camera, number * PERIOD_NS, number, image=PICTURE, group=number), **fields)


def event(phase: str, name: str = "a-1") -> Event:
    return Event("bench", name, "async", phase, "left-right", "right", None, 1, None, {}, "late")


def test_raw_pictures_are_in_the_public_schema(tmp_path):
    colour = np.dstack([PICTURE, PICTURE // 2, 255 - PICTURE])
    path = record(tmp_path / "a.mcap", numbered(7), numbered(7, "right", image=colour))
    messages = decoded(path)
    (left,), (right,) = messages["/left/image"], messages["/right/image"]
    assert (left.encoding, left.width, left.height, left.step, left.frame_id) == ("mono8", 40, 24, 40, "left")
    assert np.array_equal(np.frombuffer(left.data, np.uint8).reshape(24, 40), PICTURE)
    assert (right.encoding, right.step) == ("bgr8", 120)
    assert np.array_equal(np.frombuffer(right.data, np.uint8).reshape(24, 40, 3), colour)
    assert left.timestamp.seconds * NS_PER_S + left.timestamp.nanos == 7 * PERIOD_NS
    assert schemas(path)["/left/image"].name == "foxglove.RawImage"


@pytest.mark.parametrize("pictures", ["png", "jpeg"])
def test_compressed_pictures_are_in_the_public_schema(tmp_path, pictures):
    path = record(tmp_path / "a.mcap", numbered(0), pictures=pictures)
    (message,) = decoded(path)["/left/image"]
    assert message.format == pictures
    back = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert back.shape == PICTURE.shape
    assert np.array_equal(back, PICTURE) == (pictures == "png")
    assert schemas(path)["/left/image"].name == "foxglove.CompressedImage"


def test_everything_else_a_frame_carries_is_told_beside_it(tmp_path):
    path = record(tmp_path / "a.mcap", numbered(3, exposure_ns=5, epoch=1), pictures="none")
    messages = decoded(path)
    assert list(messages) == ["/left/frame"]
    assert messages["/left/frame"] == [
        {
            "schema": "syncwatch.frame.v1",
            "camera": "left",
            "sequence": 3,
            "captured_ns": 3 * PERIOD_NS,
            "clock": "rig",
            "arrived_ns": 3 * PERIOD_NS,
            "group": 3,
            "epoch": 1,
            "exposure_ns": 5,
            "stamp_reference": "unknown",
            "stamp_origin": "device",
            "width": 40,
            "height": 24,
            "channels": 1,
        }
    ]


def test_reports_are_json_that_its_own_schema_describes(tmp_path):
    path = record(tmp_path / "a.mcap", numbered(0), *REPORTS)
    messages = decoded(path)
    assert {topic: len(said) for topic, said in messages.items() if "image" not in topic} == {
        "/left/frame": 1,
        "/syncwatch/verdict/left-right": 2,
        "/syncwatch/event": 2,
        "/syncwatch/status": 1,
        "/syncwatch/aligned/left-right": 1,
    }
    for topic, schema in schemas(path).items():
        if schema.encoding == "jsonschema":
            described = json.loads(schema.data)
            jsonschema.Draft202012Validator.check_schema(described)
            for message in messages[topic]:
                jsonschema.validate(message, described)
                assert set(message) <= set(described["properties"]), topic
                assert message["schema"] == schema.name


def single_types(schema):
    """Fails on what Foxglove's reader of JSON schemas refuses: a type that is not one, an object without a list."""
    assert schema["type"] in {"object", "array", "string", "number", "integer", "boolean"}
    if schema["type"] == "object":
        for inner in schema["properties"].values():
            single_types(inner)
    if schema["type"] == "array":
        single_types(schema["items"])


def test_its_json_schemas_are_of_the_simple_kind_that_foxglove_reads(tmp_path):
    path = record(tmp_path / "a.mcap", numbered(0), *REPORTS)
    described = [json.loads(schema.data) for schema in schemas(path).values() if schema.encoding == "jsonschema"]
    assert len(described) == 5
    for schema in described:
        single_types(schema)


def test_metadata_tells_of_the_rig(tmp_path):
    rig = Rig(
        "cart7",
        (Camera("front", 29.97), Camera("rear", 10), Camera("top", 10)),
        (Pair("front", "rear", 5_000_000), Pair("front", "top")),
    )
    path = record(tmp_path / "a.mcap", numbered(0, "top"), rig=rig)
    with path.open("rb") as stream:
        reader = make_reader(stream)
        (told,) = reader.iter_metadata()
        assert reader.get_header().library == "syncwatch 1.2.3"
    assert told.name == "syncwatch.recording.v1"
    assert told.metadata == {
        "rig": "cart7",
        "cameras": "front,rear,top",
        "fps": "29.97,10,10",
        "pairs": "front-rear,front-top",
        "expected_offset_ns": "5000000,0",
        "version": "1.2.3",
        "pictures": "raw",
        "around_events_s": "",
        "began_ns": str(WALL_NS),
    }


def log_times(path, topic="/left/frame"):
    return [message.log_time - WALL_NS for message in salvaged(path)[topic]]


def test_live_frames_are_logged_when_they_arrived(tmp_path):
    clock = Clock(100 * NS_PER_S)
    frames = [numbered(n, captured_ns=n, arrived_ns=99 * NS_PER_S + n) for n in range(3)]
    odd = [numbered(3, arrived_ns=0), numbered(4, arrived_ns=101 * NS_PER_S)]
    path = record(tmp_path / "a.mcap", *frames, *odd, live=True, clock=clock)
    arrived = [99 * NS_PER_S + n for n in range(3)]
    assert log_times(path) == [*arrived, 100 * NS_PER_S, 100 * NS_PER_S]


def test_frames_of_a_recording_are_logged_as_if_it_ran_at_its_own_pace(tmp_path):
    stamps = [0, 1, 2, 12, 13, 5, 6]  # a gap of ten periods; then a clock that is set back
    path = record(tmp_path / "a.mcap", *[numbered(n, captured_ns=n * PERIOD_NS) for n in stamps], REPORTS[0])
    assert log_times(path) == [n * PERIOD_NS for n in (0, 1, 2, 12, 13, 14, 15)]
    assert log_times(path, "/syncwatch/verdict/left-right") == [15 * PERIOD_NS]


def test_the_time_of_day_may_be_set_while_it_runs():
    monotonic, wall = Clock(100), Clock(WALL_NS)
    timeline = Timeline(RIG.cameras, live=True, wall_ns=wall, monotonic_ns=monotonic)
    assert timeline.of(numbered(0, arrived_ns=90)) == WALL_NS - 10
    wall.now_ns += 3600 * NS_PER_S
    assert timeline.of(numbered(1, arrived_ns=95)) == WALL_NS + 3600 * NS_PER_S - 5


def test_what_is_older_than_a_second_is_in_the_file(tmp_path):
    clock = Clock()
    sink = mcap_sink(tmp_path / "a.mcap", clock=clock, live=True)
    sink.start()
    for number in range(25):
        clock.now_ns = number * PERIOD_NS
        sink.take_frame(numbered(number, arrived_ns=clock()))
        written = [message.sequence for message in salvaged(tmp_path / "a.mcap")["/left/image"]]
        assert len(written) >= number - NS_PER_S // PERIOD_NS
        assert written == list(range(len(written)))
    sink.stop()


def test_the_path_names_rig_and_time(tmp_path):
    sink = mcap_sink(tmp_path / "{rig}-{time}.mcap")
    sink.start()
    sink.stop()
    (file,) = tmp_path.iterdir()
    assert file.name == "bench-20260921T141320Z.mcap"
    assert re.match(r"\d{8}T", McapSettings().path) is None


@pytest.mark.parametrize("path", ["{day}.mcap", "-", ""])
def test_a_path_that_cannot_be_meant_is_refused(path):
    with pytest.raises(ValueError, match=r"placeholder \{day\}|standard output|at least 1 character"):
        McapSettings(path=path)


def test_a_file_that_is_there_is_kept_unless_told_otherwise(tmp_path):
    path = record(tmp_path / "a.mcap", numbered(0))
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"a.mcap: exists already"):
        mcap_sink(path).start()
    assert path.read_bytes() == before
    record(path, numbered(0), numbered(1), overwrite=True)
    assert path.read_bytes() != before


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(InputError, match=r"cannot be written: there is no folder .*nowhere"):
        mcap_sink(tmp_path / "nowhere" / "a.mcap")
    with pytest.raises(InputError, match="/dev/full: cannot be written: No space left on device"):
        mcap_sink(tmp_path / "/dev/full", overwrite=True).start()


def test_it_ends_by_itself_before_it_grows_too_large(tmp_path, caplog):
    noise = np.random.default_rng(1).integers(0, 256, (60, 100, 100), np.uint8)
    frames = [numbered(n, image=noise[n]) for n in range(60)]
    path = record(tmp_path / "a.mcap", *frames, *REPORTS, max_bytes=300_000, chunk_bytes=50_000)
    assert 200_000 < path.stat().st_size <= 300_000
    assert 20 < len(replayed_left(path)) < 30
    (said,) = [entry for entry in caplog.records if entry.levelname == "WARNING"]
    assert "recording ended: it has reached max_bytes (300000); monitoring goes on" in said.message


def replayed_left(path):
    """Frames of a file that is whole: its index can be read."""
    with path.open("rb") as stream:
        return list(make_reader(stream).iter_messages(topics=["/left/image"]))


def test_it_ends_by_itself_before_the_disk_is_full(tmp_path, caplog):
    path = record(tmp_path / "a.mcap", *[numbered(n) for n in range(5)], min_free_bytes=1 << 60)
    assert replayed_left(path) == []
    (said,) = [entry for entry in caplog.records if entry.levelname == "ERROR"]
    assert "of the disk are free" in said.message


def around(path, items, **settings):
    record(path, *items, around_events_s=2, **settings)
    messages = salvaged(path)
    return [message.sequence for message in messages["/left/image"]], len(messages["/syncwatch/event"])


def test_around_events_only_what_is_near_one_is_recorded(tmp_path):
    frames = [numbered(n) for n in range(200)]
    items = [*frames[:50], event("onset"), *frames[50:80], event("end"), *frames[80:]]
    assert around(tmp_path / "a.mcap", items) == (list(range(29, 100)), 2)


def test_events_that_overlap_or_follow_soon_are_one_stretch(tmp_path):
    frames = [numbered(n) for n in range(200)]
    items = [
        *frames[:50], event("onset"), *frames[50:55], event("onset", "a-2"), *frames[55:60], event("end"),
        *frames[60:90], event("end", "a-2"), *frames[90:100], event("onset", "a-3"), event("end", "a-3"), *frames[100:],
    ]  # fmt: skip
    assert around(tmp_path / "a.mcap", items) == (list(range(29, 120)), 6)


def test_without_an_event_nothing_is_recorded(tmp_path):
    assert around(tmp_path / "a.mcap", [numbered(n) for n in range(50)]) == ([], 0)


def test_an_event_at_the_very_end_brings_what_led_to_it(tmp_path):
    assert around(tmp_path / "a.mcap", [*[numbered(n) for n in range(50)], event("onset")]) == (list(range(29, 50)), 1)


def test_what_is_held_back_is_bounded(tmp_path, caplog):
    large = np.zeros((300, 500), np.uint8)
    items = [*[numbered(n, image=large) for n in range(50)], event("onset"), event("end")]
    frames, _ = around(tmp_path / "a.mcap", items, ring_bytes=1 << 20)
    assert frames == list(range(44, 50))
    assert sum("fit into ring_bytes" in entry.message for entry in caplog.records) == 1


def test_a_picture_that_cannot_be_encoded_is_named(tmp_path):
    wide = np.zeros((1, 70_000), np.uint8)
    with pytest.raises(Exception, match="left: a picture of 70000x1 pixels is no jpeg"):
        record(tmp_path / "a.mcap", replace(numbered(0), image=wide), pictures="jpeg")


def test_frames_are_counted_at_the_end(tmp_path, caplog):
    caplog.set_level("INFO")
    record(tmp_path / "a.mcap", numbered(0), numbered(1), numbered(0, "right"))
    assert "a.mcap: frames: 2 of left, 1 of right; 0.0 MB" in caplog.text


def test_a_sink_that_wants_frames_says_so():
    assert McapSink.wants_frames


def test_it_is_read_back(tmp_path):
    path = record(tmp_path / "a.mcap", numbered(0), *REPORTS, numbered(0, "right"))
    assert [item.camera for item in replayed(path)] == ["left", "right"]
