"""Where runs are executed: in processes here, on a Dask cluster, or in this process. All are `Executor`s."""

import multiprocessing
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from signal import SIG_IGN, SIGINT, signal
from typing import Any

from knotwork.core.errors import InputError, KnotworkError
from knotwork.plugins.commands.ablate.job import Job, Outcome, execute

_CONNECT = 20.0  # s to find the scheduler
_TICK = 1.0  # s between signs of life


@dataclass(frozen=True, slots=True)
class Engine:
    """An executor, the function to submit to it, and how many runs it takes at a time."""

    executor: Executor
    work: Callable[[Job], Outcome]
    width: int
    name: str


def completed(engine: Engine, jobs: list[Job]) -> Iterator[tuple[Job, Outcome] | None]:
    """Yield each job with its outcome as they end; None now and then while nothing does."""
    waiting = deque(jobs)
    pending: dict[Future[Outcome], Job] = {}
    while waiting or pending:
        while waiting and len(pending) < engine.width:
            job = waiting.popleft()
            pending[engine.executor.submit(engine.work, job)] = job
        done, _ = wait(pending, timeout=_TICK, return_when=FIRST_COMPLETED)
        if not done:
            yield None
        for future in done:
            yield pending.pop(future), _outcome(future)


def _outcome(future: "Future[Outcome]") -> Outcome:
    # Whatever ends one run (a worker that was killed, a plugin the cluster does not have), the others go on.
    try:
        return future.result()
    except Exception as error:  # noqa: BLE001
        text = (str(error).splitlines() or [""])[0]
        return Outcome(f"{type(error).__name__}: {text}".rstrip(": "))


@contextmanager
def processes(jobs: int) -> Iterator[Engine]:
    """Run each in a fresh process, `jobs` at a time, so that its memory is its own and it may die alone."""
    threads = ThreadPoolExecutor(jobs, thread_name_prefix="ablate")
    try:
        yield Engine(threads, _in_a_process, jobs, f"{jobs} local process{'es' if jobs > 1 else ''}")
    except BaseException:
        for child in multiprocessing.active_children():
            child.terminate()
        raise
    finally:
        threads.shutdown(wait=True, cancel_futures=True)


def _in_a_process(job: Job) -> Outcome:
    context = multiprocessing.get_context("spawn")
    try:
        # Ctrl-C reaches the whole group; the parent decides what becomes of the children.
        with ProcessPoolExecutor(1, mp_context=context, initializer=signal, initargs=(SIGINT, SIG_IGN)) as pool:
            return pool.submit(execute, job).result()
    except BrokenProcessPool:
        return Outcome("its process ended without a result (killed, out of memory, or a crash in compiled code)")


class _Here(Executor):
    """Runs what is submitted at once, in this thread."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - as every executor: it belongs to the future
            future.set_exception(error)
        return future


@contextmanager
def in_this_process() -> Iterator[Engine]:
    """Run one after another in this process: for debuggers."""
    yield Engine(_Here(), execute, 1, "this process")


@contextmanager
def dask(address: str) -> Iterator[Engine]:
    """Run on a Dask cluster.

    Raises
    ------
    InputError
        dask.distributed is not installed, or the address is none.
    KnotworkError
        No scheduler answers.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError as error:
        raise InputError("needs dask.distributed", where="--scheduler", hint="pip install 'knotwork[dask]'") from error
    try:
        client = distributed.Client(address, timeout=_CONNECT, set_as_default=False)
    except ValueError as error:
        raise InputError(f"{address!r} is no address: {error}", where="--scheduler", hint="tcp://HOST:8786") from error
    except (OSError, TimeoutError) as error:
        raise KnotworkError(f"no scheduler answers at {address}", where="--scheduler") from error
    with client:
        threads = sum(worker["nthreads"] for worker in client.scheduler_info(n_workers=-1)["workers"].values())
        if not threads:
            raise KnotworkError(f"the scheduler at {address} has no workers", hint=f"dask worker {address}")
        executor = client.get_executor(pure=False, retries=0)
        try:
            yield Engine(executor, execute, 2 * threads, f"Dask at {address}, {threads} threads")
        finally:
            executor.shutdown(wait=False)  # cancels what has not ended
