"""Judges recordings on a Dask cluster that is running already."""

from __future__ import annotations

import asyncio
import logging
import re
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from pipeline.assemble import version
from pipeline.audit.remote import judge_copy
from pipeline.audit.task import MakePlan, Task
from pipeline.errors import InputError, RunError
from pipeline.messages import AuditShape

if TYPE_CHECKING:
    from distributed import Client, Future

REACH_S = 5
"""Seconds within which scheduler and workers must answer."""

ALONE_S = 60
"""Seconds for which a scheduler may be without workers, or silent, before it is given up."""

POLL_S = 0.2

ADDRESS = re.compile(r"(?:(?:tcp|tls|wss?|ucx)://)?(?:\[[0-9a-fA-F:.]+\]|[^\s/:\[\]]+):([0-9]{1,5})")
LAST_PORT = 65535

TIMEOUTS = (TimeoutError, asyncio.TimeoutError)
"""The same from Python 3.11 on."""


@contextmanager
def cluster(address: str) -> Iterator[Client]:
    """The cluster whose scheduler is at `address`. Raises InputError where there is none that can be used."""
    try:
        from distributed import Client  # noqa: PLC0415 - of the extra `cluster`, which others do without
    except ImportError:
        raise InputError(
            "--cluster: Dask is not installed here: pip install 'syncwatch[cluster]', here and on every worker"
        ) from None
    match = ADDRESS.fullmatch(address)
    if match is None or not 0 < int(match[1]) <= LAST_PORT:
        raise InputError(f"--cluster '{address}': expected the address of a scheduler, such as tcp://scheduler:8786")
    _silence()
    try:
        client = Client(address, timeout=REACH_S, set_as_default=False)
    except (OSError, *TIMEOUTS) as error:
        said = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"--cluster {address}: no scheduler answers there within {REACH_S} s ({said})") from None
    try:
        _check(client, address)
        yield client
    finally:
        client.close(timeout=REACH_S)


def _silence() -> None:
    """What Dask has to say of a cluster that fails is said here, in one line."""
    for name in list(logging.root.manager.loggerDict):
        if name.partition(".")[0] in {"distributed", "tornado", "asyncio"}:
            logging.getLogger(name).setLevel(logging.CRITICAL)


def _check(client: Client, address: str) -> None:
    """Raises InputError where no worker could judge as this program does."""
    try:
        client.wait_for_workers(1, timeout=REACH_S)
    except TIMEOUTS:
        raise InputError(f"--cluster {address}: no worker within {REACH_S} s: start some with dask worker") from None
    for worker, told in client.run(version, on_error="return").items():
        if isinstance(told, Exception):
            raise InputError(f"--cluster {address}: syncwatch is not installed on worker {worker} ({told})")
        if told != version():
            raise InputError(f"--cluster {address}: worker {worker} has syncwatch {told}, and this is {version()}")


def judge_there(
    client: Client, tasks: Sequence[Task], make_plan: MakePlan, stopped: Callable[[], bool]
) -> Generator[tuple[Task, AuditShape], None, None]:
    """Each task and what is said of it, as they get done; ends early when `stopped` is true.

    A recording whose worker is lost is given to another one; one that loses worker after worker is told to be broken.
    Raises RunError when the scheduler is lost.
    """
    running = {client.submit(_on_worker, task, make_plan, pure=False): task for task in tasks}
    patience = _Patience(client)
    try:
        while running and not stopped():
            done = [future for future in running if future.done()]
            if not done:
                patience.check()
                time.sleep(POLL_S)
            for future in done:
                record = _result(future, running[future])
                if record is not None:
                    yield running.pop(future), record
    finally:
        client.cancel(list(running), force=True)


def _on_worker(task: Task, make_plan: MakePlan) -> AuditShape:
    from distributed import get_worker  # noqa: PLC0415 - as above

    return judge_copy(task, make_plan, get_worker().local_directory)


def _result(future: Future[AuditShape], task: Task) -> AuditShape | None:
    """None where the worker that had it is lost meanwhile, so that it is judged again. Raises RunError."""
    if future.status in {"cancelled", "lost"}:
        raise RunError("--cluster: the scheduler was lost: what is done is kept, run the same command again")
    if future.status == "error":
        return task.record(error=f"it could not be judged on the cluster: {_told(future.exception())}")
    try:
        record: AuditShape = future.result(timeout=REACH_S)
    except TIMEOUTS:
        return None
    return record


def _told(error: Any) -> str:
    if type(error).__name__ == "KilledWorker":
        return "worker after worker was killed or crashed over it: too little memory, or a damaged file"
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


class _Patience:
    """Gives up a scheduler that is silent, or has no worker, for too long."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._well_s = time.monotonic()

    def check(self) -> None:
        """Raises RunError."""
        now_s = time.monotonic()
        if self._client.status == "running" and self._client.scheduler_info(n_workers=-1)["workers"]:
            self._well_s = now_s
        elif now_s - self._well_s > ALONE_S:
            raise RunError(
                f"--cluster: no worker for {ALONE_S} s: what is done is kept, run the same command when there are some"
            )
