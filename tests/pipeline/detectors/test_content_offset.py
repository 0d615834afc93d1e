"""The offset measured from pictures, on rendered footage and real recordings with known shifts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.configtext.document import load_text
from pipeline.evaluate.runner import evaluate_clip
from pipeline.evaluate.score import Score
from pipeline.evaluate.suite import read_suite

SHIFTS = {
    "clean": {},
    "ahead": {"faults": [{"type": "content_shift", "frames": 1}]},
    "stale": {"faults": [{"type": "content_shift", "frames": -1}]},
    "half": {"faults": [{"type": "content_shift", "frames": 0.5}]},
    "step": {"faults": [{"type": "content_shift", "frames": -1, "start_s": 2.5}]},
}


def scored(source: dict[str, Any], manipulation: str, base: Path) -> Score:
    suite = {
        "recordings": {"it": source},
        "manipulations": {manipulation: SHIFTS[manipulation]},
        "detectors": {"offset": {}},
    }
    (clip,) = read_suite(load_text(yaml.safe_dump(suite), "suite", {}), base)
    (result,) = evaluate_clip(clip).scores
    return result


def rendered(motion: str, seconds: float = 3.5, *, width: int = 320, height: int = 240) -> dict[str, Any]:
    return {"type": "synthetic", "motion": motion, "duration_s": seconds, "width": width, "height": height}


@pytest.mark.parametrize("motion", ["handheld", "objects"])
@pytest.mark.parametrize("manipulation", ["clean", "ahead", "stale"])
def test_whole_frames_are_measured_to_hundredths_where_things_move(motion, manipulation, tmp_path):
    result = scored(rendered(motion, width=640, height=480), manipulation, tmp_path)
    assert result.decided >= 0.9 * result.windows
    assert result.whole_right == result.measured
    assert max(result.errors) < 0.05
    assert result.false_async == result.false_sync == 0


def test_half_a_frame_is_measured(tmp_path):
    result = scored(rendered("handheld"), "half", tmp_path)
    assert result.decided >= 0.9 * result.windows
    assert result.small_error == result.measured


def test_a_step_is_told_within_twenty_frames(tmp_path):
    result = scored(rendered("handheld", 5), "step", tmp_path)
    assert result.steps == 1
    assert result.delays
    assert result.delays[0] <= 20


def test_a_still_scene_is_never_decided(tmp_path):
    assert scored(rendered("still"), "clean", tmp_path).decided == 0


@pytest.mark.parametrize("manipulation", ["clean", "stale"])
def test_a_drive_at_constant_speed_is_never_called_out_of_sync_when_it_is_not(manipulation, tmp_path):
    source = {**rendered("drive"), "drive": {"speed_variation": 0}}
    result = scored(source, manipulation, tmp_path)
    assert result.false_async == result.false_sync == 0


@pytest.mark.parametrize("manipulation", ["clean", "ahead", "stale"])
def test_a_real_drive_is_measured(manipulation, recordings):
    result = scored({"type": "replay", "path": "kitti_odo_seq1", "fps": 10}, manipulation, recordings)
    assert result.decided >= 0.9 * result.windows
    assert result.whole_right == result.measured
    assert max(result.errors) < 0.1


def test_nothing_but_codec_flicker_is_never_decided(recordings):
    assert scored({"type": "replay", "path": "robot_static"}, "clean", recordings).decided == 0
