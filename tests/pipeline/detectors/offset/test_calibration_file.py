"""Calibration files as OpenCV, Kalibr and KITTI write them, and as people break them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.detectors.offset.calibration_file import read_calibration
from pipeline.errors import InputError

K1 = np.array([[458.654, 0, 367.215], [0, 457.296, 248.375], [0, 0, 1]])
K2 = np.array([[457.587, 0, 379.999], [0, 456.134, 255.238], [0, 0, 1]])
D1 = np.array([[-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0.0]])
D2 = np.array([[-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05, 0.0]])
R = cv2.Rodrigues(np.array([0.01, -0.02, 0.03]))[0]
T = np.array([[-0.11], [0.001], [-0.002]])
STEREO = {"K1": K1, "D1": D1, "K2": K2, "D2": D2, "R": R, "T": T}

CAMCHAIN = """\
cam0:
  cam_overlaps: [1, 2]
  camera_model: pinhole
  distortion_coeffs: [-0.2834, 0.0739, 0.00019, 1e-05]
  distortion_model: radtan
  intrinsics: [458.654, 457.296, 367.215, 248.375]
  resolution: [752, 480]
  rostopic: /left/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.1]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0, 2]
  camera_model: pinhole
  distortion_coeffs: [-0.01, 0.02, -0.003, 0.0004]
  distortion_model: equidistant
  intrinsics: [457.587, 456.134, 379.999, 255.238]
  resolution: [752, 480]
  rostopic: /top/image_raw
cam2:
  T_cn_cnm1:
  - [0.0, -1.0, 0.0, 0.0]
  - [1.0, 0.0, 0.0, 0.2]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [400.0, 400.0, 379.999, 255.238]
  resolution: [752, 480]
  rostopic: /right/image_raw
"""

KITTI = """\
P0: 7.18856e+02 0.0 6.071928e+02 0.0 0.0 7.18856e+02 1.852157e+02 0.0 0.0 0.0 1.0 0.0
P1: 7.18856e+02 0.0 6.071928e+02 -3.861448e+02 0.0 7.18856e+02 1.852157e+02 0.0 0.0 0.0 1.0 0.0
P2: 7.18856e+02 0.0 6.071928e+02 4.538225e+01 0.0 7.18856e+02 1.852157e+02 -1.130887e-01 0.0 0.0 1.0 3.779761e-03
P3: 7.18856e+02 0.0 6.071928e+02 -3.372877e+02 0.0 7.18856e+02 1.852157e+02 2.369057 0.0 0.0 1.0 4.915215e-03
Tr: 4.2e-04 -9.9e-01 -8.0e-03 -1.1e-02 -7.2e-03 8.0e-03 -9.9e-01 -5.4e-02 9.9e-01 4.8e-04 -7.2e-03 -2.9e-01
"""


def opencv(path, matrices):
    """As cv2.FileStorage writes it: YAML, XML or JSON by the name's ending."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for key, value in matrices.items():
        storage.write(key, value)
    storage.release()
    return path


def text(path, content):
    path.write_text(content)
    return path


def check_stereo(found, size=None):
    np.testing.assert_allclose(found.first.matrix, K1)
    np.testing.assert_allclose(found.second.matrix, K2)
    np.testing.assert_allclose(found.first.coefficients, D1[0])
    np.testing.assert_allclose(found.second.coefficients, D2[0])
    np.testing.assert_allclose(found.rotation, R, atol=1e-12)
    np.testing.assert_allclose(found.translation, T[:, 0])
    assert found.first.model == found.second.model == "radtan"
    assert found.first.size == found.second.size == size
    assert not found.rectified


# --- OpenCV ---


@pytest.mark.parametrize("ending", ["yml", "yaml", "xml", "json", "txt"])
def test_opencv_writes_and_we_read(tmp_path, ending):
    """Told from what it holds: the file may have any name."""
    path = tmp_path / f"stereo.{ending}"
    opencv(tmp_path / "stereo.yml", STEREO).rename(path) if ending == "txt" else opencv(path, STEREO)
    check_stereo(read_calibration(path, "left", "right"))


