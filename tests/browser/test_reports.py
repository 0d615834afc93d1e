"""The pages that commands write, in a browser."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from pipeline.cli.app import app
from tests.browser.conftest import visit
from tests.programs import syncwatch, write_folders

SUITE = """
recordings:
  room: {type: synthetic, duration_s: 4, fps: 10, width: 160, height: 120}
scenarios:
  slip:
    row: A1
    about: The second camera runs a frame ahead.
    recording: room
    faults: [{type: slip, camera: right, frames: 1, start_s: 2}]
    expect: {state: async, cause: slip}
detectors: {timestamp: {}}
"""


HOW = pytest.mark.parametrize(("scheme", "phone"), [("light", False), ("dark", True)])


@HOW
def test_the_report_of_an_evaluation_opens(chromium, tmp_path, scheme, phone):
    (tmp_path / "suite.yaml").write_text(SUITE)
    done = syncwatch("evaluate", "suite.yaml", "--report", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    with visit(chromium, (tmp_path / "out/index.html").as_uri(), scheme=scheme, phone=phone) as page:
        expect(page.locator("body")).to_contain_text("The second camera runs a frame ahead.")
        assert page.locator("svg").count() > 0


@HOW
@pytest.mark.skipif("report" not in app.commands, reason="there is no such command")
def test_the_report_of_a_recording_opens(chromium, tmp_path, scheme, phone):
    write_folders(tmp_path / "walk")
    done = syncwatch("report", "walk", "-o", "page.html", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    with visit(chromium, (tmp_path / "page.html").as_uri(), scheme=scheme, phone=phone) as page:
        expect(page.locator("body")).to_contain_text("walk")
        assert page.locator("svg, img, canvas").count() > 0
