"""Reads the calibration of two cameras from the files that OpenCV, Kalibr and KITTI write."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pipeline.detectors.offset.arrays import Floats
from pipeline.detectors.offset.calibration import Lens, Model, Size, StereoCalibration, for_pictures
from pipeline.detectors.offset.sheet import Key, Sheet, read_sheet

NOT_A_ROTATION = 1e-3
"""Files round to four digits or more; a matrix that is no rotation is off by tenths."""

MODELS: Mapping[str, Model] = {
    "radtan": "radtan",
    "radialtangential": "radtan",
    "plumbbob": "radtan",
    "rationalpolynomial": "radtan",
    "brown": "radtan",
    "equidistant": "equidistant",
    "equi": "equidistant",
    "fisheye": "equidistant",
    "kannalabrandt": "equidistant",
    "none": "none",
}
COUNTS: Mapping[Model, tuple[int, ...]] = {"radtan": (4, 5, 8, 12, 14), "equidistant": (4,), "none": (0,)}

UNDERSTOOD = (
    "understood are a stereo calibration of OpenCV (K1, D1, K2, D2, R, T), a camchain of Kalibr (cam0, cam1, ...) and "
    "KITTI's calib.txt (P0: ..., P1: ...)"
)


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A camera of a file. names: what a rig may call it; pose: 4 x 4, from the file's first camera to this one."""

    name: str
    names: frozenset[str]
    lens: Lens
    pose: Floats


def read_calibration(
    path: Path, first: str, second: str, cameras: Sequence[str] | None = None, size: Size | None = None
) -> StereoCalibration:
    """The calibration of the pair `first`, `second`; the format is told from what the file holds.

    cameras: all cameras of the rig, in order (default: the two). They are the file's cameras of the same names (`cam1`,
    `left`, a part of Kalibr's rostopic, KITTI's image_2) if all of either side find their partner, else the file's in
    order. size: of the recorded pictures, checked at once (`for_pictures`) if given.

    Raises InputError, one line, for a file that is missing, broken, of another kind or physically impossible.
    """
    sheet = read_sheet(path)
    if sheet.rows:
        found, rectified = _kitti(sheet), True
    elif any(re.fullmatch(r"cam\d+", str(key)) for key in sheet.data):
        found, rectified = _kalibr(sheet), False
    else:
        found, rectified = _opencv(sheet)
    one, two = _chosen(sheet, found, first, second, tuple(cameras or (first, second)))
    pose = two.pose @ np.linalg.inv(one.pose)
    if not np.linalg.norm(pose[:3, 3]) > 1e-9:
        raise sheet.error((), f"{first} and {second} stand in the same place: the baseline must not be 0")
    stereo = StereoCalibration(sheet.label, one.lens, two.lens, pose[:3, :3], pose[:3, 3], rectified)
    return stereo if size is None else for_pictures(stereo, size, size)


def _chosen(
    sheet: Sheet, found: Sequence[Camera], first: str, second: str, cameras: tuple[str, ...]
) -> tuple[Camera, Camera]:
    named = {camera: [f for f in found if camera in f.names] for camera in cameras}
    partners = [matches[0] for matches in named.values() if len(matches) == 1]
    if len(set(map(id, partners))) == len(partners) and len(partners) in {len(cameras), len(found)}:
        of = {camera: matches[0] for camera, matches in named.items() if len(matches) == 1}
    else:
        of = dict(zip(cameras, found, strict=False))
    for camera in (first, second):
        if camera not in of:
            known = ", ".join(f.name for f in found)
            raise sheet.error((), f"no calibration of camera {camera}: the file has {len(found)} cameras ({known})")
    return of[first], of[second]


# --- KITTI ---


