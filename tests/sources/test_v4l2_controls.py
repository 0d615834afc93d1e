"""Controls of a camera by name."""

from __future__ import annotations

import errno
import logging

import pytest

from pipeline.errors import InputError
from sources.v4l2 import abi
from tests.sources.v4l2_kernel import ControlSpec, FakeCamera, Machine, Shot, failure

AUTO, EXPOSURE = 0x009A0901, 0x009A0902
GAIN, FIXED, PUSH = 12, 13, 14
CONTROLS = (
    ControlSpec(EXPOSURE, "Exposure Time, Absolute", minimum=1, maximum=200),
    ControlSpec(AUTO, "Auto Exposure", abi.CTRL_MENU, maximum=3, menu=("Auto Mode", "Manual Mode", "", "Aperture")),
    ControlSpec(GAIN, "Gain", flags=abi.CTRL_INACTIVE),
    ControlSpec(FIXED, "Pixel Rate", flags=abi.CTRL_READ_ONLY),
    ControlSpec(PUSH, "Do It", abi.CTRL_BUTTON),
    ControlSpec(15, "Mirror", abi.CTRL_BOOLEAN, maximum=1),
    ControlSpec(16, "Old", flags=abi.CTRL_DISABLED),
)


@pytest.fixture(autouse=True)
def _log_is_heard(monkeypatch):
    monkeypatch.setattr(logging.getLogger("syncwatch"), "propagate", True)


@pytest.fixture
def machine(tmp_path):
    machine = Machine(tmp_path)
    machine.plug("video0", FakeCamera([Shot()], controls=CONTROLS))
    return machine


def test_they_are_set_in_the_order_given_by_number_word_and_truth(machine):
    machine.run(controls={"auto_exposure": "manual mode", "exposure_time_absolute": 80, "mirror": True, "do_it": 1})
    assert machine.cameras["video0"].set_to == [(AUTO, 1), (EXPOSURE, 80), (15, 1), (PUSH, 1)]


def test_they_are_set_again_when_the_camera_is_opened_anew(machine):
    machine.cameras["video0"].steps.extend([failure(errno.EIO), Shot()])
    machine.run(controls={"exposure_time_absolute": 80})
    assert machine.cameras["video0"].set_to == [(EXPOSURE, 80)] * 2


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("exposure_tme_absolute", 1, "controls.exposure_tme_absolute: no such control - did you mean 'exposure_time_"),
        ("zoom", 1, "controls.zoom: no such control. It has gain, pixel_rate, do_it, mirror, auto_exposure, exposure_"),
        ("old", 1, "controls.old: no such control"),
        ("exposure_time_absolute", 0, "controls.exposure_time_absolute: 0 is not allowed: give 1 to 200"),
        ("exposure_time_absolute", "long", "long is not allowed: give 1 to 200"),
        ("auto_exposure", 2, "2 is not allowed: give one of 0 (Auto Mode), 1 (Manual Mode), 3 (Aperture)"),
        ("mirror", 7, "7 is not allowed: give true or false"),
        ("pixel_rate", 7, "controls.pixel_rate: can only be read on this camera"),
    ],
)
def test_what_cannot_be_set_is_an_error_that_says_what_can(machine, name, value, words):
    with pytest.raises(InputError) as caught:
        machine.run(controls={name: value})
    assert words in str(caught.value)
    assert not machine.cameras["video0"].is_open


@pytest.mark.parametrize(("auto", "exposure_ns"), [("Auto Mode", None), ("Manual Mode", 8_000_000), ("Aperture", None)])
def test_an_exposure_that_no_automatism_changes_is_known(machine, auto, exposure_ns):
    frames, _ = machine.run(controls={"auto_exposure": auto, "exposure_time_absolute": 80})
    assert frames[0].exposure_ns == exposure_ns


def test_what_the_driver_makes_of_a_value_is_said(machine, caplog):
    machine.run(controls={"exposure_time_absolute": 150, "gain": 5})
    assert [record.message for record in caplog.records] == [
        "left: exposure_time_absolute: asked for 150, the driver set 90",
        "left: gain: set, but without effect while another control rules it (automatic exposure?)",
    ]
