"""The schemas of messages, against what a run with faults really publishes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner
from jsonschema import Draft202012Validator

from pipeline.assemble import KINDS
from pipeline.cli.app import app
from pipeline.cli.common import execute
from pipeline.configtext.document import load_text
from pipeline.messages import SHAPES, message_schema
from pipeline.plan import make_plan
from pipeline.verdict import Message
from tests.programs import ROOT
from tests.schemas import check

PUBLISHED = ("verdict", "event", "status", "aligned")

CONFIG = """
source: {type: synthetic, width: 160, height: 120, fps: 20, duration_s: 5, speed: max}
faults:
  - {type: slip, camera: right, frames: 1, start_s: 1, stop_s: 2}
  - {type: dark, camera: left, start_s: 2.2, stop_s: 2.8}
  - {type: drop, camera: left, every: 7, start_s: 3}
  - {type: dead, camera: right, start_s: 3.5}
detectors: {timestamp: , offset: }
judge: {range: {baseline_m: 0.1, focal_px: 100}}
align: {max_frames: 3}
"""


@pytest.fixture(scope="module")
def published() -> dict[str, list[Message]]:
    """By schema, as they come out of JSON."""
    plan = make_plan(load_text(CONFIG, "c.yaml", {}, ()), KINDS, Path.cwd())
    told: dict[str, list[Message]] = {}

    def take(report):
        message = json.loads(json.dumps(report.to_message(), allow_nan=False))
        told.setdefault(message["schema"], []).append(message)

    assert execute(plan, on_report=take) == 0
    return told


@pytest.mark.parametrize("name", PUBLISHED)
def test_everything_published_keeps_its_schema_and_no_member_is_undescribed(published, name):
    messages = published[f"syncwatch.{name}.v1"]
    for message in messages:
        check(message, name)
    assert len(messages) >= 2


def test_the_run_told_of_faults_so_that_the_test_means_something(published):
    verdicts = published["syncwatch.verdict.v1"]
    assert {verdict["cause"] for verdict in verdicts} >= {None, "slip", "missing"}
    assert any(verdict["content"] and verdict["range_error"] for verdict in verdicts)
    assert {event["phase"] for event in published["syncwatch.event.v1"]} == {"onset", "end"}


@pytest.mark.parametrize("name", PUBLISHED)
@pytest.mark.parametrize("harm", ["missing", "type"])
def test_a_message_that_is_wrong_is_told(published, name, harm):
    message = dict(published[f"syncwatch.{name}.v1"][0])
    if harm == "missing":
        del message["rig"]
    else:
        message["rig"] = 7
    assert not Draft202012Validator(message_schema(name)).is_valid(message)


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_reader_of_today_accepts_what_a_later_version_adds(published, name):
    message = {**published[f"syncwatch.{name}.v1"][0], "of_later": 1}
    assert Draft202012Validator(message_schema(name)).is_valid(message)


@pytest.mark.parametrize("name", SHAPES)
def test_the_schemas_that_are_handed_out_are_those_of_the_code(name):
    printed = CliRunner().invoke(app, ["schema", name], standalone_mode=False).output
    file = ROOT / "docs" / "schemas" / f"{name}.schema.json"
    assert file.read_text() == printed, f"syncwatch schema {name} > {file.relative_to(ROOT)}"
    assert json.loads(printed)["title"] == f"syncwatch.{name}.v1"


def test_no_schema_is_handed_out_that_is_not_made_any_more():
    assert {file.name.split(".")[0] for file in (ROOT / "docs" / "schemas").iterdir()} == set(SHAPES)