def _kitti(sheet: Sheet) -> list[Camera]:
    """P0 ... P3 of the odometry files, P_rect_00 ... with S_rect_00 ... of the raw ones (Geiger et al. 2013)."""
    found = []
    for key in sheet.data:
        match = re.fullmatch(r"P(?:_rect_)?0?(\d)", key)
        if match:
            number = match[1]
            names = {f"{word}{zero}{number}" for word in ("image_", "image", "cam", "p", "") for zero in ("", "0")}
            size = _size(sheet, (f"S_rect_0{number}",)) if f"S_rect_0{number}" in sheet.data else None
            found.append(_projection(sheet, (key,), names, size))
    if len(found) < 2:
        raise sheet.error((), f"one camera only ({', '.join(sheet.data)}): a pair needs two, P0 and P1 or P2 and P3")
    return found


def _projection(sheet: Sheet, key: Key, names: set[str], size: Size | None) -> Camera:
    """A camera of rectified pictures from its 3 x 4 projection matrix K [I | t]."""
    matrix = sheet.numbers(key, (12,), "a projection matrix of 3 x 4").reshape(3, 4)
    lens = Lens(_matrix(sheet, key, matrix[:, :3]), np.zeros(0), "none", size)
    shift = np.asarray(np.linalg.solve(lens.matrix, matrix[:, 3]), np.float64)
    return Camera(str(key[-1]), frozenset(names), lens, _pose(np.eye(3), shift))


# --- Kalibr ---


def _kalibr(sheet: Sheet) -> list[Camera]:
    """A camchain: each camera's T_cn_cnm1 takes points of the camera before it to its own coordinates."""
    keys = sorted((key for key in sheet.data if re.fullmatch(r"cam\d+", key)), key=lambda key: int(key[3:]))
    if keys != [f"cam{n}" for n in range(len(keys))] or len(keys) < 2:
        raise sheet.error((), f"cameras {', '.join(keys)}: a camchain has cam0, cam1 and so on without a gap")
    found: list[Camera] = []
    pose = np.eye(4)
    for key in keys:
        if not isinstance(sheet.data[key], dict):
            raise sheet.error((key,), "a mapping with intrinsics, distortion_coeffs, ... must stand here")
        kind = sheet.text((key, "camera_model"), "pinhole")
        if kind != "pinhole":
            raise sheet.error((key, "camera_model"), f"'{kind}' is not supported: allowed is pinhole")
        fx, fy, cx, cy = sheet.numbers((key, "intrinsics"), (4,), "fx, fy, cx, cy")
        matrix = _matrix(sheet, (key, "intrinsics"), np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]))
        model = _model(sheet, (key, "distortion_model"))
        lens = Lens(matrix, _distortion(sheet, (key, "distortion_coeffs"), model), model, None)
        if found:
            step = sheet.numbers((key, "T_cn_cnm1"), (16,), "a transformation of 4 x 4").reshape(4, 4)
            if not np.allclose(step[3], [0, 0, 0, 1]):
                raise sheet.error((key, "T_cn_cnm1"), f"the last row is {step[3].tolist()}, it must be [0, 0, 0, 1]")
            pose = _pose(_rotation(sheet, (key, "T_cn_cnm1"), step[:3, :3]), step[:3, 3]) @ pose
        size = _size(sheet, (key, "resolution"))
        topic = re.findall(r"[a-z0-9_]+", sheet.text((key, "rostopic"), "").lower())
        found.append(Camera(key, frozenset([key, *topic]), Lens(lens.matrix, lens.coefficients, model, size), pose))
    return found


# --- OpenCV ---

