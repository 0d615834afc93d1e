"""Pictures of every depth and state of health, as a replay reads them."""

from __future__ import annotations

import logging
import struct
import zlib

import cv2
import numpy as np
import pytest

from pipeline.errors import InputError
from tests.sources.test_replay_kit import of, opened, picture, replayed, said, shown, write_folder, write_folders


def noise(seed: int = 0, shape: tuple[int, ...] = (32, 48), high: int = 256, dtype: type = np.uint8):
    return np.random.default_rng(seed).integers(0, high, shape, dtype)


def rig(root, left):
    """A recording whose left pictures are given, by name; the right ones are plain."""
    write_folder(root / "left", left)
    write_folder(root / "right", list(left))
    return root


def delivered_before_error(source) -> tuple[list[int], str]:
    """What the left pictures told until the replay failed, and how it failed."""
    numbers: list[int] = []
    lefts = (shown(frame) for frame in source.frames() if frame.camera == "left")
    with pytest.raises(InputError) as caught:
        numbers.extend(lefts)
    return numbers, str(caught.value)


def png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def test_grey_pictures_arrive_bit_for_bit_and_read_only(tmp_path):
    left = of(replayed(rig(tmp_path, {"0.png": noise(0), "1.png": noise(1)}), fps=10), "left")

    assert np.array_equal(left[1].image, noise(1))
    assert not left[1].image.flags.writeable


def test_colour_pictures_stay_colour_and_that_is_said_once(tmp_path, caplog):
    caplog.set_level(logging.INFO)
    colour = noise(2, (32, 48, 3))

    left = of(replayed(rig(tmp_path, {"0.png": colour, "1.png": colour}), fps=10), "left")

    assert np.array_equal(left[0].image, colour)
    assert said(caplog, logging.INFO) == ["left: colour pictures, judged as grey"]


def test_alpha_is_dropped(tmp_path):
    transparent = noise(3, (32, 48, 4))

    left = of(replayed(rig(tmp_path, {"0.png": transparent}), fps=10), "left")

    assert np.array_equal(left[0].image, transparent[:, :, :3])


