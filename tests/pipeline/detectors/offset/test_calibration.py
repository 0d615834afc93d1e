"""What a calibration predicts, against points projected into both cameras by textbook formulas."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.detectors.offset.calibration import (
    Epipolar,
    Lens,
    StereoCalibration,
    aged,
    epipolar_angle,
    for_pictures,
    geometry_start,
    trust,
    unbiased_start,
)
from pipeline.detectors.offset.geometry import PRIOR, design
from pipeline.errors import InputError

SIZE = (640, 480)
BARREL = [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]


def lens(focal=500.0, centre=(319.5, 239.5), coefficients=(), model="none", size=SIZE, ratio=1.0):
    matrix = np.array([[focal, 0, centre[0]], [0, focal * ratio, centre[1]], [0, 0, 1]], float)
    return Lens(matrix, np.array(coefficients, float), model, size)


def rig(degrees=(0, 0, 0), translation=(-0.12, 0, 0), first=None, second=None):
    rotation = cv2.Rodrigues(np.radians(np.array(degrees, float)))[0]
    first = first or lens()
    return StereoCalibration("rig.yaml", first, second or first, rotation, np.array(translation, float), False)


def seen(calibration, seed=0, count=400, nearest=None):
    """Points in space as both cameras see them: n x 2 pixels each, all inside both pictures."""
    rng = np.random.default_rng(seed)
    baseline = np.linalg.norm(calibration.translation)
    nearest = nearest or 4 * baseline * calibration.first.matrix[0, 0] / calibration.first.size[0]
    depth = nearest / rng.uniform(0.01, 1, count)
    points = np.column_stack([rng.uniform(-0.8, 0.8, (count, 2)), np.ones(count)]) * depth[:, None]
    turn = cv2.Rodrigues(calibration.rotation)[0]
    here = picture(calibration.first, points, np.zeros(3), np.zeros(3))
    there = picture(calibration.second, points, turn, calibration.translation)
    both = inside(here, calibration.first) & inside(there, calibration.second)
    assert both.sum() > count / 8
    return here[both], there[both]


def picture(lens, points, turn, translation):
    if lens.model == "equidistant":
        return cv2.fisheye.projectPoints(points[:, None], turn, translation, lens.matrix, lens.coefficients)[0][:, 0]
    return cv2.projectPoints(points, turn, translation, lens.matrix, lens.coefficients)[0][:, 0]


def inside(at, lens):
    return ((at > -0.5) & (at < np.array(lens.size) - 0.5)).all(axis=1)


def predicted_px(terms, here, there, size=SIZE):
    u, v = ((here - np.array(size) / 2) / size[0]).T
    d = (there - here)[:, 0] / size[0]
    return design(u, v, d) @ terms * size[0]


small = st.floats(-0.3, 0.3)
part = st.floats(-0.02, 0.02)


@settings(max_examples=40, deadline=None)
@given(st.tuples(small, small, small), part, part, part, st.floats(0.6, 1.3), st.booleans())
def test_terms_of_nearly_parallel_rigs_predict_the_displacement_to_a_twentieth_of_a_pixel(
    degrees, up, ahead, ratio, focal, to_the_left
):
    first, second = lens(focal * 640), lens(focal * 640 * (1 + ratio / 4), centre=(325, 236))
    calibration = rig(degrees, (0.12 if to_the_left else -0.12, 0.12 * up, 0.12 * ahead), first, second)
    start = geometry_start(calibration, SIZE)
    here, there = seen(calibration)
    assert np.abs(predicted_px(start.terms, here, there) - (there - here)[:, 1]).max() < 0.05
    assert start.misfit_px < 0.02


@pytest.mark.parametrize("smaller", [(320, 240), (160, 120), (640, 480)])
def test_reduced_pictures_see_the_same_displacements(smaller):
    calibration = rig((0.4, -0.3, 0.5), (-0.12, 0.003, 0.002), second=lens(505, (330.5, 250.5)))
    full, less = geometry_start(calibration, SIZE), geometry_start(calibration, smaller)
    scale = smaller[0] / 640
    here, there = seen(calibration)
    small_here, small_there = ((at + 0.5) * scale - 0.5 for at in (here, there))
    expected = predicted_px(full.terms, here, there) * scale
    np.testing.assert_allclose(predicted_px(less.terms, small_here, small_there, smaller), expected, atol=0.01)
    assert less.misfit_px == pytest.approx(full.misfit_px * scale, rel=0.1)


def test_a_calibration_of_larger_pictures_is_scaled_with_edges_on_edges():
    """A point on the left upper edge (-0.5, -0.5) stays there; whole pixels would shift by half of one."""
    big = lens(1000, (639.5, 479.5 + 40), size=(1280, 960))
    start = geometry_start(rig(first=lens(1000, (639.5, 479.5), size=(1280, 960)), second=big), SIZE)
    assert start.terms[0] * 640 == pytest.approx(20, abs=1e-6)


@pytest.mark.parametrize(
    ("changed", "term", "value"),
    [
        ({"degrees": (0.5, 0, 0)}, 0, -500 * np.radians(0.5) / 640),  # X2 = R X1: the picture moves up
        ({"degrees": (0, 0, 0.5)}, 1, np.radians(0.5)),
        ({"second": lens(500, ratio=1.01)}, 2, 0.01),
        ({"translation": (-0.1, 0.002, 0)}, 3, -0.02),
        ({"translation": (-0.1, 0, 0.002)}, 6, 0.02 * 640 / 500),
    ],
)
def test_each_term_has_its_physical_cause_and_sign(changed, term, value):
    terms = geometry_start(rig(**changed), SIZE).terms
    assert terms[term] == pytest.approx(value, rel=0.05)


def test_a_higher_second_camera_sees_things_lower():
    """It stands at y = -0.05 (y points down), so T = -R C = +0.05."""
    calibration = rig(translation=(-0.12, 0.05, 0))
    here, there = seen(calibration)
    assert ((there - here)[:, 1] > 0).all()
    start = geometry_start(calibration, SIZE)
    np.testing.assert_allclose(predicted_px(start.terms, here, there), (there - here)[:, 1], atol=1e-6)


@pytest.mark.parametrize(
    ("translation", "degrees"),
    [((-1, 0, 0), 0), ((0.2, 0, 0), 0), ((0, 0.3, 0), 90), ((0, -1, 0), 90), ((1, 1, 0), 45)],
)
def test_the_epipolar_angle_tells_side_by_side_from_one_above_the_other(translation, degrees):
    assert epipolar_angle(rig(translation=translation)) == pytest.approx(degrees, abs=1e-9)


def test_a_rolled_rig_is_measured_in_the_first_camera():
    """The second camera is rolled by 90 degrees but stands at the first one's right."""
    roll = cv2.Rodrigues(np.array([0, 0, np.pi / 2]))[0]
    calibration = replace(rig(), rotation=roll, translation=-roll @ np.array([0.1, 0, 0]))
    assert epipolar_angle(calibration) == pytest.approx(0, abs=1e-9)


