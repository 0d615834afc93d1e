"""OAK cameras judged by a whole run."""

from __future__ import annotations

import io
import json
from importlib.util import find_spec
from pathlib import Path

import pytest

if find_spec("depthai") is None:
    pytest.skip("depthai is not installed: make test-oak installs it", allow_module_level=True)

from pipeline.assemble import KINDS, assemble
from pipeline.configtext.document import load_text
from pipeline.plan import make_plan
from pipeline.run import Run
from pipeline.verdict import Cause, State, Verdict
from sources.oak.source import OakSource
from tests.oak import HostBuild, shots


def judged(script, seconds, **source):
    config = {"source": {"type": "oak", **source}, "detectors": {"timestamp": {}}}
    plan = make_plan(load_text(json.dumps(config), "test", {}), KINDS, Path.cwd())
    made, said = OakSource(plan.source.settings, build=HostBuild(script, pace_s=0.01), start_within_s=1.0), []
    made.open()
    Run(assemble(plan, made, console=io.StringIO(), on_report=said.append), stop_after_s=seconds).execute()
    return [one for one in said if isinstance(one, Verdict)]


@pytest.mark.parametrize(("right_us", "state"), [(0, State.SYNC), (12_000, State.ASYNC)])
def test_stamps_of_one_device_are_compared(right_us, state):
    said = judged(shots(100, right_us=right_us), 1.2)
    assert [one.state for one in said if one.frame is not None][-1] is state


def test_a_camera_of_which_nothing_comes_is_missing():
    said = judged(shots(200, right=False), 1.5)
    assert {(one.cause, one.camera) for one in said if one.state is State.ASYNC} == {(Cause.MISSING, "right")}
