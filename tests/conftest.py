"""Where the real recordings are."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of real recordings; without it, CI fails and other machines skip."""
    folder = Path(os.environ.get("SYNCWATCH_DATA", ROOT / "../shared/data")).resolve()
    if not folder.is_dir():
        message = f"no recordings at {folder}: set SYNCWATCH_DATA"
        if os.environ.get("CI") == "true":
            pytest.fail(message)
        pytest.skip(message)
    return folder
