"""Watches a rig whose frames the calling program takes itself."""

from __future__ import annotations

import json
import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, TypeAlias

import yaml

from pipeline.assemble import KINDS, assemble, build_source
from pipeline.configtext.document import Document, load_file, load_text
from pipeline.errors import InputError, RunError, SyncwatchError
from pipeline.frame import Picture, Source, StampReference
from pipeline.plan import Plan, make_plan
from pipeline.queues import BoundedQueue, QueueClosedError
from pipeline.run import Run
from pipeline.verdict import Event, Report, Status, Verdict
from sources.push import PushSource

log = logging.getLogger("syncwatch.monitor")

Config: TypeAlias = Mapping[str, Any] | str | os.PathLike[str]

VERDICTS_AHEAD = 1000
"""Verdicts that may wait to be iterated: half a minute of a stereo rig at 30 fps."""

DRAIN_S = 2.0
"""How long `close` lets frames that were pushed be judged."""

END_WITHIN_S = 30.0
"""How long `close` waits for sinks that hang, which the run gives up after a third of that."""


class Monitor:
    """A running pipeline that is fed by `push`.

    ::

        with Monitor(cameras={"left": 30, "right": 30}, on_event=lambda event: print(event.text)) as monitor:
            while True:
                ...
                monitor.push("left", picture, captured_ns=stamp)

    config: a mapping, or the path of a configuration file; None: the default detectors and no sinks. Its `source` must
    be of type `push` unless `cameras` are given: these take its place. cameras: frame rates in Hz by name, in order.
    overrides: as `--set` on the command line, e.g. `judge.sync_tolerance_ms=2`.
    on_verdict, on_event, on_status: called on a thread of their own, in order; one that is slow loses the oldest
    verdicts, one that raises ends the monitor. Whoever has no `on_verdict` iterates: see `verdicts`.

    It runs from its construction to `close`, which the end of a `with` calls. Its threads do not keep a program from
    ending. Raises InputError for a configuration that cannot be used.
    """

    def __init__(
        self,
        config: Config | None = None,
        cameras: Mapping[str, float] | None = None,
        *,
        overrides: Sequence[str] = (),
        on_verdict: Callable[[Verdict], None] | None = None,
        on_event: Callable[[Event], None] | None = None,
        on_status: Callable[[Status], None] | None = None,
        verdicts_ahead: int = VERDICTS_AHEAD,
    ) -> None:
        plan = _plan(config, cameras, overrides)
        self._verdicts: BoundedQueue[Verdict] = BoundedQueue(verdicts_ahead, wait=False)
        self._teller = _Teller(on_verdict or self._keep, on_event, on_status)
        self._status: Status | None = None
        self._failure: SyncwatchError | None = None
        source = build_source(plan, wrap=self._find_push)
        source.open()
        try:
            parts = assemble(plan, source, console=sys.stdout, on_report=self._note)
        except BaseException:
            source.close()
            raise
        parts.sinks = {**parts.sinks, "monitor": self._teller}
        self._run = Run(parts)
        self._thread = threading.Thread(target=self._execute, name="syncwatch-monitor", daemon=True)
        self._thread.start()

    def push(
        self,
        camera: str,
        image: Picture,
        captured_ns: int | None = None,
        sequence: int | None = None,
        exposure_ns: int | None = None,
        *,
        clock: str = "rig",
        epoch: int = 0,
        stamp_reference: StampReference = StampReference.UNKNOWN,
        copy: bool = True,
    ) -> bool:
        """Hands over a picture, from any thread, without waiting: when too many wait, the camera's oldest gives way.

        image: H x W or H x W x 3 (blue, green, red), uint8. captured_ns: the camera's stamp; None if there is none:
        arrival is noted, and stamps prove nothing. clock: names the clock of the stamps; cameras of one name are
        compared directly. epoch: is to rise when the camera or its clock restarts. copy: False hands the array over:
        nobody may write to it any more.

        Whether the frame was accepted: not after `close` or a failure. Raises InputError for a camera or a picture that
        cannot be.
        """
        return self._source.push(
            camera,
            image,
            captured_ns=captured_ns,
            sequence=sequence,
            exposure_ns=exposure_ns,
            clock=clock,
            epoch=epoch,
            stamp_reference=stamp_reference,
            copy=copy,
        )

    def verdicts(self, timeout_s: float | None = None) -> Iterator[Verdict]:
        """Verdicts as they come, until the monitor is closed, or none comes for `timeout_s` (0: those there are).

        The latest `verdicts_ahead` wait to be taken; older ones give way.
        """
        while True:
            try:
                yield self._verdicts.get(timeout_s)
            except (TimeoutError, QueueClosedError):
                return

    def __iter__(self) -> Iterator[Verdict]:
        return self.verdicts()

    @property
    def status(self) -> Status | None:
        """The state of the rig, a second old at most; None before the first."""
        return self._status

    @property
    def dropped(self) -> Mapping[str, int]:
        """Frames that were pushed faster than they could be taken, by camera."""
        return self._source.dropped

    @property
    def failure(self) -> SyncwatchError | None:
        """What has ended the monitor, if anything did."""
        return self._failure

    def close(self) -> None:
        """Has what was pushed judged and told, then ends. May be called again.

        From a callback it only asks for the end. Raises what had ended the monitor: RunError, InputError.
        """
        self._source.finish()
        if threading.get_ident() == self._teller.thread:
            return
        self._thread.join(DRAIN_S)
        self._run.stop()
        self._thread.join(END_WITHIN_S)
        if self._thread.is_alive():
            raise RunError(f"the monitor did not end within {END_WITHIN_S:.0f} s")
        if self._failure is not None:
            raise self._failure

    def __enter__(self) -> Monitor:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except SyncwatchError:
            if error is None:
                raise

    def _find_push(self, source: Source) -> Source:
        found = [one for one in getattr(source, "sources", (source,)) if isinstance(one, PushSource)]
        if len(found) != 1:
            raise InputError(
                f"a monitor needs one source of type push, not {len(found)}: give cameras={{'left': 30, 'right': 30}}, "
                "or a source of type push with these in the configuration"
            )
        self._source = found[0]
        self._source.attach()
        return source

    def _execute(self) -> None:
        try:
            self._run.execute()
        except SyncwatchError as error:
            self._failure = error
            log.error("the monitor has ended: %s", error)  # noqa: TRY400 - one line, no traceback
        finally:
            self._source.stop()
            self._verdicts.close()

    def _note(self, report: Report) -> None:
        if isinstance(report, Status):
            self._status = report

    def _keep(self, verdict: Verdict) -> None:
        self._verdicts.put(verdict)