SIDES = {"0": "0", "1": "1", "2": "2", "l": "left", "r": "right", "left": "left", "right": "right"}
_SIDE = "(?P<side>0|1|2|left|right|l|r)"
_KINDS = {
    "matrix": "cameramatrix|cammatrix|cameramat|cammat|intrinsicmatrix|intrinsics?|mtx|k|m",
    "distortion": "distortioncoefficients|distortioncoeffs|distcoeffs?|distcoefs?|distortion|dist|d",
    "projection": "projectionmatrix|projection|p",
    "cameramodel": "cameramodel",
    "model": "distortionmodel|distmodel|model",
    "size": "imagesize|imgsize|resolution|size",
    "width": "imagewidth|imgwidth|width",
    "height": "imageheight|imgheight|height",
}
_COMMON = {
    "rotation": "rotationmatrix|rotation|r12|r",
    "rodrigues": "rotationvector|rvec|om",
    "translation": "translationvector|translation|tvec|t12|t",
    **{kind: _KINDS[kind] for kind in ("cameramodel", "model", "size", "width", "height")},
}
_FRONT = "(?:camera|cam|stereo|extrinsics?|extrinsicparameters)?"


def _opencv(sheet: Sheet) -> tuple[list[Camera], bool]:
    """What stereoCalibrate returns, under any of its usual names; or P1 and P2 alone, of rectified pictures."""
    keys = _recognised(sheet)
    sides = sorted({side for side, kind in keys if kind == "matrix"})
    rectified = not sides
    if rectified:
        sides = sorted({side for side, kind in keys if kind == "projection"})
    if len(sides) != 2:
        have = f"its keys are {', '.join(map(str, list(sheet.data)[:8]))}" if sheet.data else "it is empty"
        raise sheet.error((), f"no calibration of two cameras that is understood ({have}): {UNDERSTOOD}")
    sizes = [_opencv_size(sheet, keys, side) for side in sides]
    if rectified:
        both = [
            _projection(sheet, keys[side, "projection"], {side}, size) for side, size in zip(sides, sizes, strict=True)
        ]
        return both, True
    lenses = [_opencv_lens(sheet, keys, side, size) for side, size in zip(sides, sizes, strict=True)]
    missing = "OpenCV's own example writes intrinsics and extrinsics to two files: put both into one"
    if ("", "translation") not in keys or not {("", "rotation"), ("", "rodrigues")} & keys.keys():
        raise sheet.error((), f"no rotation R and translation T between the cameras - {missing}")
    if ("", "rotation") in keys:
        at = keys["", "rotation"]
        turn = sheet.numbers(at, (9, 3), "a rotation of 3 x 3 or a rotation vector of 3")
    else:
        at = keys["", "rodrigues"]
        turn = sheet.numbers(at, (3,), "a rotation vector of 3")
    matrix = turn.reshape(3, 3) if len(turn) == 9 else np.asarray(cv2.Rodrigues(turn)[0], np.float64)
    shift = sheet.numbers(keys["", "translation"], (3,), "a translation of 3")
    poses = [np.eye(4), _pose(_rotation(sheet, at, matrix), shift)]
    return [
        Camera(side, frozenset([side]), lens, pose) for side, lens, pose in zip(sides, lenses, poses, strict=True)
    ], False


def _recognised(sheet: Sheet) -> dict[tuple[str, str], Key]:
    """Keys by side ('' for both cameras) and kind; those of a group (left: {...}) are written out."""
    written: list[tuple[str, Key]] = []
    for key, value in sheet.data.items():
        if isinstance(value, dict) and "data" not in value:
            written += [(f"{key}{inner}", (key, inner)) for inner in value]
        else:
            written.append((str(key), (key,)))
    found: dict[tuple[str, str], Key] = {}
    for name, path in written:
        plain = re.sub(r"[^a-z0-9]", "", name.lower())
        recognised = _recognise(plain)
        if recognised is not None:
            found.setdefault(recognised, path)
    return found


def _recognise(plain: str) -> tuple[str, str] | None:
    """Side and kind that a key of lower-case letters and digits names; the first kind that fits."""
    for kind, words in _KINDS.items():
        before = re.fullmatch(f"(?:camera|cam)?{_SIDE}(?:camera|cam)?(?:{words})", plain)
        match = re.fullmatch(f"(?:{words})(?:cam)?{_SIDE}", plain) or before
        if match:
            return SIDES[match["side"]], kind
    for kind, words in _COMMON.items():
        if re.fullmatch(f"{_FRONT}(?:{words})", plain):
            return "", kind
    return None


