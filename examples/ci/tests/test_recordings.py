"""Recordings that others build on are in sync."""

from syncwatch.testing import assert_in_sync


def test_the_calibration_recording_is_in_sync(rendered_rig):
    recording = rendered_rig(seconds=3).path  # in your project: a recording of your own
    assert_in_sync(recording)
