"""The frames of the worst moments, kept as a run goes on, and the points in them."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.frame import Frame, Pair
from pipeline.report.moments import MOST_MOMENTS, REMEMBERED, WIDTH_PX, Moment, Moments, Recent
from pipeline.report.points import compare
from pipeline.verdict import Basis, Cause, State, Verdict
from tests.frames import texture

PERIOD_NS = 33_000_000
PAIR = Pair("left", "right")
SCENE = texture(1, 400, 500)


def view(shift_px, width=320):
    return SCENE[100 + shift_px : 340 + shift_px, 60 : 60 + width]


def verdict(number, state=State.ASYNC, frames=1.0):
    return Verdict(
        "bench", "left-right", number, state, Basis.CONTENT,
        cause=Cause.SLIP if state is State.ASYNC else None,
        offset_ns=round(frames * PERIOD_NS), offset_frames=frames,
        captured_ns=dict.fromkeys(("left", "right"), number * PERIOD_NS), sequence={"left": number, "right": number},
    )  # fmt: skip


def kept(verdicts, shifts=None):
    """The moments of a run whose right camera sees the scene move up by `shifts`."""
    moments, recent = Moments(PAIR, PERIOD_NS), Recent()

    def show(number):
        for camera in ("left", "right"):
            image = view(0 if shifts is None else int(shifts[number]))
            recent.add(Frame(camera, number, number * PERIOD_NS, "rig", number * PERIOD_NS, image))

    show(0)
    for said in verdicts:
        if said.frame + 1 < (len(shifts) if shifts is not None else len(verdicts)):
            show(said.frame + 1)
        moments.add(said, said.frame / 30, recent)
    return moments.worst()


def test_of_a_stretch_the_moment_with_most_motion_is_kept():
    shifts = np.cumsum([0] * 30 + [0, 1, 2, 5, 2, 1] + [0] * 30)
    worst = kept([verdict(n) for n in range(len(shifts))], shifts)
    assert [moment.verdict.frame for moment in worst] == [33]
    assert worst[0].before is not None
    assert worst[0].after is not None


def test_the_three_worst_stretches_are_kept_in_order_of_time():
    said = [verdict(n, State.ASYNC if n // 20 % 2 else State.SYNC, frames=1.0 + n // 20) for n in range(200)]
    worst = kept(said, np.arange(200) % 50)
    assert len(worst) == MOST_MOMENTS
    assert [moment.verdict.frame // 20 for moment in worst] == [5, 7, 9]


def test_where_nothing_lasts_the_liveliest_moment_is_an_example():
    said = [verdict(n, State.ASYNC if n == 12 else State.SYNC, frames=0.0) for n in range(40)]
    shifts = np.cumsum([0] * 20 + [4] + [0] * 19)
    worst = kept(said, shifts)
    assert [(moment.verdict.frame, moment.verdict.state) for moment in worst] == [(20, State.SYNC)]


def test_pictures_that_are_kept_are_small_and_few():
    recent = Recent()
    big = np.zeros((1080, 1920, 3), np.uint8)
    for n in range(3 * REMEMBERED):
        for camera in ("left", "right"):
            recent.add(Frame(camera, n, n, "rig", n, big))
    assert recent.moment(verdict(0), PAIR, 0.0, 1.0) is None
    last = Verdict(
        "bench", "left-right", 0, State.ASYNC, Basis.CONTENT,
        captured_ns=dict.fromkeys(("left", "right"), 47), sequence={"left": 47, "right": 47},
    )  # fmt: skip
    moment = recent.moment(last, PAIR, 0.0, 1.0)
    assert moment is not None
    assert moment.second.shape == (WIDTH_PX * 9 // 16, WIDTH_PX, 3)


@pytest.mark.parametrize("offset", [1.0, -1.0, 0.5])
def test_points_moved_back_by_the_offset_lie_where_the_first_camera_saw_them(offset):
    """The scene moves up by 4 px a frame; the second camera shows it `offset` frames later."""
    shown = round(4 * offset)
    said = verdict(0, frames=offset)
    moment = Moment(0.0, said, 1.0, view(20), view(20 + shown), view(16 + shown), view(24 + shown))
    compared = compare(moment, PERIOD_NS)
    both = len(compared.first)
    assert both > 10
    before = np.abs(compared.second[:both, 1] - compared.first[:, 1])
    after = np.abs(compared.moved[:both, 1] - compared.first[:, 1])
    assert np.median(before) == pytest.approx(abs(shown), abs=0.2)
    assert np.nanmedian(after) < 0.2


def test_pictures_without_anything_in_common_have_no_points():
    flat = np.full((240, 320), 90, np.uint8)
    compared = compare(Moment(0.0, verdict(0), 1.0, flat, flat, None, None), PERIOD_NS)
    assert len(compared.first) == len(compared.lengths) == 0