@pytest.mark.parametrize(
    "keys",
    [
        ("M1", "D1", "M2", "D2", "R", "T"),
        ("cameraMatrix1", "distCoeffs1", "cameraMatrix2", "distCoeffs2", "R", "T"),
        ("camera_matrix_left", "dist_coeffs_left", "camera_matrix_right", "dist_coeffs_right", "R", "T"),
        ("left_K", "left_D", "right_K", "right_D", "rotation_matrix", "translation_vector"),
        ("K_l", "D_l", "K_r", "D_r", "stereo_R", "stereo_T"),
        ("K0", "D0", "K1", "D1", "R", "T"),
        ("mtx1", "dist1", "mtx2", "dist2", "R", "T"),
        ("cameraMatrixL", "distCoeffsL", "cameraMatrixR", "distCoeffsR", "Rotation", "Translation"),
        ("cam0_K", "cam0_distortion_coefficients", "cam1_K", "cam1_distortion_coefficients", "R", "T"),
    ],
)
def test_common_spellings_of_keys(tmp_path, keys):
    named = dict(zip(keys, STEREO.values(), strict=True))
    # What stereoRectify adds must not be taken for something else.
    named |= {"R1": np.eye(3), "R2": np.eye(3), "P1": np.eye(3, 4), "P2": np.eye(3, 4), "Q": np.eye(4), "E": R, "F": R}
    check_stereo(read_calibration(opencv(tmp_path / "a.xml", named), "left", "right"))


@pytest.mark.parametrize(
    "lines",
    [
        "image_width: 752\nimage_height: 480\n",
        "image_size: [752, 480]\n",
        "imageSize: [752, 480]\n",
        "width: 752\nheight: 480\n",
        "resolution: {rows: 1, cols: 2, data: [752, 480]}\n",
    ],
)
def test_common_spellings_of_the_size(tmp_path, lines):
    path = opencv(tmp_path / "a.yml", STEREO)
    path.write_text(path.read_text() + lines)
    check_stereo(read_calibration(path, "left", "right"), (752, 480))


def test_matrices_may_be_written_by_hand_and_in_groups(tmp_path):
    group = "{}: {{camera_matrix: {}, distortion_coefficients: {{rows: 1, cols: 5, data: {}}}, image_size: [752, 480]}}"
    content = "\n".join(
        [
            group.format("left", K1.tolist(), D1[0].tolist()),
            group.format("right", K2.tolist(), D2[0].tolist()),
            f"R: {R.tolist()}",
            f"T: {T[:, 0].tolist()}",
        ]
    )
    check_stereo(read_calibration(text(tmp_path / "a.yaml", content), "left", "right"), (752, 480))


def test_a_rotation_vector_will_do(tmp_path):
    vector = {**STEREO, "R": cv2.Rodrigues(R)[0]}
    check_stereo(read_calibration(opencv(tmp_path / "a.yml", vector), "left", "right"))


def test_a_fisheye_model_must_be_named(tmp_path):
    path = opencv(tmp_path / "a.yml", {**STEREO, "D1": D1[:, :4], "D2": D2[:, :4]})
    assert read_calibration(path, "left", "right").first.model == "radtan"
    path.write_text(path.read_text() + "camera_model: pinhole\ndistortion_model: fisheye\n")
    assert read_calibration(path, "left", "right").second.model == "equidistant"


def test_projections_alone_are_of_rectified_pictures(tmp_path):
    p1, p2 = np.column_stack([K1, np.zeros(3)]), np.column_stack([K1, [-45.8654, 0, 0]])
    found = read_calibration(opencv(tmp_path / "a.yml", {"P1": p1, "P2": p2}), "left", "right", size=(752, 480))
    assert found.rectified
    np.testing.assert_allclose(found.translation, [-0.1, 0, 0])
    assert found.first.model == "none"


def test_the_pair_the_other_way_round_is_inverted(tmp_path):
    found = read_calibration(opencv(tmp_path / "a.yml", STEREO), "b", "a", ["a", "b"])
    np.testing.assert_allclose(found.first.matrix, K2)
    np.testing.assert_allclose(found.rotation, R.T, atol=1e-12)
    np.testing.assert_allclose(found.translation, (-R.T @ T)[:, 0])


# --- Kalibr ---


