"""Judges recordings in parallel processes of this machine."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack

from pipeline.audit.judge import judge
from pipeline.audit.task import MakePlan, Task
from pipeline.messages import AuditShape
from pipeline.workers import workers

POLL_S = 0.2
"""How often is asked whether to stop."""

CRASHED = "the process that judged it was killed or crashed: too little memory, or a damaged file"


class _StoppedError(Exception):
    """Leaves the pools in a way that ends what they are at."""


def judge_here(
    tasks: Sequence[Task], make_plan: MakePlan, jobs: int, stopped: Callable[[], bool]
) -> Generator[tuple[Task, AuditShape], None, None]:
    """Each task and what is said of it, as they get done; ends early, and at once, when `stopped` is true.

    Every process is a pool of its own: when it crashes it is known over which recording, and no other one suffers.
    """
    queue = deque(tasks)
    running: dict[Future[AuditShape], tuple[Task, ProcessPoolExecutor]] = {}
    try:
        with ExitStack() as pools:
            idle = [pools.enter_context(workers(1)) for _ in range(min(jobs, len(tasks)))]
            while queue or running:
                while queue and idle:
                    pool = idle.pop()
                    try:
                        future = pool.submit(judge, queue[0], make_plan)
                    except BrokenProcessPool:  # it was killed while it had nothing to do
                        idle.append(pools.enter_context(workers(1)))
                        continue
                    running[future] = queue.popleft(), pool
                done, _ = wait(running, timeout=POLL_S, return_when=FIRST_COMPLETED)
                _leave_if(stopped)
                for future in done:
                    task, pool = running.pop(future)
                    try:
                        record = future.result()
                    except BrokenProcessPool:
                        record, pool = task.record(error=CRASHED), pools.enter_context(workers(1))
                    idle.append(pool)
                    yield task, record
    except _StoppedError:
        return


def _leave_if(stopped: Callable[[], bool]) -> None:
    if stopped():
        raise _StoppedError
