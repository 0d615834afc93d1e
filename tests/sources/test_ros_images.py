"""Bytes of ROS images become pictures, whatever their encoding, padding and byte order."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import InputError
from sources.ros_images import ENCODINGS, decode, decode_compressed

HEIGHT, WIDTH = 24, 32
BLUE, GREEN, RED = 40, 120, 200
COLOUR = np.full((HEIGHT, WIDTH, 3), (BLUE, GREEN, RED), np.uint8)
GREY = cv2.cvtColor(COLOUR, cv2.COLOR_BGR2GRAY)
RAMP = np.arange(HEIGHT * WIDTH, dtype=np.uint8).reshape(HEIGHT, WIDTH)
FIRST_ROWS = {"rggb": "RG/GB", "bggr": "BG/GR", "gbrg": "GB/RG", "grbg": "GR/BG"}


def mosaic(pattern: str) -> np.ndarray:
    value = {"R": RED, "G": GREEN, "B": BLUE}
    tile = np.array([[value[colour] for colour in row] for row in FIRST_ROWS[pattern].split("/")], np.uint8)
    return np.tile(tile, (HEIGHT // 2, WIDTH // 2))


def picture(encoding, data, **changes):
    given = {"height": HEIGHT, "width": WIDTH, "step": 0, "is_bigendian": False, **changes}
    return decode(encoding, data=data, **given)


@pytest.mark.parametrize(
    ("encoding", "order"),
    [("bgr8", [0, 1, 2]), ("rgb8", [2, 1, 0]), ("bgra8", [0, 1, 2, 0]), ("rgba8", [2, 1, 0, 0]), ("8UC3", [0, 1, 2])],
)
def test_colours_become_blue_green_red(encoding, order):
    sent = np.ascontiguousarray(COLOUR[:, :, order])
    assert np.array_equal(picture(encoding, sent.tobytes()), COLOUR)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("pattern", FIRST_ROWS)
def test_a_mosaic_becomes_the_brightness_of_its_colours(pattern, bits):
    sent = mosaic(pattern).astype(f"u{bits // 8}") * (1 if bits == 8 else 256)
    made = picture(f"bayer_{pattern}{bits}", sent.tobytes())
    assert made.dtype == sent.dtype
    inner = made[2:-2, 2:-2] / (1 if bits == 8 else 256)
    assert np.abs(inner - GREY[0, 0]).max() < 2


@pytest.mark.parametrize("encoding", ["yuv422", "uyvy"])
def test_brightness_comes_second_in_uyvy(encoding):
    assert np.array_equal(picture(encoding, np.dstack([RAMP * 0 + 128, RAMP]).tobytes()), RAMP)


@pytest.mark.parametrize("encoding", ["yuv422_yuy2", "yuyv"])
def test_brightness_comes_first_in_yuyv(encoding):
    assert np.array_equal(picture(encoding, np.dstack([RAMP, RAMP * 0 + 128]).tobytes()), RAMP)


@pytest.mark.parametrize("encoding", ["nv12", "nv21", "nv24"])
def test_colours_after_the_rows_of_brightness_are_left_out(encoding):
    assert np.array_equal(picture(encoding, RAMP.tobytes() + bytes(HEIGHT * WIDTH // 2)), RAMP)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("encoding", ["mono16", "16UC1"])
def test_sixteen_bits_keep_their_values_in_either_byte_order(encoding, order):
    deep = RAMP.astype(np.uint16) * 257
    made = picture(encoding, deep.astype(f"{order}u2").tobytes(), is_bigendian=order == ">")
    assert made.dtype == np.uint16
    assert np.array_equal(made, deep)


@pytest.mark.parametrize("whole_last_row", [True, False])
def test_padding_at_the_end_of_rows_is_left_out(whole_last_row):
    padded = np.hstack([RAMP, np.full((HEIGHT, 7), 255, np.uint8)]).tobytes()
    sent = padded if whole_last_row else padded[:-7]
    assert np.array_equal(picture("mono8", sent, step=WIDTH + 7), RAMP)


def test_rows_may_begin_at_odd_bytes():
    deep = RAMP.astype(np.uint16) * 3
    rows = np.hstack([deep.view(np.uint8), np.zeros((HEIGHT, 1), np.uint8)])
    assert np.array_equal(picture("mono16", rows.tobytes(), step=2 * WIDTH + 1), deep)


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview, lambda data: np.frombuffer(data, np.uint8)])
def test_data_may_be_of_any_kind_with_a_buffer(kind):
    assert np.array_equal(picture("mono8", kind(RAMP.tobytes())), RAMP)


@pytest.mark.parametrize(
    ("encoding", "changes", "text"),
    [
        ("32FC1", {}, r"encoding '32FC1' is not understood: allowed are 16UC1, .*bayer_bggr8.* yuyv"),
        ("mono8", {"height": 0}, "32x0 pixels of mono8: a picture has at least 1x1"),
        ("bayer_rggb8", {"width": 1}, "1x24 pixels of bayer_rggb8: a picture has at least 2x2"),
        ("bgr8", {"step": 95}, "step 95: 32 pixels of bgr8 take 96 bytes a row"),
        ("mono16", {}, "768 bytes of data: 32x24 pixels of mono16 take 1536"),
        ("mono8", {"height": 2**31}, "768 bytes of data: 32x2147483648 pixels"),
    ],
)
def test_what_cannot_be_a_picture_is_said(encoding, changes, text):
    with pytest.raises(InputError, match=text):
        picture(encoding, RAMP.tobytes(), **changes)


@given(
    encoding=st.sampled_from(ENCODINGS),
    height=st.integers(0, 9),
    width=st.integers(0, 9),
    step=st.integers(0, 80),
    size=st.integers(0, 700),
    big=st.booleans(),
)
def test_any_message_is_a_picture_of_its_size_or_one_clear_error(encoding, height, width, step, size, big):
    try:
        made = decode(encoding, height, width, step, bytes(size), big)
    except InputError:
        return
    assert made.shape[:2] == (height, width)
    assert made.dtype in (np.uint8, np.uint16)
    assert made.ndim == 2 or made.shape[2] == 3


@pytest.mark.parametrize(
    ("form", "suffix"), [("jpeg", ".jpg"), ("rgb8; jpeg compressed bgr8", ".jpg"), ("mono8; png compressed ", ".png")]
)
def test_compressed_pictures_are_decoded_by_what_they_are(form, suffix):
    data = cv2.imencode(suffix, COLOUR)[1]
    made = decode_compressed(form, data)
    assert made.shape == COLOUR.shape
    assert np.abs(made.astype(int) - COLOUR).max() < 4


def test_sixteen_bits_survive_png_and_transparency_is_left_out():
    deep = RAMP.astype(np.uint16) * 257
    assert np.array_equal(decode_compressed("png", cv2.imencode(".png", deep)[1].tobytes()), deep)
    clear = np.dstack([COLOUR, RAMP])
    assert np.array_equal(decode_compressed("png", cv2.imencode(".png", clear)[1].tobytes()), COLOUR)


@pytest.mark.parametrize(
    ("form", "data", "text"),
    [
        ("h264", b"\x00\x00\x00\x01\x67abc", "format 'h264' cannot be decoded: allowed are jpeg and png"),
        ("jpeg", b"", "the picture is empty"),
        ("jpeg", cv2.imencode(".jpg", COLOUR)[1].tobytes()[:-20], "the picture is truncated"),
        ("png", cv2.imencode(".png", COLOUR)[1].tobytes()[:-20], "the picture is truncated"),
    ],
)
def test_what_cannot_be_decoded_is_said(form, data, text):
    with pytest.raises(InputError, match=text):
        decode_compressed(form, data)
