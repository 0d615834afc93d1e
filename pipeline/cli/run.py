"""`syncwatch run`: the main job."""

from __future__ import annotations

import click

from pipeline.cli.common import execute, read_plan, set_option


@click.command()
@click.argument("config", required=False)
@set_option
def run(config: str | None, overrides: tuple[str, ...]) -> int:
    """Run the pipeline of CONFIG until its source ends or Ctrl-C.

    Without CONFIG: config.yaml of this folder, else the shipped one, which renders a rig that slips out of sync.
    """
    return execute(read_plan(config, overrides))
