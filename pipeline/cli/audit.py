"""`syncwatch audit`: which recordings of an archive are in sync?"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from io import StringIO
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, TypeAlias

import click
from rich.console import Console
from rich.progress import Progress, TimeElapsedColumn

from pipeline.audit.cluster import cluster, judge_there
from pipeline.audit.find import find
from pipeline.audit.journal import Journal, check_folder, journal
from pipeline.audit.local import judge_here
from pipeline.audit.remote import is_url, tasks_at
from pipeline.audit.table import headline, reasons, said, table, write_segments
from pipeline.audit.task import Task, effort, file_facts, fingerprint, settings_fingerprint
from pipeline.cli.common import CANNOT_TELL, DONE, OUT_OF_SYNC, set_option
from pipeline.cli.output import output_file
from pipeline.cli.recording import RecordingOptions, recording_plan
from pipeline.errors import InputError, RunError
from pipeline.messages import AuditShape
from pipeline.plan import Plan
from pipeline.printable import printable
from pipeline.terms import State
from sources.replay.formats import recognise
from sources.replay.names import natural

if TYPE_CHECKING:
    from distributed import Client

Judges: TypeAlias = Callable[[Sequence[Task], Callable[[], bool]], Generator[tuple[Task, AuditShape], None, None]]
"""Yields each task and what is said of it, as they get done; ends early when the second argument is true."""

SEGMENTS, SUMMARY = "segments.csv", "summary.txt"
TABLE_WIDTH = 200
"""Where there is no terminal."""


@dataclass(frozen=True, slots=True)
class Reading:
    """How every recording is read and judged. Travels to other processes."""

    fps: float | None
    detectors: str | None
    overrides: tuple[str, ...]

    def plan(self, path: str) -> Plan:
        """Raises InputError."""
        options = RecordingOptions(fps=self.fps)
        return recording_plan([path], options, detectors=self.detectors, overrides=self.overrides)


@click.command()
@click.argument("path", nargs=-1, required=True)
@click.option("-o", "--output", metavar="DIR", default="audit", show_default=True, help="Where results are kept.")
@click.option("--segments", metavar="FILE", help=f"Write the segments here, as CSV (default: DIR/{SEGMENTS}).")
@click.option(
    "--jobs", type=click.IntRange(1, 256), default=os.cpu_count() or 1, help="Processes (default: one a core)."
)
@click.option("--cluster", "address", metavar="ADDRESS", help="Judge on the Dask cluster whose scheduler is there.")
@click.option("--retry-broken", is_flag=True, help="Judge again what was broken before.")
@click.option("--fps", type=float, help="Frame rate of recordings without timestamps (30 if unknown).")
@click.option("--detectors", metavar="A,B", help="Which detectors judge.")
@set_option
def audit(
    path: tuple[str, ...],
    output: str,
    segments: str | None,
    jobs: int,
    address: str | None,
    retry_broken: bool,
    fps: float | None,
    detectors: str | None,
    overrides: tuple[str, ...],
) -> int:
    """Judge every recording found at PATH and below, every frame of it.

    What is done is kept in DIR and not done again: the same command goes on where it was interrupted. With --cluster,
    PATH may be a URL.

    Exit status 0: all are in sync. 3: something is out of sync. 4: nothing is, but something cannot be told or is
    broken. 2: nothing was found.
    """
    reading = Reading(fps, detectors, overrides)
    settings = settings_fingerprint(reading.plan)
    _check_paths(path, address)
    target = None if segments is None else output_file("--segments", segments, path)
    folder = Path(output)
    check_folder(folder)
    with _signals() as received, ExitStack() as opened:
        judges = _judges(reading, jobs, None if address is None else opened.enter_context(cluster(address)))
        tasks = _tasks(path, settings, os.path.realpath(folder), lambda: bool(received))
        if not received:
            _check_found(path, tasks)
        kept = opened.enter_context(journal(folder))
        todo = [task for task in tasks if not _is_done(task, kept, retry_broken=retry_broken)]
        click.echo(f"{len(tasks)} found, {len(tasks) - len(todo)} of them judged before", err=True)
        tell = partial(_tell, tasks, kept, target or folder / SEGMENTS, folder / SUMMARY)
        try:
            if not received:
                _judge(todo, judges, _Judged(kept, len(tasks), todo), lambda: bool(received))
        except RunError:
            tell()
            raise
        status = tell()
    if received:
        click.echo("syncwatch: interrupted: the same command goes on from here", err=True)
        return 128 + received[0]
    return status


def _judges(reading: Reading, jobs: int, client: Client | None) -> Judges:
    """Judges here, or where the client leads to."""
    if client is None:
        return lambda tasks, stopped: judge_here(tasks, reading.plan, jobs, stopped)
    return lambda tasks, stopped: judge_there(client, tasks, reading.plan, stopped)


def _check_paths(paths: Sequence[str], address: str | None) -> None:
    for path in paths:
        if is_url(path) and address is None:
            raise InputError(f"{path}: a URL is read by the workers of a cluster alone: give --cluster ADDRESS")
        if not is_url(path) and not Path(path).exists():
            raise InputError(f"no such file or folder: {path}")


@contextmanager
def _signals() -> Iterator[list[int]]:
    """SIGINT and SIGTERM are noted, so that nothing is half written; a second one of them ends the program."""
    received: list[int] = []

    def handle(number: int, _: FrameType | None) -> None:
        received.append(number)
        if len(received) > 1:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield received
    finally:
        for number, action in before.items():
            signal.signal(number, action)


def _tasks(paths: Sequence[str], settings: str, skip: str, stopped: Callable[[], bool]) -> list[Task]:
    """Everything there is to judge, in natural order."""
    tasks: dict[str, Task] = {}
    console = Console(stderr=True)
    with console.status("looking for recordings", spinner="dots") as status:
        for task in _found(paths, settings, skip):
            tasks[task.path] = task
            status.update(f"looking for recordings: {len(tasks)} found")
            if stopped():
                break
    return sorted(tasks.values(), key=lambda task: natural(task.path))


def _found(paths: Sequence[str], settings: str, skip: str) -> Iterator[Task]:
    for url in filter(is_url, paths):
        yield from tasks_at(url, settings)
    roots = [Path(os.path.abspath(path)) for path in paths if not is_url(path)]  # noqa: PTH100 - links stay links
    for found in find(roots, {skip}):
        facts = list(file_facts(found.path, {skip}))
        sizes = [(str(found.path / name), size) for name, size, _ in facts]
        yield Task(str(found.path), found.format, fingerprint(facts), settings, effort(sizes), found.trouble)


def _check_found(paths: Sequence[str], tasks: Sequence[Task]) -> None:
    """Raises InputError where there is no recording at all."""
    if any(task.format is not None or is_url(task.path) for task in tasks):
        return
    if not tasks and len(paths) == 1 and not is_url(paths[0]):
        recognise([Path(paths[0])])
    told = f": {tasks[0].path}: {tasks[0].trouble}" if tasks else ""
    more = f", and {len(tasks) - 1} more like it" if len(tasks) > 1 else ""
    raise InputError(f"no recording of two or more cameras in {', '.join(paths)}{told}{more}")


def _is_done(task: Task, kept: Journal, *, retry_broken: bool) -> bool:
    record = kept.records.get(task.path)
    if record is None or (retry_broken and record.error is not None):
        return False
    return task.is_told_by(record)


class _Judged:
    """Keeps every result, and says how far the audit has come. tasks: those that are not done yet, of `total`."""

    def __init__(self, kept: Journal, total: int, tasks: Sequence[Task]) -> None:
        self._kept = kept
        self._total = total
        self._done = total - len(tasks)
        self._effort, self._whole = 0, max(sum(task.effort for task in tasks), 1)
        self._begun_s = time.monotonic()
        self._console = Console(stderr=True)

    @contextmanager
    def shown(self) -> Iterator[None]:
        """As a bar on a terminal, else as a line a recording; always on standard error."""
        columns = (*Progress.get_default_columns(), TimeElapsedColumn())
        self._progress = Progress(
            *columns, console=self._console, transient=True, disable=not self._console.is_terminal
        )
        with self._progress:
            self._bar = self._progress.add_task(self._count, total=self._whole)
            yield

    @property
    def _count(self) -> str:
        return f"{self._done}/{self._total}"

    def add(self, task: Task, record: AuditShape) -> None:
        self._kept.add(record)
        self._done += 1
        self._effort += task.effort
        line = f"{printable(record.path)}: {said(record)}"
        if self._progress.disable:
            click.echo(f"{self._count} {line}{self._left}", err=True)
            return
        self._console.print(line, markup=False, highlight=False, soft_wrap=True)
        self._progress.update(self._bar, completed=self._effort, description=self._count)

    @property
    def _left(self) -> str:
        """About how long it will take yet, by the sizes of what is left."""
        left = self._whole - self._effort
        if left <= 0 or self._effort == 0:
            return ""
        seconds = (time.monotonic() - self._begun_s) * left / self._effort
        return f", about {seconds:.0f} s left" if seconds < 100 else f", about {seconds / 60:.0f} min left"


def _judge(tasks: Sequence[Task], judges: Judges, judged: _Judged, stopped: Callable[[], bool]) -> None:
    hopeless = [task for task in tasks if task.trouble is not None and not is_url(task.path)]
    others = [task for task in tasks if task not in hopeless]
    with judged.shown(), closing(judges(others, stopped)) as running:
        for task in hopeless:
            judged.add(task, task.record())
        for task, record in running:
            judged.add(task, record)


def _tell(tasks: Sequence[Task], kept: Journal, segments: Path, summary: Path) -> int:
    """Prints and writes what is known of the tasks. Returns the exit status they come to."""
    records = [kept.records[task.path] for task in tasks if task.path in kept.records]
    plain = StringIO()
    try:
        with segments.open("w", encoding="utf-8", errors="surrogateescape", newline="") as file:
            write_segments(file, records)
        Console(file=plain, width=TABLE_WIDTH, highlight=False, emoji=False).print(table(records, TABLE_WIDTH))
        summary.write_text(f"{plain.getvalue()}{headline(records)}.\n", encoding="utf-8")
    except OSError as error:
        raise RunError(f"{error.filename}: cannot be written: {error.strerror}") from None
    console = Console(highlight=False, emoji=False)
    if not console.is_terminal:
        console.width = TABLE_WIDTH
    console.print(table(records, console.width))
    for line in reasons(records, console.width):
        click.echo(line)
    click.echo(f"{headline(records)}. Segments: {printable(str(segments))}")
    states = {record.state for record in records}
    if State.ASYNC in states:
        return OUT_OF_SYNC
    return DONE if states == {State.SYNC} else CANNOT_TELL
