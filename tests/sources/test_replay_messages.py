"""Bags and MCAP files: which topics are the cameras, what stamps count, and what damage does."""

from __future__ import annotations

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap.reader import make_reader
from mcap.writer import IndexType, Writer
from mcap_protobuf.writer import Writer as ProtobufWriter

from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, Frame, StampOrigin
from sources.replay.messages.container import Topic
from sources.replay.messages.topics import choose
from sources.replay.notices import Notices
from tests import formats
from tests.formats import EPOCH_NS, LATENCY_NS
from tests.sources.test_replay_kit import opened, replayed

PERIOD_NS = 50_000_000


def frame(camera, index, size=(60, 80)):
    image = np.random.default_rng(index).integers(0, 256, size, np.uint8)  # so that no compression helps
    return Frame(camera, index, index * PERIOD_NS, "rig", 0, image)


@pytest.fixture
def small():
    return {side: [frame(side, index) for index in range(60)] for side in ("left", "right")}


def write_foxglove(path, frames, stamp_ns=lambda one: EPOCH_NS + one.captured_ns, **options):
    """Raw pictures in an MCAP; `frames` in the order in which they are written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file, ProtobufWriter(file, **options) as writer:
        for place, one in enumerate(frames):
            height, width = one.image.shape
            message = RawImage(width=width, height=height, encoding="mono8", step=width, data=one.image.tobytes())
            message.timestamp.seconds, message.timestamp.nanos = divmod(stamp_ns(one), NS_PER_S)
            logged_ns = EPOCH_NS + LATENCY_NS + place * PERIOD_NS // 2
            writer.write_message(f"/{one.camera}/image", message, logged_ns, logged_ns, sequence=place)
    return path


def in_order(scene):
    return [one for _, one in formats.in_order(scene)]


KILLED = {
    "rosbag1": lambda root, scene: formats.rosbag1(root, scene, chunk_bytes=4096),
    "rosbag1_lz4": lambda root, scene: formats.rosbag1_lz4(root, scene, chunk_bytes=1024),
    "mcap": lambda root, scene: write_foxglove(root / "drive.mcap", in_order(scene), chunk_size=4096),
}


@pytest.mark.parametrize("kind", KILLED)
@pytest.mark.parametrize("share", [0.3, 0.55, 0.8])
def test_what_is_there_of_a_truncated_recording_is_read(tmp_path, small, kind, share, caplog):
    whole = KILLED[kind](tmp_path / "whole", small)
    cut = tmp_path / whole.name
    data = whole.read_bytes()
    cut.write_bytes(data[: int(share * len(data))])
    frames = replayed(cut)
    assert 0 < len(frames) < 120
    assert [one.captured_ns for one in frames] == [EPOCH_NS + one.captured_ns for one in in_order(small)][: len(frames)]
    assert re.search("has no end|not indexed", caplog.text)
    assert kind == "mcap" or "damaged or truncated" in caplog.text


def test_damage_in_the_middle_of_an_mcap_is_a_gap_that_is_said(tmp_path, small, caplog):
    """The first pieces too, which tell of topics, and a length that leads astray."""
    path = write_foxglove(tmp_path / "drive.mcap", in_order(small), chunk_size=40_000)
    whole = path.read_bytes()
    chunks = [index.chunk_start_offset for index in make_reader(io.BytesIO(whole)).get_summary().chunk_indexes]
    for at, bad in ((chunks[0] + 500, bytes(100)), (chunks[4] + 500, bytes(100)), (chunks[4] + 1, b"\xff" * 8)):
        caplog.clear()
        path.write_bytes(whole[:at] + bad + whole[at + len(bad) :])
        frames = replayed(path)
        assert 100 < len(frames) < 120
        assert frames[-1].captured_ns == EPOCH_NS + 59 * PERIOD_NS
        assert caplog.text.count(f"{path}: damaged at byte ") == 1


def test_a_piece_of_an_mcap_that_says_it_is_larger_than_memory_is_not_read(tmp_path, small, caplog):
    path = write_foxglove(tmp_path / "drive.mcap", in_order(small), chunk_size=40_000)
    whole = path.read_bytes()
    second = make_reader(io.BytesIO(whole)).get_summary().chunk_indexes[1].chunk_start_offset
    size = 64 << 30
    with path.open("r+b") as stream:
        stream.seek(second + 1)
        stream.write(size.to_bytes(8, "little"))
        stream.truncate(second + 9 + size)  # a hole, which takes no room
    assert 0 < len(replayed(path)) < 20
    assert f"{path}: damaged at byte " in caplog.text


@pytest.mark.parametrize(
    "options",
    [
        {"index_types": IndexType.NONE},
        {"use_chunking": False},
        {"repeat_channels": False, "repeat_schemas": False},
        {"use_statistics": False, "use_summary_offsets": False},
    ],
    ids=lambda options: next(iter(options)),
)
def test_an_mcap_whose_end_tells_less_is_read_alike_and_nothing_is_wrong_with_it(tmp_path, small, options, caplog):
    path = tmp_path / "drive.mcap"
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start()
        schema = writer.register_schema("foxglove.RawImage", "protobuf", b"")
        channels = {side: writer.register_channel(f"/{side}/image", "protobuf", schema) for side in small}
        for one in in_order(small):
            data = RawImage(width=80, height=60, encoding="mono8", step=80, data=one.image.tobytes())
            data.timestamp.nanos = 1 + one.captured_ns // 10
            writer.add_message(channels[one.camera], one.captured_ns, data.SerializeToString(), one.captured_ns)
        writer.finish()
    assert len(replayed(path)) == 120
    assert not caplog.records


@pytest.mark.parametrize("whole_folder", [True, False])
def test_what_is_there_of_a_truncated_db3_is_read(tmp_path, small, whole_folder, caplog):
    folder = formats.rosbag2(tmp_path / "bag", small)
    (file,) = folder.glob("*.db3")
    data = file.read_bytes()
    file.write_bytes(data[: int(0.6 * len(data))])
    frames = replayed(folder if whole_folder else file)
    assert 50 < len(frames) < 110
    assert [one.captured_ns for one in frames] == [EPOCH_NS + one.captured_ns for one in in_order(small)][: len(frames)]
    assert f"{file}: damaged or truncated" in caplog.text


@pytest.mark.parametrize("kind", ["rosbag1", "rosbag1_lz4"])
def test_a_bag_cut_off_after_its_chunks_is_read(tmp_path, small, kind, caplog):
    whole = KILLED[kind](tmp_path / "whole", small)
    cut = tmp_path / "cut.bag"
    data = whole.read_bytes()
    cut.write_bytes(data[: int(0.995 * len(data))])
    frames = replayed(cut)
    assert len(frames) == 120
    assert "not indexed" in caplog.text


def test_an_mcap_that_was_ended_before_its_first_chunk_is_refused(tmp_path):
    path = tmp_path / "drive.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("sensor_msgs/msg/CompressedImage", "ros2msg", b"")
        channel = writer.register_channel("/left/image", "cdr", schema)
        writer.add_message(channel, 1, b"\0\1\0\0", 1)
    with pytest.raises(InputError, match=r"drive\.mcap"):
        opened(path)


@pytest.mark.parametrize("name", ["drive.mcap", "drive.bag", "drive.db3"])
@pytest.mark.parametrize("content", ["head", "noise"])
def test_a_file_of_nothing_but_damage_is_refused_in_one_line(tmp_path, name, content):
    heads = {"drive.mcap": b"\x89MCAP0\r\n", "drive.bag": b"#ROSBAG V2.0\n", "drive.db3": b"SQLite format 3\0"}
    noise = np.random.default_rng(1).integers(0, 256, 5000, np.uint8).tobytes()
    (tmp_path / name).write_bytes(heads[name] + (noise if content == "noise" else b""))
    with pytest.raises(InputError) as refused:
        opened(tmp_path / name)
    assert name in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_bag_of_another_version_is_refused(tmp_path):
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V1.2\n" + bytes(100))
    with pytest.raises(InputError, match=r"another version: expected version 2\.0"):
        opened(tmp_path / "old.bag")


def test_a_topic_that_does_not_exist_is_refused_with_those_that_do(tmp_path, small):
    path = formats.rosbag1(tmp_path / "bag", small)
    with pytest.raises(InputError, match=r"no topic '/cam7/image_raw' with pictures: there is /cam0/image_raw, /cam1/"):
        opened(path, topics={"left": "/cam0/image_raw", "right": "/cam7/image_raw"})


def test_a_topic_of_another_kind_is_refused_with_what_it_holds(tmp_path):
    there = [*topics("/left/image", "/right/image"), Topic("/imu", "sensor_msgs/msg/Imu", "cdr", 10)]
    with pytest.raises(InputError, match=r"'/imu' holds no pictures but sensor_msgs/msg/Imu: there is /left/image, "):
        choose(tmp_path, there, ["/left/image", "/imu"], None, Notices())


def test_topics_may_have_names_without_a_slash(tmp_path):
    named = choose(tmp_path, topics("cam0", "cam1"), {"left": "cam0", "right": "/cam1"}, None, Notices())
    assert [topic.name for topic in named.topics.values()] == ["cam0", "cam1"]


def test_topics_without_a_message_are_called_empty(tmp_path):
    empty = [replace(topic, count=0) for topic in topics("/left/image", "/right/image")]
    with pytest.raises(InputError, match="not one picture in it: /left/image, /right/image are empty"):
        choose(tmp_path, empty, None, None, Notices())


def test_topics_name_their_cameras(tmp_path, small):
    path = formats.rosbag1(tmp_path / "bag", small)
    named = opened(path, topics={"near": "/cam1/image_raw", "far": "cam0/image_raw"})
    assert [camera.name for camera in named.cameras] == ["near", "far"]
    ordered = opened(path, topics=["/cam1/image_raw", "/cam0/image_raw"])
    assert [camera.name for camera in ordered.cameras] == ["left", "right"]


def test_one_topic_twice_is_no_pair(tmp_path, small):
    path = formats.rosbag1(tmp_path / "bag", small)
    with pytest.raises(InputError, match="two or more different topics"):
        opened(path, topics=["/cam1/image_raw", "/cam1/image_raw"])


def test_one_camera_is_too_few(tmp_path, small):
    path = formats.rosbag1(tmp_path / "bag", {"left": small["left"]})
    with pytest.raises(InputError, match=r"one camera only: two or more topics .* there is /cam0/image_raw"):
        opened(path)


def test_no_pictures_at_all(tmp_path):
    path = tmp_path / "drive.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/imu", "json", 0)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    with pytest.raises(InputError, match="no topic with pictures"):
        opened(path)


def test_stamps_of_zero_give_way_to_the_log(tmp_path, small, caplog):
    path = write_foxglove(tmp_path / "drive.mcap", in_order(small), stamp_ns=lambda _: 0)
    frames = replayed(path)
    assert {one.stamp_origin for one in frames} == {StampOrigin.ARRIVAL}
    assert frames[0].captured_ns == EPOCH_NS + LATENCY_NS
    assert "own stamps are 0" in caplog.text
    with pytest.raises(InputError, match="own stamps are 0"):
        opened(path, stamps="header")


def test_the_log_s_time_can_be_asked_for(tmp_path, small):
    path = write_foxglove(tmp_path / "drive.mcap", in_order(small))
    assert replayed(path, stamps="log")[0].captured_ns == EPOCH_NS + LATENCY_NS
    by_header = replayed(path)[0]
    assert (by_header.captured_ns, by_header.arrived_ns) == (EPOCH_NS, EPOCH_NS + LATENCY_NS)


def test_counters_are_kept_where_there_are_any(tmp_path, small):
    with_counter = replayed(write_foxglove(tmp_path / "drive.mcap", in_order(small)))
    assert [one.sequence for one in with_counter[:4]] == [0, 1, 2, 3]
    ros2 = replayed(formats.rosbag2(tmp_path / "bag2", small))
    assert {one.sequence for one in ros2} == {None}
    ros1 = replayed(formats.rosbag1(tmp_path / "bag1", small))
    assert [one.sequence for one in ros1 if one.camera == "left"] == list(range(60))


def test_stamps_that_go_backwards_are_delivered_as_they_are(tmp_path, small):
    def back(one):
        return EPOCH_NS + one.captured_ns - (20 * PERIOD_NS if one.camera == "right" and one.sequence > 30 else 0)

    frames = replayed(write_foxglove(tmp_path / "drive.mcap", in_order(small), stamp_ns=back))
    right = [one.captured_ns for one in frames if one.camera == "right"]
    assert right[31] < right[30]
    assert len(frames) == 120


@pytest.mark.parametrize("by_s", [-3600, -2, 10**8])
@pytest.mark.parametrize("sides", [("left", "right"), ("right",)])
def test_cameras_stay_side_by_side_when_a_clock_is_set(tmp_path, small, by_s, sides):
    def set_clock(one):
        return EPOCH_NS + one.captured_ns + (by_s * NS_PER_S if one.camera in sides and one.sequence > 30 else 0)

    frames = replayed(write_foxglove(tmp_path / "drive.mcap", in_order(small), stamp_ns=set_clock))
    assert len(frames) == 120
    seen = dict.fromkeys(small, 0)
    for one in frames:
        seen[one.camera] += 1
        assert abs(seen["left"] - seen["right"]) <= 2


def test_mixed_sizes_end_it_with_the_message_named(tmp_path, small):
    small["right"][40] = frame("right", 40, size=(48, 32))
    path = write_foxglove(tmp_path / "drive.mcap", in_order(small))
    with pytest.raises(InputError, match=r"/right/image: message 40: 32x48 pixels, but .* 80x60"):
        replayed(path)


def test_a_message_that_cannot_be_decoded_is_named(tmp_path, small):
    path = tmp_path / "drive.mcap"
    with path.open("wb") as file, ProtobufWriter(file) as writer:
        for one in in_order(small):
            message = RawImage(width=80, height=60, encoding="weird8", step=80, data=one.image.tobytes())
            message.timestamp.seconds = 1 + one.sequence
            writer.write_message(f"/{one.camera}/image", message, one.sequence, one.sequence)
    with pytest.raises(InputError, match=r"drive.mcap: /left/image: message 0: encoding 'weird8' is not understood"):
        opened(path)


def test_a_part_starts_and_ends_where_it_is_asked_to(tmp_path, small):
    for path in (write_foxglove(tmp_path / "drive.mcap", in_order(small)), formats.rosbag1(tmp_path / "bag", small)):
        part = replayed(path, from_s=1.0, to_s=2.0)
        stamps = {one.captured_ns - EPOCH_NS for one in part}
        assert (min(stamps), max(stamps)) == (20 * PERIOD_NS, 39 * PERIOD_NS)
        assert len(part) == 40


def test_cameras_of_different_clocks_are_laid_side_by_side(tmp_path, small, caplog):
    def other_clock(one):
        return one.captured_ns + (EPOCH_NS if one.camera == "left" else 77 * NS_PER_S)

    frames = replayed(write_foxglove(tmp_path / "drive.mcap", in_order(small), stamp_ns=other_clock))
    assert [one.camera for one in frames[:4]] in (["left", "right"] * 2, ["right", "left"] * 2)
    assert "clocks differ" in caplog.text


def topics(*names):
    return [Topic(name, "sensor_msgs/msg/Image", "cdr", 10) for name in names]


GUESSED = {
    ("/cam0/image_raw", "/cam1/image_raw"): {"left": "/cam0/image_raw", "right": "/cam1/image_raw"},
    ("/right/image", "/left/image"): {"left": "/left/image", "right": "/right/image"},
    ("/cam0/image_raw/compressed", "/cam0/image_raw", "/cam1/image_raw", "/cam1/image_rect"): {
        "left": "/cam0/image_raw",
        "right": "/cam1/image_raw",
    },
    ("/camera/infra1/image_rect_raw", "/camera/infra2/image_rect_raw", "/camera/color/image", "/camera/depth/image"): {
        "left": "/camera/infra1/image_rect_raw",
        "right": "/camera/infra2/image_rect_raw",
    },
    ("/front/image", "/rear/image", "/top/image"): {
        "front": "/front/image",
        "rear": "/rear/image",
        "top": "/top/image",
    },
}  # fmt: skip


@pytest.mark.parametrize("found", GUESSED, ids=lambda found: found[0])
def test_cameras_are_guessed_from_names(tmp_path, found, caplog):
    chosen = choose(tmp_path, topics(*found), None, None, Notices())
    assert {name: topic.name for name, topic in chosen.topics.items()} == GUESSED[found]


def test_several_rigs_in_one_recording_are_pairs_of_their_own(tmp_path):
    names = [f"/{rig}/{side}/image_raw" for rig in ("front", "rear") for side in ("left", "right")]
    chosen = choose(tmp_path, topics(*names), None, None, Notices())
    assert chosen.pairs == (("front_left", "front_right"), ("rear_left", "rear_right"))


def test_empty_topics_are_no_cameras(tmp_path):
    found = [*topics("/cam0/image", "/cam1/image"), Topic("/cam2/image", "sensor_msgs/msg/Image", "cdr", 0)]
    assert len(choose(tmp_path, found, None, None, Notices()).topics) == 2