@pytest.mark.parametrize(
    ("brightest", "bits"), [(255, 10), (1023, 10), (1024, 12), (4095, 12), (16383, 14), (16384, 16), (65535, 16)]
)
def test_16_bit_pictures_are_scaled_by_the_depth_of_the_first_one(tmp_path, caplog, brightest, bits):
    deep = noise(4, high=brightest + 1, dtype=np.uint16)
    deep[0, 0] = brightest

    left = of(replayed(rig(tmp_path, {"0.png": deep, "1.png": deep}), fps=10), "left")

    assert np.array_equal(left[1].image, (deep // 2 ** (bits - 8)).astype(np.uint8))
    assert said(caplog) == [f"left: 16-bit pictures, scaled to 8 bits from {bits}"]


def test_16_bit_pictures_brighter_than_the_first_are_scaled_anew_and_that_is_said(tmp_path):
    first = np.full((32, 48), 1000, np.uint16)
    bright = np.full((32, 48), 5000, np.uint16)

    left = of(replayed(rig(tmp_path, {"0.tif": first, "1.tif": bright}), fps=10), "left")

    assert [int(frame.image[0, 0]) for frame in left] == [250, 78]


def test_16_bit_colour_keeps_its_three_channels(tmp_path):
    deep = noise(5, (32, 48, 3), high=4096, dtype=np.uint16)

    left = of(replayed(rig(tmp_path, {"0.png": deep}), fps=10), "left")

    assert np.array_equal(left[0].image, (deep // 16).astype(np.uint8))


@pytest.mark.parametrize("dtype", [np.float32, np.int16])
def test_pictures_of_other_value_types_are_refused(tmp_path, dtype):
    rig(tmp_path, {"0.tif": noise(6).astype(dtype)})

    with pytest.raises(InputError, match=rf"left/0.tif: values of type {np.dtype(dtype)}: expected 8 or 16 bits"):
        opened(tmp_path, fps=10)


@pytest.mark.parametrize("suffix", ["png", "jpg", "bmp", "tif", "pgm", "webp"])
def test_a_truncated_picture_ends_the_replay_after_what_came_before(tmp_path, suffix):
    names = [f"{n}.{suffix}" for n in range(4)]
    rig(tmp_path, {name: np.hstack([picture(n, (24, 32))] * 2) for n, name in enumerate(names)})
    textured = cv2.imencode(f".{suffix}", cv2.GaussianBlur(noise(7), (0, 0), 2))[1].tobytes()
    (tmp_path / "left" / names[2]).write_bytes(textured[: len(textured) * 2 // 3])

    numbers, error = delivered_before_error(opened(tmp_path, fps=10))

    assert numbers == [0, 1]
    assert f"left/2.{suffix}: " in error


@pytest.mark.parametrize(
    ("suffix", "message"),
    [("png", "is truncated (a PNG without its IEND)"), ("jpg", "is truncated (a JPEG without its end marker)")],
)
def test_a_picture_that_lacks_only_its_last_bytes_is_truncated(tmp_path, capfd, suffix, message):
    rig(tmp_path, {f"0.{suffix}": picture(0), f"1.{suffix}": picture(1)})
    path = tmp_path / "left" / f"1.{suffix}"
    path.write_bytes(path.read_bytes()[:-2])

    numbers, error = delivered_before_error(opened(tmp_path, fps=10))

    assert numbers == [0]
    assert error == f"{path}: {message}: replace the picture or remove it (a missing one is a hole)"
    assert capfd.readouterr().err == ""


def test_a_jpeg_is_truncated_even_if_a_thumbnail_in_its_header_is_whole(tmp_path):
    rig(tmp_path, {"0.jpg": picture(0), "1.jpg": picture(1)})
    path = tmp_path / "left" / "1.jpg"
    data, thumbnail = path.read_bytes(), cv2.imencode(".jpg", picture(1, (16, 16)))[1].tobytes()
    header = b"\xff\xe1" + (len(thumbnail) + 2).to_bytes(2, "big") + thumbnail
    path.write_bytes(data[:2] + header + data[2:-2])

    assert "is truncated (a JPEG" in delivered_before_error(opened(tmp_path, fps=10))[1]


@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_bytes_after_the_end_of_a_picture_do_no_harm(tmp_path, suffix):
    rig(tmp_path, {f"0.{suffix}": picture(0), f"1.{suffix}": picture(1)})
    path = tmp_path / "left" / f"1.{suffix}"
    path.write_bytes(path.read_bytes() + b"\xff\xda trailing")

    assert [shown(frame) for frame in of(replayed(tmp_path, fps=10), "left")] == [0, 1]


def test_a_png_with_a_flipped_bit_is_damaged_and_libpng_stays_silent(tmp_path, capfd):
    rig(tmp_path, {"0.png": noise(8)})
    path = tmp_path / "left" / "0.png"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)

    with pytest.raises(InputError, match=r"left/0.png: is damaged \(wrong checksum in a PNG's IDAT\)"):
        opened(tmp_path, fps=10)
    assert capfd.readouterr().err == ""


def test_a_wrong_checksum_in_a_comment_of_a_png_does_no_harm(tmp_path):
    rig(tmp_path, {"0.png": picture(3)})
    path = tmp_path / "left" / "0.png"
    data, comment = path.read_bytes(), bytearray(png_chunk(b"tEXt", b"Comment\0by hand"))
    comment[-1] ^= 1
    path.write_bytes(data[:-12] + comment + data[-12:])

    assert [shown(frame) for frame in of(replayed(tmp_path, fps=10), "left")] == [3]


def test_an_empty_picture_file_is_refused(tmp_path):
    write_folders(tmp_path)
    (tmp_path / "right" / "000000.png").write_bytes(b"")

    with pytest.raises(InputError, match=r"right/000000.png: is empty \(0 bytes\)"):
        opened(tmp_path, fps=10)


def test_a_file_that_is_no_picture_is_refused_without_noise(tmp_path, capfd):
    write_folders(tmp_path)
    (tmp_path / "right" / "000000.png").write_bytes(b"hello")

    with pytest.raises(InputError, match=r"right/000000.png: cannot be decoded as a picture"):
        opened(tmp_path, fps=10)
    assert capfd.readouterr().err == ""


def test_a_picture_that_vanishes_meanwhile_is_named(tmp_path):
    write_folders(tmp_path)
    source = opened(tmp_path, fps=10)
    (tmp_path / "left" / "000002.png").unlink()

    numbers, error = delivered_before_error(source)

    assert numbers == [0, 1]
    assert error == f"{tmp_path}/left/000002.png: cannot be read: No such file or directory"


def test_a_size_that_changes_within_a_camera_ends_the_replay(tmp_path):
    rig(tmp_path, {"0.png": picture(0), "1.png": picture(1), "2.png": picture(2, (64, 40))})

    numbers, error = delivered_before_error(opened(tmp_path, fps=10))

    assert numbers == [0, 1]
    assert error == (
        f"{tmp_path}/left/2.png: 64x40 pixels, but the pictures of left before it have 48x32: "
        "one camera keeps one size; split the recording there"
    )


def test_a_picture_is_not_turned_by_its_exif_orientation(tmp_path):
    rig(tmp_path, {"0.jpg": picture(0)})
    path = tmp_path / "left" / "0.jpg"
    data = path.read_bytes()
    turned = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0"
    path.write_bytes(data[:2] + b"\xff\xe1" + (len(turned) + 2).to_bytes(2, "big") + turned + data[2:])
    assert cv2.imread(str(path)).shape == (48, 32, 3), "the tag is heeded where it is not switched off"

    assert replayed(tmp_path, fps=10)[0].image.shape == (32, 48)


def test_reading_leaves_opencvs_log_level_as_it_was(tmp_path):
    before = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    try:
        replayed(write_folders(tmp_path), fps=10)

        assert cv2.utils.logging.getLogLevel() == cv2.utils.logging.LOG_LEVEL_ERROR
    finally:
        cv2.utils.logging.setLogLevel(before)