def test_a_camchain_is_chained_over_the_cameras_between(tmp_path):
    path = text(tmp_path / "camchain.yaml", CAMCHAIN)
    found = read_calibration(path, "a", "c", ["a", "b", "c"])
    point = np.array([1.0, 2.0, 5.0])
    in_cam1 = point - np.array([0.1, 0, 0])
    in_cam2 = np.array([-in_cam1[1], in_cam1[0] + 0.2, in_cam1[2]])
    np.testing.assert_allclose(found.rotation @ point + found.translation, in_cam2)
    back = read_calibration(path, "c", "a", ["a", "b", "c"])
    np.testing.assert_allclose(back.rotation @ in_cam2 + back.translation, point)
    assert found.first.size == (752, 480)
    np.testing.assert_allclose(found.first.coefficients, [-0.2834, 0.0739, 0.00019, 1e-05])
    assert read_calibration(path, "b", "c", ["a", "b", "c"]).first.model == "equidistant"
    assert found.second.model == "none"


@pytest.mark.parametrize(
    ("cameras", "focal_of_second"),
    [
        (["left", "right"], 400.0),  # by topic: cam0 and cam2
        (["cam0", "cam2"], 400.0),  # by key
        (["a", "b"], 457.587),  # neither: by order
        (["left", "other"], 457.587),  # one name alone decides nothing
        (["cam1", "cam9"], 457.587),
    ],
)
def test_cameras_are_found_by_name_or_by_order(tmp_path, cameras, focal_of_second):
    found = read_calibration(text(tmp_path / "a.yaml", CAMCHAIN), *cameras, cameras)
    assert found.second.matrix[0, 0] == focal_of_second


# --- KITTI ---


@pytest.mark.parametrize(
    ("cameras", "baseline", "down"),
    [
        (["left", "right"], 0.5372, 0.0),
        (["image_2", "image_3"], 0.5333, 0.0032),
        (["image_02", "image_03"], 0.5333, 0.0032),
    ],
)
def test_kitti_odometry(tmp_path, cameras, baseline, down):
    found = read_calibration(text(tmp_path / "calib.txt", KITTI), *cameras, cameras, size=(1241, 376))
    assert found.rectified
    assert found.first.size == (1241, 376)
    assert found.first.matrix[0, 2] == 607.1928
    assert -found.translation[0] == pytest.approx(baseline, abs=1e-4)
    assert found.translation[1] == pytest.approx(down, abs=3e-4)


def test_kitti_raw_with_its_sizes(tmp_path):
    lines = ["calib_time: 09-Jan-2012 13:57:47", "K_00: 9.8e+02 0 6.9e+02 0 9.7e+02 2.4e+02 0 0 1"]
    for number, shift in ((0, "0.0"), (1, "-3.861448e+02")):
        row = KITTI.splitlines()[0].split(": ")[1].split()
        row[3] = shift
        lines += [f"S_rect_0{number}: 1.242e+03 3.75e+02", f"P_rect_0{number}: {' '.join(row)}"]
    found = read_calibration(text(tmp_path / "calib_cam_to_cam.txt", "\n".join(lines)), "left", "right")
    assert found.second.size == (1242, 375)
    assert -found.translation[0] == pytest.approx(0.5372, abs=1e-4)


def test_kitti_rows_without_their_names(tmp_path):
    bare = "\n".join(line.split(": ")[1] for line in KITTI.splitlines()[:2])
    found = read_calibration(text(tmp_path / "calib.txt", bare), "left", "right")
    assert -found.translation[0] == pytest.approx(0.5372, abs=1e-4)


def test_the_last_pair_may_stand_alone(tmp_path):
    path = text(tmp_path / "calib.txt", "\n".join(KITTI.splitlines()[2:4]))
    assert -read_calibration(path, "left", "right").translation[0] == pytest.approx(0.5333, abs=1e-4)


# --- what people break ---

