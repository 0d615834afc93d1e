"""The test kit for others: rendered rigs, assertions, fixtures, and the example project that uses them."""

from __future__ import annotations

import subprocess
import sys

import pytest

from pipeline.errors import InputError
from syncwatch.testing import assert_in_sync, assert_out_of_sync, render_rig
from tests.programs import ROOT


def test_a_rendered_rig_is_a_recording_of_its_frames(tmp_path):
    rig = render_rig(tmp_path / "rig.mcap", seconds=1, fps=20, width=160, height=120)
    frames = list(rig.frames())
    assert [camera.name for camera in rig.rig.cameras] == ["left", "right"]
    assert len(frames) == 40
    assert all(frame.truth is not None for frame in frames)
    assert [frame.sequence for frame in rig.frames()] == [frame.sequence for frame in frames]


def test_assertions_tell_a_fault_and_its_cause(tmp_path):
    shifted = "content_shift:camera=right,frames=1"
    path = render_rig(tmp_path / "rig.mcap", seconds=3, width=160, height=120, faults=[shifted]).path
    assert_out_of_sync(path, cause="stamps_lie")
    with pytest.raises(AssertionError, match="OUT OF SYNC"):
        assert_in_sync(path)
    with pytest.raises(AssertionError, match="stamps_lie"):
        assert_out_of_sync(path, cause="frozen")


def test_a_rig_in_sync_is_not_out_of_sync(tmp_path):
    path = render_rig(tmp_path / "rig.mcap", seconds=3, width=160, height=120).path
    assert_in_sync(path)
    with pytest.raises(AssertionError, match="In sync"):
        assert_out_of_sync(path)


def test_what_cannot_be_rendered_or_read_is_said(tmp_path):
    with pytest.raises(InputError, match="no camera 'rigth'"):
        render_rig(tmp_path / "rig.mcap", seconds=1, faults=["slip:camera=rigth"])
    with pytest.raises(InputError, match="no such file"):
        assert_in_sync(tmp_path / "nothing.mcap")


def test_the_example_project_passes_where_it_stands():
    command = [sys.executable, "-B", "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    folder = ROOT / "examples" / "ci"
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "5 passed" in done.stdout
