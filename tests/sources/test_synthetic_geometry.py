"""Measures rendered scenes with optical flow and compares with projection on paper."""

import itertools

import cv2
import numpy as np
import pytest

from pipeline.frame import NS_PER_S
from sources.synthetic.motion import rig_motion, rotation
from sources.synthetic.scene import Workshop
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import START_NS, SyntheticSource
from sources.synthetic.street import Street

WIDTH, HEIGHT, FOCAL_PX = 640, 480, 512.0
CENTRE_PX = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
FRAME_NS = NS_PER_S // 30
CLEAN = {"noise_sigma": 0}


def opened(seed=5, **values):
    source = SyntheticSource(SyntheticSettings(**values), seed=seed)
    source.open()
    return source


def seen(source, camera="left", at_ns=0):
    return source.picture_at(camera, START_NS + at_ns)


def corners(picture):
    return cv2.goodFeaturesToTrack(picture, 600, 0.01, 8)


def tracked(first, second, guess=None):
    """Where corners of the first picture are in it and in the second; only those that find their way back."""
    start = corners(first)
    guess = start.copy() if guess is None else guess(start.reshape(-1, 2)).astype(np.float32).reshape(-1, 1, 2)
    flow = {"winSize": (15, 15), "maxLevel": 3, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
    flow["criteria"] = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 0.001)
    there, found, _ = cv2.calcOpticalFlowPyrLK(first, second, start, guess, **flow)
    back, _, _ = cv2.calcOpticalFlowPyrLK(second, first, there, start.copy(), **flow)
    good = (found.ravel() == 1) & (np.abs(back - start).max(axis=(1, 2)) < 0.1)
    assert good.sum() > 100
    return start.reshape(-1, 2)[good], there.reshape(-1, 2)[good]


@pytest.mark.parametrize("motion", ["handheld", "drive"])
def test_a_rectified_rig_sees_every_point_on_the_same_row(motion):
    source = opened(motion=motion)
    for at_ns in (0, 2 * NS_PER_S + 7):
        here, there = tracked(seen(source, "left", at_ns), seen(source, "right", at_ns))

        assert np.median(np.abs(there - here)[:, 1]) < 0.05
        assert abs(np.median((there - here)[:, 1])) < 0.01
        assert np.median((there - here)[:, 0]) < -3, "what is seen from further right lies further left"


def test_a_turned_camera_sees_every_point_where_its_rotation_puts_it():
    angles_deg = (0.2, 1.0, -2.0)
    source = opened(motion="still", baseline_m=0, cameras=[CLEAN, {**CLEAN, "rotation_deg": angles_deg}])

    def turned(points_px):
        rays = np.column_stack([(points_px - CENTRE_PX) / FOCAL_PX, np.ones(len(points_px))]) @ rotation(*angles_deg)
        return rays[:, :2] / rays[:, 2:] * FOCAL_PX + CENTRE_PX

    here, there = tracked(seen(source, "left"), seen(source, "right"), turned)
    assert np.median(np.hypot(*(there - turned(here)).T)) < 0.05


@pytest.mark.parametrize(
    ("angles_deg", "sees"),
    [
        ((2, 0, 0), lambda x, y: (y * 0.0349, -x * 0.0349)),
        ((0, 2, 0), lambda x, y: (0 * x, 17.9 + 0 * y)),
        ((0, 0, 2), lambda x, y: (-17.9 + 0 * x, 0 * y)),
    ],
    ids=["clockwise", "up", "right"],
)
def test_a_camera_turns_clockwise_up_and_right(angles_deg, sees):
    source = opened(motion="still", baseline_m=0, cameras=[CLEAN, {**CLEAN, "rotation_deg": angles_deg}])
    here, there = tracked(seen(source, "left"), seen(source, "right"))
    near_centre = np.hypot(*(here - CENTRE_PX).T) < 150
    expected = np.column_stack(sees(*(here - CENTRE_PX).T))

    assert np.median(np.abs(there - here - expected)[near_centre], axis=0) == pytest.approx([0, 0], abs=0.6)


