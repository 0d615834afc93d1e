"""`syncwatch audit --cluster` on a real scheduler and real workers, each a process of its own."""

from __future__ import annotations

import builtins
import os
import signal
import subprocess
import sys
import zipfile
from contextlib import ExitStack, contextmanager

import pytest

from pipeline.audit.cluster import cluster
from pipeline.audit.remote import below
from pipeline.errors import InputError
from tests.formats import STAMPED, UNSTAMPED, rendered, scene_of, side_by_side
from tests.network import wait_for
from tests.programs import ROOT, lines_of, syncwatch, write_folders


@contextmanager
def running(folder, name, *arguments):
    """A process of Dask's, told by its log."""
    env = {**os.environ, "PYTHONPATH": str(ROOT), "DASK_TEMPORARY_DIRECTORY": str(folder / "dask")}
    with (
        (folder / f"{name}.log").open("w") as log,
        subprocess.Popen(
            [sys.executable, "-m", "dask", *arguments], cwd=folder, env=env, stdout=log, stderr=subprocess.STDOUT
        ) as process,
    ):
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture
def site(tmp_path):
    """The address of a scheduler and its two workers, one task at a time each."""
    with ExitStack() as opened:
        options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", "scheduler.json")
        opened.enter_context(running(tmp_path, "scheduler", "scheduler", *options))
        wait_for((tmp_path / "scheduler.json").exists, 40)
        told = ("--scheduler-file", "scheduler.json", "--no-nanny", "--nthreads", "1", "--no-dashboard")
        workers = [opened.enter_context(running(tmp_path, f"worker{n}", "worker", *told)) for n in range(2)]
        log = tmp_path / "scheduler.log"
        wait_for(lambda: log.read_text().count("Starting worker compute stream") == 2, 40)
        address = next(word for word in log.read_text().split() if word.startswith("tcp://"))
        yield address, workers


PATIENT = """
import time
from pathlib import Path
from typing import Literal
from syncwatch import Settings

class PatientSettings(Settings):
    type: Literal["patient:Patient"] = "patient:Patient"

class Patient:
    Settings = PatientSettings
    def __init__(self, settings, *, name, rig):
        self._rig = rig.name
    def observe(self, window):
        while self._rig != "a" and not Path("go").exists():
            time.sleep(0.05)
        return []
"""
"""A detector that is done with one recording, and waits with all others until it may go on."""


def test_nothing_is_lost_or_doubled_when_a_worker_is_killed_midway(tmp_path, site):
    address, workers = site
    (tmp_path / "patient.py").write_text(PATIENT)
    names = "abcdef"
    for name in names:
        write_folders(tmp_path / "archive" / name, 12)
    command = ["audit", "archive", "--cluster", address, "--set", "detectors={patient: {type: 'patient:Patient'}}"]
    with subprocess.Popen(
        [sys.executable, "-m", "syncwatch", *command],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        kept = tmp_path / "audit" / "audit.jsonl"
        wait_for(lambda: kept.exists() and kept.read_text().endswith("\n"), 40)
        os.kill(workers[0].pid, signal.SIGKILL)
        workers[0].wait(40)
        (tmp_path / "go").touch()
        output, errors = process.communicate(timeout=60)
    assert process.returncode == 4, errors
    records = lines_of(kept.read_text())
    assert sorted(record["path"].rpartition("/")[2] for record in records) == list(names)
    assert [(record["error"], record["frames"]) for record in records] == [(None, 12)] * len(names)
    assert "6 recordings: 6 cannot tell." in output
    assert "Traceback" not in errors


def test_what_lies_at_a_url_is_judged_on_copies_that_are_removed(tmp_path, site):
    address, _ = site
    source = rendered(1.5)
    source.open()
    scene = scene_of(source.frames())
    STAMPED["euroc"](tmp_path / "day" / "drone", scene)
    STAMPED["rosbag2"](tmp_path / "day" / "robot", scene)
    UNSTAMPED["videos"](tmp_path / "day" / "phone", {"left": scene["left"]})
    side_by_side(tmp_path / "day" / "wide", scene)
    with zipfile.ZipFile(tmp_path / "day.zip", "w") as archive:
        for file in sorted((tmp_path / "day").rglob("*")):
            archive.write(file, file.relative_to(tmp_path))
    copies = tmp_path / "copies"
    copies.mkdir()
    url = f"zip://day::file://{tmp_path / 'day.zip'}"
    done = syncwatch("audit", url, "--cluster", address, cwd=tmp_path, TMPDIR=str(copies))
    assert done.returncode == 4, done.stderr
    told = {record["path"]: record for record in lines_of((tmp_path / "audit" / "audit.jsonl").read_text())}
    assert {path: (one["format"], one["error"]) for path, one in told.items()} == {
        below(url, "drone"): ("euroc", None),
        below(url, "robot"): ("rosbag2", None),
        below(url, "wide"): ("halves", None),
        below(url, "phone"): (None, "one camera only (video 'left.avi')"),
    }
    assert told[below(url, "drone")]["state"] == "sync"
    assert list(copies.iterdir()) == []
    assert list((tmp_path / "dask").rglob("syncwatch-*")) == []
    again = syncwatch("audit", url, "--cluster", address, cwd=tmp_path)
    assert "4 found, 4 of them judged before" in again.stderr
    wrong = syncwatch("audit", "zip://night::file://day.zip", "--cluster", address, cwd=tmp_path)
    assert (wrong.returncode, wrong.stderr) == (
        2,
        "syncwatch: error: zip://night::file://day.zip: there is no file\n",
    )


@pytest.mark.parametrize(
    ("url", "place", "expected"),
    [
        ("s3://bucket/day", "rig", "s3://bucket/day/rig"),
        ("s3://bucket/day/", "rig/cam", "s3://bucket/day/rig/cam"),
        ("s3://bucket/day", ".", "s3://bucket/day"),
        ("zip://::file:///a.zip", "rig", "zip://rig::file:///a.zip"),
        ("zip://day::simplecache::s3://bucket/a.zip", "rig", "zip://day/rig::simplecache::s3://bucket/a.zip"),
        ("simplecache::s3://bucket/day", "rig", "simplecache::s3://bucket/day/rig"),
    ],
)
def test_a_place_below_a_url_is_a_url(url, place, expected):
    assert below(url, place) == expected


def test_a_scheduler_that_does_not_answer_is_one_line_and_status_2(tmp_path):
    write_folders(tmp_path / "rig", 2)
    done = syncwatch("audit", "rig", "--cluster", "tcp://127.0.0.1:9", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1
    assert "--cluster tcp://127.0.0.1:9: no scheduler answers there within 5 s" in done.stderr


def test_without_dask_it_says_what_to_install(monkeypatch):
    real = builtins.__import__

    def without_dask(name, *rest):
        if name == "distributed":
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without_dask)
    with pytest.raises(InputError, match=r"--cluster: Dask is not installed here: pip install 'syncwatch\[cluster\]'"):
        cluster("tcp://127.0.0.1:8786").__enter__()


def test_dask_is_loaded_for_clusters_alone(tmp_path):
    code = "import sys, pipeline.cli.app; sys.exit(bool({'distributed', 'dask', 'fsspec'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, timeout=60, check=False).returncode == 0