BREAKS = [
    (CAMCHAIN, "[458.654, 457.296,", "[-458.654, 457.296,", r":6: cam0\.intrinsics: focal lengths -458\.654 "),
    (CAMCHAIN, "[458.654, 457.296,", "[458.654,", r":6: cam0\.intrinsics: 3 numbers, 4 are needed: fx, fy, cx, cy"),
    (CAMCHAIN, "458.654", "nan", r":6: cam0\.intrinsics: 'nan' is not a finite number"),
    (CAMCHAIN, "458.654", ".inf", r":6: cam0\.intrinsics: inf is not a finite number"),
    (CAMCHAIN, "458.654", "wide", r":6: cam0\.intrinsics: 'wide' is not a number"),
    (CAMCHAIN, "  intrinsics: [457.587, 456.134, 379.999, 255.238]\n", "", r":9: cam1: 'intrinsics' is missing"),
    (CAMCHAIN, "distortion_model: radtan", "distortion_model: fov", r":5: cam0\.distortion_model: 'fov'.*allowed"),
    (CAMCHAIN, "camera_model: pinhole", "camera_model: omni", r":3: cam0\.camera_model: 'omni'.*allowed is pinhole"),
    (CAMCHAIN, "[-0.2834, 0.0739,", "[-0.2834,", r":4: cam0\.distortion_coeffs: 3 numbers, 4 or 5 or 8"),
    (CAMCHAIN, "[1.0, 0.0, 0.0, -0.1]", "[1.1, 0.0, 0.0, -0.1]", r":10: cam1\.T_cn_cnm1: no rotation: .* 0\.21 off"),
    (CAMCHAIN, "[1.0, 0.0, 0.0, -0.1]", "[-1.0, 0.0, 0.0, -0.1]", r":10: .*determinant is -1\.000 \(must be 1\)"),
    (CAMCHAIN, "[1.0, 0.0, 0.0, -0.1]", "[1.0, 0.0, 0.0, 0.0]", r"left and right stand in the same place"),
    (CAMCHAIN, "[0.0, 0.0, 0.0, 1.0]", "[0.0, 0.0, 0.0, 2.0]", r":10: cam1\.T_cn_cnm1: the last row is"),
    (CAMCHAIN, "cam1:", "cam7:", r"cameras cam0, cam2, cam7: a camchain has"),
    (CAMCHAIN, "cam1:", "cam0:", r":9:1: error: cam0: given twice, first in line 1"),
    (CAMCHAIN, "resolution: [752, 480]", "resolution: [752, -1]", r":7: cam0\.resolution: .* is no size"),
    (CAMCHAIN, "resolution: [752, 480]", "resolution: [752, 480", r"not valid YAML.*is not closed"),
    (CAMCHAIN, CAMCHAIN, "cam0: 5\ncam1: 6\n", r":1: cam0: a mapping with intrinsics"),
    (KITTI, "P1: 7.18856e+02", "P1: seven", r":2: P1: 'seven' is not a number"),
    (KITTI, "-3.861448e+02", "", r":2: P1: 11 numbers, 12 are needed: a projection matrix of 3 x 4"),
    (KITTI, "-3.861448e+02", "0", r"left and right stand in the same place"),
    (KITTI, "P0: 7.18856e+02", "P0: 0", r":1: P0: focal lengths 0 and 718\.856 px"),
    (KITTI, "P1", "P0", r":2: P0: given twice"),
    (KITTI, "\n".join(KITTI.splitlines()[1:]), "", r"one camera only \(P0\)"),
    (KITTI, KITTI, "", r"no calibration of two cameras that is understood \(it is empty\): understood are .*KITTI"),
    (KITTI, KITTI, "fx: 220.4\nbf: -10\n", r"its keys are fx, bf\): understood are"),
    (KITTI, KITTI, "- 1\n- 2\n", r"the top level must be a mapping"),
    (KITTI, KITTI, "<calibration/>", r"XML that begins with <calibration>"),
    (KITTI, KITTI, "<opencv_storage><K1>", r"not valid XML"),
    (KITTI, KITTI, '<!DOCTYPE a [<!ENTITY b "c">]><opencv_storage/>', r"document type"),
    (KITTI, KITTI, "a: " + "[" * 500, r"nested more than"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "old", "new", "says"), BREAKS)
