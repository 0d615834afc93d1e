"""Fixtures for pytest: `pytest_plugins = ["syncwatch.testing.plugin"]` in a conftest.py adds them."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from pathlib import Path

import pytest

from syncwatch.testing.rendered import RenderedRig, render_rig
from syncwatch.testing.standins import ListSink


@pytest.fixture
def rendered_rig(tmp_path: Path) -> Callable[..., RenderedRig]:
    """Renders a rig, as `syncwatch.testing.render_rig` does, into a recording of this test."""
    numbers = count()
    return lambda **options: render_rig(tmp_path / f"rendered{next(numbers)}.mcap", **options)


@pytest.fixture
def list_sink() -> ListSink:
    """A sink that keeps every report."""
    return ListSink()
