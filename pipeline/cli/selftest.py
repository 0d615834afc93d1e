"""`syncwatch selftest`: can the detector be believed on this footage?"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import click
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress as Bar
from rich.table import Table

from pipeline.cli.common import CANNOT_TELL, DONE, OUT_OF_SYNC, seconds, set_option
from pipeline.cli.footage import Footage, is_live, take
from pipeline.cli.output import output_file, write_output
from pipeline.cli.recording import FOR_RECORDING, RecordingOptions, recording_options
from pipeline.errors import InputError
from pipeline.selftest.findings import Outcome
from pipeline.selftest.proof import Conclusion, Proof, prove
from pipeline.selftest.trials import Progress

STATUS = {Conclusion.PROVED: DONE, Conclusion.CONTRADICTED: OUT_OF_SYNC, Conclusion.NOT_PROVED: CANNOT_TELL}
COLOUR = {Outcome.PASSED: "green", Outcome.FAILED: "bold red", Outcome.NOT_SHOWN: "yellow"}
SAID = {Outcome.PASSED: "pass", Outcome.FAILED: "FAIL", Outcome.NOT_SHOWN: "not shown"}


FOR_S = 10.0
"""How long a live rig is recorded: moved up and down a few times."""


@click.command()
@click.argument("path", nargs=-1, required=True)
@recording_options
@click.option("--for", "duration", metavar="TIME", help="Of a live rig: move it for this long (default: 10s).")
@click.option("--json", "json_file", metavar="FILE", help="Write every number as JSON; - is standard output.")
@click.option(
    "--jobs", type=click.IntRange(1, 256), default=os.cpu_count() or 1, help="Processes (default: one a core)."
)
@set_option
def selftest(
    path: tuple[str, ...],
    options: RecordingOptions,
    duration: str | None,
    json_file: str | None,
    jobs: int,
    overrides: tuple[str, ...],
) -> int:
    """Prove the offset detector on your own footage, without ground truth.

    The recording at PATH, or the source of a configuration, is judged as it is, with its pictures moved by known
    numbers of frames, with its cameras swapped, with a slip put in, and by halves of its points: do all these agree?
    A live rig is recorded first, for ten seconds, while you move it up and down.

    Exit status 0: they do. 3: they contradict each other. 4: the footage shows too little to prove anything.
    """
    target = None if json_file in {None, "-"} else output_file("--json", str(json_file), path)
    footage = Footage(path, options, overrides)
    plan = footage.plan()
    with TemporaryDirectory(prefix="syncwatch-selftest-") as folder:
        if is_live(plan):
            taken = Path(folder) / "rig.mcap"
            interrupted = take(plan, taken, FOR_S if duration is None else seconds(duration), _ask)
            if interrupted:
                return interrupted
            footage = replace(footage, taken=taken)
        elif duration is not None:
            raise InputError(FOR_RECORDING)
        with _progress() as progress:
            proof = prove(footage.plan, jobs, progress)
    if target is not None:
        write_output("--json", target, _json(proof) + "\n")
    if json_file == "-":
        click.echo(_json(proof))
    else:
        show(proof, Console(highlight=False, emoji=False))
    return STATUS[proof.conclusion]


def _ask() -> None:
    click.echo("syncwatch: move the rig up and down now", err=True)


def _json(proof: Proof) -> str:
    return json.dumps(proof.to_json(), indent=1)


@contextmanager
def _progress() -> Iterator[Progress]:
    """A bar on a terminal, else a line for each thing that is begun; always on standard error."""
    console = Console(stderr=True)
    with Bar(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("")
        begun: set[str] = set()

        def say(what: str, done: int, total: int | None) -> None:
            if what not in begun and not console.is_terminal:
                click.echo(f"syncwatch: running the footage: {what}", err=True)
            begun.add(what)
            bar.update(task, description=what, completed=done, total=total)

        yield say


def show(proof: Proof, console: Console) -> None:
    """Prints a table of tests for each pair and loop, then what they come to, for people."""
    subjects = dict.fromkeys(finding.subject for finding in proof.findings)
    for subject in subjects:
        console.print(table(proof, subject, titled=len(subjects) > 1))
    for item in proof.summaries:
        console.print(f"{escape(proof.rig)}: {item.pair}: {escape(item.sentences(proof.period_ms))}")
    console.print(f"{escape(proof.rig)}: {headline(proof)}")


def headline(proof: Proof) -> str:
    """What all tests together come to, with markup."""
    failed, shown, missing = len(proof.failed), len(proof.shown), proof.without_proof
    if proof.conclusion is Conclusion.PROVED:
        return f"[bold green]PASSED.[/] In all {shown} tests that could be shown, the detector agrees with itself."
    if proof.conclusion is Conclusion.CONTRADICTED:
        return (
            f"[bold red]FAILED.[/] In {failed} of {shown} tests the detector contradicts itself: "
            "do not rely on it on this footage."
        )
    where = "" if len(missing) == len(proof.summaries) else f" about {', '.join(missing)}"
    return (
        f"[bold yellow]NOTHING CAN BE PROVED HERE{where}.[/] Too little could be decided to test the detector. "
        "Record the rig while it moves, or something that moves before it."
    )


def table(proof: Proof, subject: str, *, titled: bool) -> Table:
    """A row a test of one pair or loop."""
    made = Table("test", "result", "numbers", box=box.SIMPLE_HEAD, title=subject if titled else None)
    for finding in proof.findings:
        if finding.subject == subject:
            result = f"[{COLOUR[finding.outcome]}]{SAID[finding.outcome]}[/]"
            made.add_row(finding.test, result, escape(finding.text))
    return made
