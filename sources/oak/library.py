"""The only place that imports depthai: an optional extra of 366 MB that would send telemetry from its import on."""

from __future__ import annotations

import importlib
import os
from typing import Any

from pipeline.errors import InputError

QUIET = {"DEPTHAI_INSTALL_SIGNAL_HANDLER": "0", "DEPTHAI_LEVEL": "off"}
"""Signals are ours; it would log to standard output, which belongs to results, and what it raises is said anyway."""


def load(*, telemetry: bool) -> Any:
    """The module depthai. What the environment says already is left as it is.

    Raises InputError where it is not installed.
    """
    for name, value in (QUIET if telemetry else {**QUIET, "DEPTHAI_TELEMETRY": "0"}).items():
        os.environ.setdefault(name, value)
    try:
        return importlib.import_module("depthai")
    except ImportError as error:
        raise InputError(f"OAK cameras need depthai ({error}): install syncwatch with its extra 'oak'") from None