def test_undistorted_rigs_are_trusted_far_beyond_the_prior_but_not_blindly():
    start = geometry_start(rig((0.1, 0.2, 0.1)), SIZE)
    deviations = np.sqrt(np.diag(np.linalg.inv(start.information)))
    assert (deviations < PRIOR / 3.5).all()
    assert (deviations > 0.5 * trust(500 / 640)).all()
    assert deviations[6] * 500 / 640 < 0.003  # v d: three thousandths of the baseline


def test_what_the_terms_cannot_say_widens_them_but_not_beyond_the_prior():
    bent = lens(400, coefficients=BARREL, model="radtan")
    plain, distorted = geometry_start(rig(), SIZE), geometry_start(rig(first=bent), SIZE)
    assert plain.misfit_px < 1e-6
    assert distorted.misfit_px > 1
    wide = np.sqrt(np.diag(np.linalg.inv(distorted.information)))
    assert (wide <= PRIOR).all()
    assert (wide > 2 * np.sqrt(np.diag(np.linalg.inv(plain.information)))).all()


def test_a_pair_one_above_the_other_is_not_trusted():
    start = geometry_start(rig(translation=(0, -0.12, 0)), SIZE)
    assert start.misfit_px > 10
    assert np.isfinite(start.terms).all()


@pytest.mark.parametrize("degrees", [(0, 120, 0), (0, 180, 0), (0, 75, 0)])
def test_without_common_view_only_the_prior_is_left(degrees):
    start = geometry_start(rig(degrees), SIZE)
    assert start.misfit_px == float("inf")
    np.testing.assert_array_equal(start.information, np.diag(PRIOR**-2))
    assert not start.terms.any()


