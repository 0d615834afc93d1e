"""What a consumer makes of a rig that fails."""

import pytest
from consumer import pairs_by_stamp

from syncwatch.testing import assert_out_of_sync


def test_frames_of_a_healthy_rig_are_all_paired(rendered_rig):
    frames = rendered_rig(seconds=2).frames()
    assert len(pairs_by_stamp(frames)) == 60


def test_frames_that_slip_are_not_paired(rendered_rig):
    frames = rendered_rig(seconds=2, faults=["stamp_offset:camera=right,ms=40"]).frames()
    assert len(pairs_by_stamp(frames)) < 60


@pytest.mark.parametrize("frames", [1, 2])
def test_pairing_by_stamp_cannot_see_that_stamps_lie(rendered_rig, frames):
    """Which is why the rig itself has to be watched."""
    rig = rendered_rig(seconds=3, faults=[f"content_shift:camera=right,frames={frames}"])
    assert len(pairs_by_stamp(rig.frames())) > 80
    assert_out_of_sync(rig.path, cause="stamps_lie")