def _opencv_lens(sheet: Sheet, keys: Mapping[tuple[str, str], Key], side: str, size: Size | None) -> Lens:
    at = keys[side, "matrix"]
    matrix = _matrix(sheet, at, sheet.numbers(at, (9,), "a camera matrix of 3 x 3").reshape(3, 3))
    where = keys.get((side, "distortion"))
    if where is None:
        if any(kind == "distortion" for _, kind in keys):
            raise sheet.error(at, "this camera has no distortion coefficients, the other has: give both or none")
        return Lens(matrix, np.zeros(0), "none", size)
    model = _opencv_model(sheet, keys, side)
    return Lens(matrix, _distortion(sheet, where, model), model, size)


def _opencv_model(sheet: Sheet, keys: Mapping[tuple[str, str], Key], side: str) -> Model:
    """OpenCV's files do not say which model they hold; radtan, unless a key was added that does."""
    for which in (side, ""):
        if (which, "model") in keys:
            return _model(sheet, keys[which, "model"])
    for which in (side, ""):
        if (which, "cameramodel") in keys and sheet.text(keys[which, "cameramodel"]) != "pinhole":
            return _model(sheet, keys[which, "cameramodel"])
    return "radtan"


def _opencv_size(sheet: Sheet, keys: Mapping[tuple[str, str], Key], side: str) -> Size | None:
    for which in (side, ""):
        if (which, "size") in keys:
            return _size(sheet, keys[which, "size"])
        if (which, "width") in keys and (which, "height") in keys:
            return _size(sheet, keys[which, "width"], keys[which, "height"])
    return None


# --- what all have in common ---


def _size(sheet: Sheet, *keys: Key) -> Size:
    values = [n for key in keys for n in sheet.numbers(key, (2 // len(keys),), "width and height, px").tolist()]
    if any(n < 1 or n != int(n) or n > 100_000 for n in values):
        raise sheet.error(keys[0], f"{values} is no size of a picture: width and height are whole numbers of pixels")
    return int(values[0]), int(values[1])


def _matrix(sheet: Sheet, key: Key, matrix: Floats) -> Floats:
    fx, fy = matrix[0, 0], matrix[1, 1]
    if not (fx > 0 and fy > 0):
        raise sheet.error(key, f"focal lengths {fx:g} and {fy:g} px: they must be above 0")
    rest = [matrix[1, 0], *matrix[2]]
    if not np.allclose(rest, [0, 0, 0, 1]) or abs(matrix[0, 1]) > 0.1 * fx:
        raise sheet.error(key, f"{matrix.tolist()} is no camera matrix: it reads [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    return np.asarray(matrix, np.float64)


def _model(sheet: Sheet, key: Key) -> Model:
    name = sheet.text(key)
    model = MODELS.get(re.sub(r"[^a-z]", "", name.lower()))
    if model is None:
        raise sheet.error(key, f"'{name}' is not supported: allowed are radtan, plumb_bob, equidistant, fisheye, none")
    return model


def _distortion(sheet: Sheet, key: Key, model: Model) -> Floats:
    if model == "none":
        return np.zeros(0)
    return sheet.numbers(key, COUNTS[model], f"coefficients of the model {model}")


def _rotation(sheet: Sheet, key: Key, matrix: Floats) -> Floats:
    """The nearest rotation, if that is near: files round."""
    away = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
    determinant = float(np.linalg.det(matrix))
    if away > NOT_A_ROTATION or determinant < 0:
        raise sheet.error(
            key,
            f"no rotation: R times its transpose is {away:.3g} off the identity (allowed {NOT_A_ROTATION:g}), "
            f"its determinant is {determinant:.3f} (must be 1)",
        )
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ right, np.float64)


def _pose(rotation: Floats, translation: Floats) -> Floats:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return pose