LENSES = [
    ((), "none"),
    (BARREL, "radtan"),
    ([*BARREL, 0.01], "radtan"),
    ([0.3, -0.1, 0.001, 0.0005, 0.01, 0.5, -0.1, 0.02], "radtan"),
    ([*BARREL, 0, 0, 0, 0, 0.001, 0.002, -0.001, 0.001], "radtan"),
    ([*BARREL, 0, 0, 0, 0, 0.001, 0.002, -0.001, 0.001, 0.02, -0.01], "radtan"),
    ([-0.02, 0.01, -0.005, 0.001], "equidistant"),
]


@pytest.mark.parametrize(("coefficients", "model"), LENSES)
@pytest.mark.parametrize("degrees", [(0.4, -1, 0.7), (2, 8, -3)])
def test_the_exact_prediction_holds_for_every_lens(coefficients, model, degrees):
    first = lens(400, (310, 250), coefficients, model)
    second = lens(410, (325, 233), coefficients, model)
    calibration = rig(degrees, (-0.12, 0.004, -0.006), first, second)
    here, there = seen(calibration)
    across, slope, known = Epipolar(calibration, SIZE).across(here, (there - here)[:, 0])
    assert known.mean() > 0.99
    np.testing.assert_allclose(across[known], (there - here)[known, 1], atol=0.01)
    more, _, still = Epipolar(calibration, SIZE).across(here, (there - here)[:, 0] + 0.5)
    both = known & still
    np.testing.assert_allclose(more[both] - across[both], 0.5 * slope[both], atol=0.02)


def test_points_that_a_calibration_cannot_place_are_named():
    """One above the other: every displacement along the rows but one is impossible."""
    across, slope, known = Epipolar(rig(translation=(0, -0.12, 0)), SIZE).across(
        np.array([[100.0, 100.0], [300.0, 50.0]]), np.array([10.0, 0.0])
    )
    assert not known[0]
    assert (across[0], slope[0]) == (0, 0)


def test_what_remains_after_the_exact_prediction_is_trusted():
    start = unbiased_start(rig(first=lens(400, coefficients=BARREL, model="radtan")))
    assert not start.terms.any()
    assert (np.linalg.inv(start.information).diagonal() ** 0.5 < PRIOR / 3.5).all()


def test_pictures_may_be_scaled_but_neither_cropped_nor_turned():
    calibration = rig()
    assert for_pictures(calibration, (320, 240), (1280, 960)).first.size == SIZE
    assert for_pictures(rig(first=lens(size=None)), (648, 480), SIZE).first.size == (648, 480)
    for first, second, which in (((640, 400), SIZE, "first"), (SIZE, (480, 640), "second")):
        with pytest.raises(InputError, match=rf"rig.yaml: the {which} camera was calibrated.* 640 x 480.*1%"):
            for_pictures(calibration, first, second)


def test_a_calibration_of_larger_pictures_that_does_not_say_so_is_noticed():
    with pytest.raises(InputError, match=r"principal point of the first camera, \(700, 400\) px, lies outside"):
        for_pictures(rig(first=lens(900, (700, 400), size=None)), SIZE, SIZE)


def test_sizes_must_be_known_before_terms_are_asked_for():
    with pytest.raises(ValueError, match="for_pictures"):
        geometry_start(rig(first=lens(size=None)), SIZE)


def test_what_was_learned_long_ago_is_trusted_like_a_calibration():
    sharp = aged(np.eye(8) * 1e12)
    np.testing.assert_allclose(np.linalg.inv(sharp).diagonal() ** 0.5, trust(1.0), rtol=1e-3)
    vague = aged(np.diag(PRIOR**-2))
    np.testing.assert_allclose(np.linalg.inv(vague).diagonal() ** 0.5, PRIOR, rtol=0.05)