class _Teller:
    """A sink that calls what the program gave."""

    lossless = False

    def __init__(
        self,
        on_verdict: Callable[[Verdict], None],
        on_event: Callable[[Event], None] | None,
        on_status: Callable[[Status], None] | None,
    ) -> None:
        self._on_verdict = on_verdict
        self._on_event = on_event
        self._on_status = on_status
        self.thread: int | None = None

    def start(self) -> None:
        self.thread = threading.get_ident()

    def take(self, report: Report) -> None:
        if isinstance(report, Verdict):
            self._on_verdict(report)
        elif isinstance(report, Event) and self._on_event is not None:
            self._on_event(report)
        elif isinstance(report, Status) and self._on_status is not None:
            self._on_status(report)

    def stop(self) -> None:
        self.thread = None


def _plan(config: Config | None, cameras: Mapping[str, float] | None, overrides: Sequence[str]) -> Plan:
    """Raises InputError."""
    source = None if cameras is None else {"type": "push", "cameras": dict(cameras)}
    if config is None or isinstance(config, Mapping):
        data = {"detectors": {"timestamp": {}, "offset": {}}, **(config or {})}
        if source is not None:
            data["source"] = source
        return make_plan(_document(data, overrides), KINDS, Path.cwd())
    given = [] if source is None else [f"source={json.dumps(source)}"]
    document = load_file(config, os.environ, [*given, *overrides])
    return make_plan(document, KINDS, Path(config).resolve().parent)


def _document(data: Mapping[str, Any], overrides: Sequence[str]) -> Document:
    try:
        text = yaml.safe_dump(dict(data), sort_keys=False).replace("${", "$${")
    except yaml.YAMLError as error:
        raise InputError(f"the configuration holds what YAML cannot: {' '.join(str(error).split())}") from None
    return load_text(text, "Monitor", os.environ, overrides, quoted=False)
