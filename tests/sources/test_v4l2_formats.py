"""The grey picture of every pixel format that is read, and the kernel's interface to the byte."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from sources.v4l2 import abi
from sources.v4l2.device import TroubleError
from sources.v4l2.formats import BY_CODE, FORMATS, Layout
from tests.frames import texture

WIDTH, HEIGHT = 64, 48
PICTURE = texture(1, WIDTH, HEIGHT)
PADDING = 6


def padded(rows: np.ndarray) -> tuple[np.ndarray, Layout]:
    """Rows of bytes as a driver lays them out, with something else between and behind them."""
    junk = np.full((HEIGHT, PADDING), 77, np.uint8)
    data = np.concatenate([np.hstack([rows, junk]).ravel(), np.full(100, 66, np.uint8)])
    return data, Layout(WIDTH, HEIGHT, rows.shape[1] + PADDING)


def packed(first: int) -> np.ndarray:
    rows = np.full((HEIGHT, 2 * WIDTH), 99, np.uint8)
    rows[:, first::2] = PICTURE
    return rows


def deep(bits: int) -> np.ndarray:
    return ((PICTURE.astype("<u2") << (bits - 8)) | 1).view(np.uint8)


def colour(order) -> np.ndarray:
    return np.repeat(PICTURE[:, :, None], 3, axis=2)[:, :, order].reshape(HEIGHT, 3 * WIDTH)


LAYOUTS = {
    **dict.fromkeys(("GREY", "NV12", "NV21", "YU12", "YV12"), PICTURE),
    "YUYV": packed(0),
    "UYVY": packed(1),
    **{f"Y{bits}": deep(bits) for bits in (10, 12, 16)},
    "BGR3": colour([0, 1, 2]),
    "RGB3": colour([2, 1, 0]),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_grey_is_taken_out_exactly_and_belongs_to_the_frame_alone(name):
    data, layout = padded(LAYOUTS[name])
    picture = FORMATS[name].decode(data, layout)
    data[:] = 0  # the driver writes the next picture into the buffer
    assert picture.dtype == np.uint8
    assert np.array_equal(picture, PICTURE)


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
@pytest.mark.parametrize("order", ["RGGB", "GRBG", "GBRG", "BGGR"])
def test_the_grey_of_a_mosaic_weighs_its_colours_at_their_places(order, bits):
    levels = {"R": 200, "G": 100, "B": 40}
    mosaic = np.zeros((HEIGHT, WIDTH), np.uint8)
    for place, letter in enumerate(order):
        mosaic[place // 2 :: 2, place % 2 :: 2] = levels[letter]
    rows = mosaic if bits == 8 else (mosaic.astype("<u2") << (bits - 8)).view(np.uint8)
    data, layout = padded(rows)
    picture = FORMATS[f"S{order}{bits}"].decode(data, layout)
    expected = 0.299 * 200 + 0.587 * 100 + 0.114 * 40
    assert picture.shape == PICTURE.shape
    assert np.abs(picture[4:-4, 4:-4] - expected).max() <= 2


def test_a_jpeg_is_decoded_and_padding_behind_it_does_not_matter():
    coded = cv2.imencode(".jpg", PICTURE, [cv2.IMWRITE_JPEG_QUALITY, 98])[1].ravel()
    picture = FORMATS["MJPEG"].decode(np.concatenate([coded, np.zeros(500, np.uint8)]), Layout(WIDTH, HEIGHT, 0))
    assert np.abs(picture.astype(int) - PICTURE).mean() < 1


def jpeg(width: int, height: int) -> np.ndarray:
    return cv2.imencode(".jpg", texture(1, width, height))[1].ravel()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (jpeg(WIDTH, HEIGHT)[:-30], "is cut off"),
        (np.zeros(300, np.uint8), "is cut off"),
        (np.frombuffer(b"\xff\xd8nothing\xff\xd9", np.uint8), "cannot be decoded"),
        (jpeg(32, 32), "is 32x32 and not 64x48"),
    ],
)
def test_a_damaged_jpeg_is_no_picture(data, words):
    with pytest.raises(TroubleError, match=words):
        FORMATS["MJPEG"].decode(data, Layout(WIDTH, HEIGHT, 0))


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_short_buffer_is_no_picture(name):
    data, layout = padded(LAYOUTS[name])
    with pytest.raises(TroubleError, match="1 bytes short"):
        FORMATS[name].decode(data[: layout.stride * HEIGHT - PADDING - 1], layout)


def test_every_format_is_found_by_the_kernels_code_for_it():
    assert len(BY_CODE) == len(FORMATS)
    assert BY_CODE[0x56595559].name == "YUYV"
    assert BY_CODE[0x47504A4D].name == "MJPEG"
    assert abi.fourcc_text(0x56595559) == "YUYV"
    assert abi.fourcc_text(0x20363159 | 1 << 31) == "Y16-BE"


def test_requests_are_those_of_the_kernel_on_64_bit_machines():
    assert {
        "QUERYCAP": abi.QUERYCAP,
        "ENUM_FMT": abi.ENUM_FMT,
        "G_FMT": abi.G_FMT,
        "S_FMT": abi.S_FMT,
        "REQBUFS": abi.REQBUFS,
        "QUERYBUF": abi.QUERYBUF,
        "QBUF": abi.QBUF,
        "DQBUF": abi.DQBUF,
        "STREAMON": abi.STREAMON,
        "STREAMOFF": abi.STREAMOFF,
        "G_PARM": abi.G_PARM,
        "S_PARM": abi.S_PARM,
        "G_CTRL": abi.G_CTRL,
        "S_CTRL": abi.S_CTRL,
        "QUERYCTRL": abi.QUERYCTRL,
        "QUERYMENU": abi.QUERYMENU,
        "ENUM_FRAMESIZES": abi.ENUM_FRAMESIZES,
        "ENUM_FRAMEINTERVALS": abi.ENUM_FRAMEINTERVALS,
    } == {
        "QUERYCAP": 0x80685600,
        "ENUM_FMT": 0xC0405602,
        "G_FMT": 0xC0D05604,
        "S_FMT": 0xC0D05605,
        "REQBUFS": 0xC0145608,
        "QUERYBUF": 0xC0585609,
        "QBUF": 0xC058560F,
        "DQBUF": 0xC0585611,
        "STREAMON": 0x40045612,
        "STREAMOFF": 0x40045613,
        "G_PARM": 0xC0CC5615,
        "S_PARM": 0xC0CC5616,
        "G_CTRL": 0xC008561B,
        "S_CTRL": 0xC008561C,
        "QUERYCTRL": 0xC0445624,
        "QUERYMENU": 0xC02C5625,
        "ENUM_FRAMESIZES": 0xC02C564A,
        "ENUM_FRAMEINTERVALS": 0xC034564B,
    }