def test_one_clear_line_for_what_is_broken(tmp_path, content, old, new, says):
    assert old in content
    path = text(tmp_path / "broken", content.replace(old, new, 1))
    with pytest.raises(InputError, match=says) as error:
        read_calibration(path, "left", "right", ["left", "right"] if "top" not in content else ["left", "right", "x"])
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"K1": np.eye(2)}, r":\d+: K1: 4 numbers, 9 are needed: a camera matrix of 3 x 3"),
        ({"K1": K1.T}, r":\d+: K1: .* is no camera matrix"),
        ({"K1": K1 * np.nan}, r":\d+: K1: '?\.?[nN]a[nN]'? is not a"),
        ({"D2": np.zeros((1, 7))}, r":\d+: D2: 7 numbers, 4 or 5 or 8"),
        ({"D2": None}, r":\d+: K2: this camera has no distortion coefficients, the other has"),
        ({"R": None}, r"no rotation R and translation T .* put both into one"),
        ({"T": None}, r"no rotation R and translation T"),
        ({"R": 2 * R}, r":\d+: R: no rotation"),
        ({"R": np.zeros((3, 3))}, r":\d+: R: no rotation"),
        ({"T": 0 * T}, r"stand in the same place"),
        ({"T": T[:2]}, r":\d+: T: 2 numbers, 3 are needed"),
        ({"K2": None, "D2": None}, r"no calibration of two cameras"),
        ({"distortion_model": "kb8"}, r":\d+: distortion_model: 'kb8' is not supported: allowed are"),
        ({"image_width": 0.5, "image_height": 480.0}, r":\d+: image_width: \[0\.5, 480\.0\] is no size"),
    ],
)
def test_one_clear_line_for_a_stereo_calibration_that_cannot_be(tmp_path, changed, says):
    kept = {key: value for key, value in {**STEREO, **changed}.items() if value is not None}
    with pytest.raises(InputError, match=says) as error:
        read_calibration(opencv(tmp_path / "a.yml", kept), "left", "right")
    assert "\n" not in str(error.value)


def test_rows_and_columns_must_agree_with_the_numbers(tmp_path):
    path = opencv(tmp_path / "a.yml", STEREO)
    path.write_text(path.read_text().replace("cols: 3", "cols: 4", 1))
    with pytest.raises(InputError, match=r":\d+: K1: 3 rows and 4 columns, but 9 numbers"):
        read_calibration(path, "left", "right")


def test_pictures_of_another_shape_are_refused_at_once(tmp_path):
    with pytest.raises(InputError, match=r"752 x 480.*640 x 480.*aspect"):
        read_calibration(text(tmp_path / "a.yaml", CAMCHAIN), "left", "right", size=(640, 480))


def test_a_third_camera_needs_its_own_calibration(tmp_path):
    path = opencv(tmp_path / "a.yml", STEREO)
    with pytest.raises(InputError, match=r"no calibration of camera c: the file has 2 cameras \(1, 2\)"):
        read_calibration(path, "a", "c", ["a", "b", "c"])


def test_what_cannot_be_read(tmp_path):
    binary = tmp_path / "a.png"
    binary.write_bytes(b"\x89PNG\r\n\x1a\n")
    large = text(tmp_path / "large", "# " + "x" * 1_000_001)
    for path, says in (
        (tmp_path / "none.yaml", "No such file"),
        (tmp_path, "directory"),
        (binary, "not a text"),
        (large, "larger than 1000 kB"),
    ):
        with pytest.raises(InputError, match=says):
            read_calibration(path, "left", "right")


def test_a_byte_order_mark_and_windows_line_ends_do_no_harm(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + CAMCHAIN.replace("\n", "\r\n").encode())
    assert read_calibration(path, "left", "right").second.matrix[0, 0] == 400


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_no_damage_ends_in_anything_but_one_line(tmp_path, data):
    """Characters are cut out, doubled or replaced anywhere: a calibration or an InputError, never a traceback."""
    stored = [opencv(tmp_path / f"sample.{ending}", STEREO).read_text() for ending in ("yml", "xml", "json")]
    samples = [CAMCHAIN, KITTI, *stored]
    content = data.draw(st.sampled_from(samples))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(content) - 1))
        to = min(at + data.draw(st.integers(0, 40)), len(content))
        junk = data.draw(
            st.sampled_from(["", "[", "{", ":", "-", "9e999", "\t", "null", "&a *a", "${X}", "<", "\x00", "é"])
        )
        content = content[:at] + junk + content[to:]
    path = tmp_path / "damaged"
    path.write_text(content)
    try:
        found = read_calibration(path, "left", "right")
    except InputError as error:
        said, found = str(error), None
    if found is None:
        assert len(said.splitlines()) == 1
    else:
        assert np.isfinite(found.rotation).all()
        assert np.isfinite(found.translation).all()
