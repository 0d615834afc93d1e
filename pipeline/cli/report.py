"""`syncwatch report`: one page about a recording."""

from __future__ import annotations

import json
from dataclasses import replace

import click

from pipeline.answer import OF_PART, Answer, answer
from pipeline.assemble import version
from pipeline.cli.common import DONE, execute, set_option
from pipeline.cli.output import output_file, write_output
from pipeline.cli.recording import RecordingOptions, duration_of_rig, plan_of, recording_options
from pipeline.errors import InputError
from pipeline.frame import Rig
from pipeline.report.numbers import to_message
from pipeline.report.recorder import Recorder

OUTPUT, JSON = "-o", "--json"


@click.command()
@click.argument("path", nargs=-1, required=True)
@click.option(OUTPUT, "--output", metavar="FILE", default="report.html", show_default=True, help="The page to write.")
@click.option(JSON, "json_file", metavar="FILE", help="Write the same numbers as JSON; - is standard output.")
@click.option(
    "--for", "duration", metavar="TIME", help="Watch a live rig for this long, e.g. 10s (default: to the end)."
)
@recording_options
@set_option
def report(
    path: tuple[str, ...],
    output: str,
    json_file: str | None,
    duration: str | None,
    options: RecordingOptions,
    overrides: tuple[str, ...],
) -> int:
    """Write a page about the recording, or the rig of the configuration, at PATH: what is wrong, and what to do.

    The page is one file that needs nothing else. Exit status 0: it was written, whatever it says. 2: the recording
    cannot be read, or not to its end; the page is then of the part before.
    """
    page_file = output_file(OUTPUT, output, path)
    numbers_file = None if json_file in {None, "-"} else output_file(JSON, str(json_file), path)
    if numbers_file is not None and numbers_file.resolve() == page_file.resolve():
        raise InputError(f"{JSON} {numbers_file}: cannot be written: the page goes there: name another file")
    stop_after_s = duration_of_rig(duration, path)
    plan = plan_of(path, options, sinks={"console": {"style": "progress"}}, overrides=overrides)
    made: list[Recorder] = []

    def record(rig: Rig) -> Recorder:
        made.append(Recorder(rig))
        return made[0]

    refused: InputError | None = None
    interrupted = DONE
    try:
        interrupted = execute(plan, watch=record, stop_after_s=stop_after_s)
    except InputError as error:
        if not made or not made[0].tally.pairs:
            raise
        refused = error
    result = answer(made[0].tally)
    if refused is not None:
        result = replace(result, text=result.text + OF_PART)
    unread = None if refused is None else str(refused)
    numbers = json.dumps(to_message(made[0], result, version(), unread), allow_nan=False, indent=1) + "\n"
    write_output(OUTPUT, page_file, _page(made[0], result, path, unread))
    if numbers_file is not None:
        write_output(JSON, numbers_file, numbers)
    if json_file == "-":
        click.echo(numbers, nl=False)
    click.echo(f"{plan.config.rig}: {result.text}\nThe report is in {page_file}", err=json_file == "-")
    if refused is not None:
        raise refused
    return interrupted


def _page(recorder: Recorder, result: Answer, path: tuple[str, ...], unread: str | None) -> str:
    from pipeline.report.page import report_page  # noqa: PLC0415 - drawing takes a second to import, which others save

    return report_page(recorder, result, version(), path, unread)
