"""The command line: what there is, and how errors become one line and an exit status."""

from __future__ import annotations

import logging
import os
import sys

import click

from pipeline.assemble import version
from pipeline.cli.audit import audit
from pipeline.cli.cameras import cameras
from pipeline.cli.check import check
from pipeline.cli.common import BAD_INPUT, FAILED, report, set_up_logging
from pipeline.cli.configure import init, schema, validate
from pipeline.cli.dashboard import dashboard
from pipeline.cli.evaluate import evaluate
from pipeline.cli.events import events
from pipeline.cli.record import record
from pipeline.cli.repair import repair
from pipeline.cli.replay import replay
from pipeline.cli.report import report as report_command
from pipeline.cli.run import run
from pipeline.cli.selftest import selftest
from pipeline.cli.watch import watch
from pipeline.errors import SyncwatchError

INTERRUPTED = 130

log = logging.getLogger("syncwatch.cli")


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(version(), prog_name="syncwatch", message="%(prog)s %(version)s")
@click.option("-v", "--verbose", is_flag=True, help="Say more on stderr, tracebacks included.")
def app(verbose: bool) -> None:
    """Were the frames of a stereo or multi-camera rig really taken at the same moment?

    Exit status: 0 done or in sync, 1 failed while running, 2 bad configuration, arguments or input, 3 out of sync,
    4 cannot tell, 130 interrupted, 143 terminated.
    """
    set_up_logging(verbose=verbose)


for command in (
    run,
    replay,
    check,
    audit,
    record,
    repair,
    evaluate,
    validate,
    init,
    schema,
    selftest,
    report_command,
    dashboard,
    watch,
    events,
    cameras,
):
    app.add_command(command)


def main() -> int:
    """Runs one command; every failure is one line on stderr and an exit status."""
    try:
        status = app.main(standalone_mode=False)
        sys.stdout.flush()
        return status if isinstance(status, int) else 0
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        return BAD_INPUT
    except click.ClickException as error:
        where = (
            f" {error.ctx.command_path.partition(' ')[2]}" if isinstance(error, click.UsageError) and error.ctx else ""
        )
        click.echo(f"syncwatch{where.rstrip()}: error: {error.format_message()}", err=True)
        return BAD_INPUT
    except SyncwatchError as error:
        return report(error)
    except (click.Abort, KeyboardInterrupt):
        return INTERRUPTED
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except Exception as error:
        log.debug("not foreseen", exc_info=error)
        click.echo(f"syncwatch: error: {type(error).__name__}: {error} (syncwatch -v says more)", err=True)
        return FAILED
