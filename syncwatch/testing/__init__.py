"""A test kit for pipelines that are fed by several cameras: stand-ins, rendered rigs with faults, and assertions.

`pytest_plugins = ["syncwatch.testing.plugin"]` in a conftest.py adds the fixtures.
"""

from syncwatch.testing.asserts import assert_in_sync, assert_out_of_sync
from syncwatch.testing.rendered import RenderedRig, render_rig
from syncwatch.testing.standins import ListSink, ScriptedSource, Step

__all__ = [
    "ListSink",
    "RenderedRig",
    "ScriptedSource",
    "Step",
    "assert_in_sync",
    "assert_out_of_sync",
    "render_rig",
]