def test_disparity_doubles_with_the_baseline():
    source = opened(motion="still", baseline_m=0.04, cameras=[CLEAN] * 3)
    pictures = [seen(source, camera.name) for camera in source.cameras]
    here, there = tracked(pictures[0], pictures[1])
    beyond = cv2.calcOpticalFlowPyrLK(pictures[0], pictures[2], here, (2 * there - here).copy(), flags=4)[0]

    assert np.median(np.abs((beyond - here) - 2 * (there - here))) < 0.05


def test_a_camera_further_forward_sees_things_larger_by_their_depth():
    forward_m, baseline_m = 0.05, 0.12
    ahead = {**CLEAN, "position_m": (0, 0, forward_m)}
    source = opened(motion="still", cameras=[CLEAN, {**CLEAN, "position_m": (baseline_m, 0, 0)}, ahead])
    first, beside, closer = (seen(source, camera.name) for camera in source.cameras)
    here, aside = tracked(first, beside)
    depth_m = FOCAL_PX * baseline_m / (here - aside)[:, 0]
    expected = CENTRE_PX + (here - CENTRE_PX) * (depth_m / (depth_m - forward_m))[:, None]
    there = cv2.calcOpticalFlowPyrLK(first, closer, here, expected.astype(np.float32), flags=4)[0]

    assert np.median(np.hypot(*(expected - here).T)) > 2
    assert np.median(np.hypot(*(there - expected).T)) < 0.08


