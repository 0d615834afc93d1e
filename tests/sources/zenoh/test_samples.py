"""What comes over Zenoh is a picture with what was said of it, or one clear sentence."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pipeline.errors import InputError
from sources.zenoh.samples import read_sample
from tests.frames import texture
from tests.publishing import PICTURE, rmw_attachment, rmw_key, ros_compressed, ros_image, said

STAMP_NS = 1_790_000_000_123_456_789
JPEG = cv2.imencode(".jpg", texture(1))[1].tobytes()
PNG = cv2.imencode(".png", texture(1))[1].tobytes()
BRIDGED = "cam0/image_raw"


def test_an_image_of_rmw_zenoh_has_its_stamp_and_the_publishers_count():
    shown = read_sample(rmw_key("cam0/image_raw"), ros_image(STAMP_NS), rmw_attachment(12, gid=3))
    assert np.array_equal(shown.image, PICTURE)
    assert (shown.captured_ns, shown.clock, shown.sequence) == (STAMP_NS, "ros", 12)
    assert shown.publisher == b"\x03" * 16


def test_an_image_of_a_bridge_from_dds_has_its_stamp_and_no_count():
    shown = read_sample(BRIDGED, ros_image(STAMP_NS), None)
    assert np.array_equal(shown.image, PICTURE)
    assert (shown.captured_ns, shown.sequence, shown.publisher) == (STAMP_NS, None, None)


@pytest.mark.parametrize("key", [rmw_key("cam0/image_raw/compressed", "CompressedImage"), BRIDGED])
def test_a_compressed_image_is_told_by_its_key_or_its_bytes(key):
    shown = read_sample(key, ros_compressed(STAMP_NS, PNG), None)
    assert np.array_equal(shown.image, texture(1))
    assert (shown.captured_ns, shown.clock) == (STAMP_NS, "ros")


def test_a_message_without_a_stamp_has_none():
    assert read_sample(BRIDGED, ros_image(0), None).captured_ns is None


@pytest.mark.parametrize("payload", [JPEG, PNG])
def test_a_picture_file_needs_nothing_else(payload):
    shown = read_sample("any/key", payload, None)
    assert shown.image.shape == (48, 64)
    assert (shown.captured_ns, shown.sequence) == (None, None)


@pytest.mark.parametrize("payload", [JPEG, PNG])
def test_a_picture_file_may_have_an_attachment(payload):
    attachment = said(sequence=5, captured_ns=STAMP_NS, clock="cam0", exposure_ns=8000, epoch=2, mood="ignored")
    shown = read_sample("any/key", payload, attachment)
    assert (shown.sequence, shown.captured_ns, shown.clock) == (5, STAMP_NS, "cam0")
    assert (shown.exposure_ns, shown.epoch) == (8000, 2)


def test_raw_bytes_are_what_the_attachment_says():
    deep = texture(1).astype(np.uint16) * 257
    attachment = said(width=64, height=48, encoding="mono16", is_bigendian=True, captured_ns=1)
    assert np.array_equal(read_sample("k", deep.astype(">u2").tobytes(), attachment).image, deep)


@pytest.mark.parametrize(
    ("payload", "attachment", "text"),
    [
        (b"", None, "neither a ROS image nor JPEG nor PNG"),
        (b"hello", None, "neither a ROS image nor JPEG nor PNG, and no JSON attachment says what else"),
        (b"\x00\x01\x00\x00junk", None, "a message, but neither sensor_msgs/Image nor sensor_msgs/CompressedImage"),
        (ros_image(1)[:-5], None, "a damaged one"),
        (JPEG[:-10], None, "the picture is truncated"),
        (b"x", b"{not json", "attachment: Invalid JSON"),
        (b"x", said(sequence="twelve"), "attachment: sequence: Input should be a valid integer"),
        (b"x", said(captured_ns=1e400), "attachment: captured_ns: "),
        (b"x", said(encoding="mono8", width=-1), "attachment: width: Input should be greater"),
        (b"x", said(encoding="mono8", width=4, height=4), "1 bytes of data: 4x4 pixels of mono8 take 16"),
        (b"x", said(sequence=1), "attachment: encoding 'None' is not one of jpeg, png, 16UC1"),
        (b"x", said(encoding="jpeg"), "attachment: encoding 'jpeg' is not one of jpeg, png"),
        (ros_image(1, encoding="32FC1"), None, "encoding '32FC1' is not understood"),
        (ros_compressed(1, b"\x00\x00\x00\x01\x67", "h264"), None, "format 'h264' cannot be decoded"),
    ],
)
def test_what_is_no_picture_is_said(payload, attachment, text):
    with pytest.raises(InputError, match=text):
        read_sample("k", payload, attachment)


@given(
    base=st.sampled_from([ros_image(STAMP_NS), ros_compressed(STAMP_NS, PNG), JPEG, PNG]),
    cut=st.integers(0, 400),
    flips=st.lists(st.tuples(st.integers(0, 120), st.integers(0, 255)), max_size=6),
    attachment=st.one_of(st.none(), st.binary(max_size=40), st.just(said(encoding="mono8", width=4, height=4))),
)
@example(base=ros_image(STAMP_NS), cut=0, flips=[(16, 0xFF)], attachment=None)
def test_damage_of_any_kind_ends_in_a_picture_or_one_sentence(base, cut, flips, attachment):
    damaged = bytearray(base[: len(base) - cut])
    for place, value in flips:
        if place < len(damaged):
            damaged[place] = value
    try:
        shown = read_sample("k", bytes(damaged), attachment)
    except InputError:
        return
    assert shown.image.ndim in (2, 3)
