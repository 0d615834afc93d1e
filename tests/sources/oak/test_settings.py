"""What may be configured of OAKs, and that depthai is met only by those who have some."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec

import pytest
from pydantic import ValidationError

from pipeline.errors import InputError
from sources.oak.library import load
from sources.oak.settings import OakSettings
from tests.programs import ROOT, syncwatch

needs_depthai = pytest.mark.skipif(find_spec("depthai") is None, reason="depthai is not installed: make test-oak")
NAMES = ("DEPTHAI_TELEMETRY", "DEPTHAI_INSTALL_SIGNAL_HANDLER", "DEPTHAI_LEVEL")


def test_one_oak_needs_no_settings():
    settings = OakSettings()
    assert settings.camera_names == ("left", "right")
    assert settings.stamps == "device"


@pytest.mark.parametrize(
    ("devices", "text"),
    [
        ([{}, {"device": "a"}], "of several devices each needs its id or IP address"),
        ([{"device": "a"}, {"device": "a", "cameras": {"x": "CAM_A"}}], "device 'a' is given twice"),
        ([{"device": "a"}, {"device": "b"}], "two cameras are named left"),
        ([{"cameras": {"left": "CAM_B", "right": "CAM_B"}}], "two cameras are at CAM_B of one device"),
    ],
)
def test_devices_that_do_not_fit_together_are_said(devices, text):
    with pytest.raises(ValidationError, match=text):
        OakSettings.model_validate({"devices": devices})


def test_without_depthai_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "depthai", None)
    with pytest.raises(InputError, match=r"OAK cameras need depthai .*: install syncwatch with its extra 'oak'"):
        load(telemetry=False)


STAND_IN = f"""
import os
print(*(os.environ.get(name) for name in {NAMES}))
"""


@pytest.mark.parametrize(
    ("telemetry", "environment", "expected"),
    [
        (False, {}, ["0", "0", "off"]),
        (True, {}, ["None", "0", "off"]),
        (False, {"DEPTHAI_TELEMETRY": "1", "DEPTHAI_LEVEL": "warn"}, ["1", "0", "warn"]),
    ],
)
def test_telemetry_is_off_unless_the_configuration_or_the_environment_asks(tmp_path, telemetry, environment, expected):
    """A stand-in prints what holds at its import: the real one must not be imported with telemetry on."""
    (tmp_path / "depthai.py").write_text(STAND_IN)
    kept = {name: value for name, value in os.environ.items() if name not in NAMES}
    env = {**kept, **environment, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    code = (
        "import sys\n"
        "from sources.oak.library import load\n"
        "from sources.oak.source import OakSource\n"
        "assert 'depthai' not in sys.modules\n"
        f"load(telemetry={telemetry})\n"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, check=True, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == expected


def test_a_configuration_is_checked_without_depthai(tmp_path):
    (tmp_path / "config.yaml").write_text("source: {type: oak, clock: wall}\ndetectors: {timestamp: {}}\n")
    done = syncwatch("validate", "--no-environment", cwd=tmp_path)
    assert done.returncode == 2
    assert "source.clock: 'wall' is not one of: auto, device, host, ptp" in done.stderr


@needs_depthai
def test_a_machine_without_an_oak_says_so(tmp_path):
    (tmp_path / "config.yaml").write_text("source: {type: oak}\ndetectors: {timestamp: {}}\n")
    done = syncwatch("check", "config.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("syncwatch: error: no OAK is found on USB or the network")
    assert done.stdout == ""
