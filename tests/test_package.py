"""The built wheel, used from another directory."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import zipfile
from importlib import metadata

import pytest

from tests.programs import ROOT


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    """The wheel's content, as it would be installed."""
    built = tmp_path_factory.mktemp("built")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(built), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True, timeout=100)
    (wheel,) = built.glob("*.whl")
    target = tmp_path_factory.mktemp("unpacked")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(target)
    return target


def run(unpacked, cwd, *arguments: str) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, "PYTHONPATH": str(unpacked)}
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, timeout=60, check=False)


def test_it_holds_exactly_the_packages(unpacked):
    tops = {path.name for path in unpacked.iterdir() if not path.name.endswith(".dist-info")}
    assert tops == {"syncwatch", "pipeline", "sources", "sinks"}


def test_every_module_of_the_checkout_is_in_it(unpacked):
    for top in ("syncwatch", "pipeline", "sources", "sinks"):
        inside = {path.relative_to(unpacked) for path in (unpacked / top).rglob("*.py")}
        assert inside == {path.relative_to(ROOT) for path in (ROOT / top).rglob("*.py")}


def test_the_page_of_the_dashboard_is_in_it(unpacked):
    web = "pipeline/dashboard/web"
    assert {file.name for file in (unpacked / web).iterdir()} == {file.name for file in (ROOT / web).iterdir()}


def test_its_command_runs_from_elsewhere_with_the_shipped_configuration(unpacked, tmp_path):
    where = run(unpacked, tmp_path, "-c", "import pipeline; print(pipeline.__file__)")
    assert where.stdout.startswith(str(unpacked))
    done = run(unpacked, tmp_path, "-m", "syncwatch", "validate")
    assert done.returncode == 0, done.stderr
    assert "(shipped): valid" in done.stdout


def test_versions_are_pinned_in_plain_lines():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    assert all(re.fullmatch(r"[A-Za-z0-9_.-]+==[A-Za-z0-9_.]+", line) for line in lines)


def test_everything_syncwatch_needs_is_pinned_to_the_version_that_is_installed():
    pinned = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().split())
    canonical = {name.lower().replace("_", "-"): version for name, version in pinned.items()}
    waiting, seen = ["syncwatch"], set()
    while waiting:
        name = waiting.pop()
        for requirement in metadata.requires(name) or []:
            needed = re.split(r"[^A-Za-z0-9_.-]", requirement)[0].lower().replace("_", "-")
            if "extra ==" in requirement or needed in seen:
                continue
            seen.add(needed)
            try:
                assert metadata.version(needed) == canonical[needed]
                waiting.append(needed)
            except metadata.PackageNotFoundError:
                continue  # for another platform or version of Python
    assert {"numpy", "click", "pydantic", "annotated-types"} <= seen