def test_a_pan_turns_about_the_vertical_and_nothing_else():
    source = opened(motion="pan", cameras=[CLEAN, CLEAN])
    sideways_px = []
    for at_ns in range(0, 4 * NS_PER_S, NS_PER_S // 2):
        here, there = tracked(seen(source, "left", at_ns), seen(source, "left", at_ns + FRAME_NS))
        (x, y), (x_then, y_then) = (here - CENTRE_PX).T, (there - CENTRE_PX).T
        # A direction keeps its elevation, so that a point stays on its hyperbola; the middle row is one of them.
        expected = y * np.hypot(x_then, FOCAL_PX) / np.hypot(x, FOCAL_PX)
        assert np.median(np.abs(y_then - expected)) < 0.04
        sideways_px.append(np.median((there - here)[:, 0]))

    assert max(map(abs, sideways_px)) > 2
    assert np.ptp(sideways_px) > 2, "its speed changes"


def test_moving_objects_move_and_the_room_stands_still():
    source = opened(motion="objects", cameras=[CLEAN, CLEAN])
    moved = 0
    for at_ns in range(0, 3 * NS_PER_S, NS_PER_S):
        here, there = tracked(seen(source, "left", at_ns), seen(source, "left", at_ns + FRAME_NS))
        step_px = np.abs(there - here)
        assert np.median(step_px) < 0.02
        moved += ((step_px > 0.3).all(axis=1)).sum()

    assert moved > 60


def test_a_hand_moves_the_picture_some_pixels_up_and_down_nearly_always():
    source = opened()
    motion_px = []
    for at_ns in range(0, 6 * NS_PER_S, NS_PER_S // 3):
        here, there = tracked(seen(source, "left", at_ns), seen(source, "left", at_ns + FRAME_NS))
        motion_px.append(np.median(np.abs(there - here)[:, 1]))

    assert 1 < np.median(motion_px) < 4
    assert np.mean(np.array(motion_px) > 0.2) > 0.8


@pytest.mark.parametrize("motion", ["handheld", "drive"])
def test_motion_is_smooth_between_neighbouring_frames(motion):
    """A point moves in thirds of a frame as it moves in whole ones; nothing jumps from one picture to the next."""
    source = opened(motion=motion, cameras=[CLEAN, CLEAN])
    at_ns = 3 * NS_PER_S
    pictures = [seen(source, "left", at_ns + i * FRAME_NS // 3) for i in range(4)]
    paths = [tracked(pictures[0], picture) for picture in pictures[1:]]
    common = set.intersection(*({tuple(p) for p in here} for here, _ in paths))
    steps = [{tuple(a): b - a for a, b in zip(here, there, strict=True)} for here, there in paths]
    third, two_thirds, whole = (np.array([step[p] for p in sorted(common)]) for step in steps)

    assert len(common) > 100
    # A parabola through the start, two thirds and the whole must pass through the third.
    assert np.median(np.abs(third - (two_thirds - whole / 3))) < 0.03


def test_driving_faster_moves_further_and_steady_speed_stays_steady():
    steady = opened(motion="drive", drive={"speed_variation": 0})
    twice = opened(motion="drive", drive={"speed_variation": 0, "speed_m_s": 20})

    here, there = (seen(source, "left", at).astype(float) for source, at in ((twice, NS_PER_S), (steady, 2 * NS_PER_S)))
    assert np.abs(here - there).mean() < 4, "the same place, but for noise"
    assert np.abs(here - seen(steady, "left", NS_PER_S)).mean() > 15


def test_the_speed_of_a_drive_swings_within_its_bounds():
    settings = SyntheticSettings(motion="drive", drive={"speed_m_s": 10, "speed_variation": 0.5})
    drive = rig_motion(settings, np.random.default_rng(4))
    speeds_m_s = np.diff([drive(t_s).position_m[2] for t_s in np.arange(0, 30, 0.01)]) / 0.01

    assert 5 <= speeds_m_s.min() < 7
    assert 13 < speeds_m_s.max() <= 15
    assert np.abs(np.diff(speeds_m_s)).max() < 0.2, "and never jumps"


def test_what_comes_into_sight_down_the_street_fades_in():
    street = Street(Workshop(1, FOCAL_PX, colour=False))
    places = [{tuple(s.quad_m.ravel()): s.opacity for s in street.surfaces(0, z_m)} for z_m in np.arange(0, 30, 0.1)]

    appeared = [now[place] for before, now in itertools.pairwise(places) for place in now.keys() - before.keys()]
    assert len(appeared) > 20
    assert max(appeared) < 0.01


def test_pitch_shakes_a_drive_up_and_down():
    calm, shaken = (opened(motion="drive", drive={"pitch_deg": deg}, cameras=[CLEAN] * 2) for deg in (0, 2))

    def horizon_motion_px(source):
        steps = []
        for at_ns in range(0, 2 * NS_PER_S, NS_PER_S // 3):
            here, there = tracked(seen(source, "left", at_ns), seen(source, "left", at_ns + FRAME_NS))
            far = np.hypot(*(here - CENTRE_PX).T) < 80
            steps.append(abs(np.median((there - here)[far, 1])))
        return np.median(steps)

    assert horizon_motion_px(calm) < 0.15
    assert horizon_motion_px(shaken) > 0.8


def test_a_drive_never_runs_out_of_street():
    source = opened(motion="drive", width=320, height=240)
    for hours in (1, 30):
        picture = seen(source, "left", hours * 3600 * NS_PER_S)
        assert picture.std() > 25


@pytest.mark.parametrize("motion", ["drive", "handheld", "objects", "pan", "still"])
def test_the_picture_is_full_of_corners_everywhere(motion):
    source = opened(motion=motion)
    for at_ns in (0, 5 * NS_PER_S):
        points = corners(seen(source, "left", at_ns)).reshape(-1, 2)
        assert len(points) >= 300
        cells = {(int(x // 160), int(y // 120)) for x, y in points}
        assert len(cells) >= 12, "of 16"


def test_frame_follows_frame_without_a_flash():
    source = opened(motion="drive", cameras=[CLEAN] * 2, width=320, height=240)
    pictures = [seen(source, "left", i * FRAME_NS // 4).astype(float) for i in range(160)]
    changes = [np.abs(b - a).mean() for a, b in itertools.pairwise(pictures)]

    assert max(changes) < 2 * np.median(changes)
