"""Workers of a study: processes here, or a cluster."""

import contextlib
import functools
import multiprocessing
import os
import platform
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent import futures
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from truepose.arguments import whole
from truepose.exceptions import InputError
from truepose.plugins import plugins

#: Deaths of workers in a row, without progress, that end a study.
DEATHS = 3
#: Aim of the time of a task, s: long beside what it costs to send, short beside a study.
TASK = 1.0
#: Largest ratio of the sizes of a task and of those before it.
GROWTH = 4

#: What all tasks of a study share: asked(start, stop) returns the rows of these cases.
Asked = Callable[[int, int], list[Any]]
Submit = Callable[[int, int], "futures.Future[tuple[list[Any], float]]"]
_shared: list[Asked] = []  #: of this worker process


def versions() -> dict[str, str]:
    """Return the versions that determine a worker's numbers."""
    from importlib.metadata import version

    python = ".".join(platform.python_version_tuple()[:2])
    return {"truepose": version("truepose"), "numpy": np.__version__, "Python": python}


def timed(asked: Asked, start: int, stop: int) -> tuple[list[Any], float]:
    """Return the rows of some cases, and the time that they took, s."""
    begun = time.perf_counter()
    return asked(start, stop), time.perf_counter() - begun


def _timed_here(start: int, stop: int) -> tuple[list[Any], float]:
    return timed(_shared[0], start, stop)


def _begin(asked: Asked) -> None:
    """Prepare a worker process: it ignores Ctrl-C and ends with its parent."""
    _shared[:] = [asked]
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for number in (signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
        signal.signal(number, signal.SIG_DFL)  # a fork has its parent's handlers

    def end_with(parent: Any) -> None:
        parent.join()
        os._exit(1)

    parent = multiprocessing.parent_process()
    threading.Thread(target=end_with, args=(parent,), daemon=True).start()


@dataclass
class Tasks:
    """Ranges of cases yet to ask, cut into tasks whose size follows the time of those before."""

    left: list[tuple[int, int]]  #: start and stop, the next one last
    size: int | None  #: cases of a task; None: by time
    _next: int = field(default=1, init=False)

    def take(self, workers: int) -> tuple[int, int]:
        """Return the next task; at the end of a study they are small, that all workers end."""
        start, stop = self.left.pop()
        rest = stop - start + sum(b - a for a, b in self.left)
        size = self.size or max(1, min(self._next, rest // (2 * workers)))
        if start + size < stop:
            self.left.append((start + size, stop))
        return start, min(start + size, stop)

    def took(self, count: int, seconds: float) -> None:
        """Set the size of the next tasks by the time of one of `count` cases."""
        wanted = TASK * count / max(seconds, 1e-9)
        self._next = max(1, int(min(wanted, GROWTH * max(count, self._next))))


@dataclass
class Workers:
    """Runner of tasks; a task lost with its worker runs again."""

    count: int
    cluster: Any = None  #: address of a dask scheduler, or a dask cluster or client

    def __post_init__(self) -> None:
        whole("workers", self.count, 0)

    def each(
        self, asked: Asked, ranges: Iterable[tuple[int, int]], size: int | None = None
    ) -> Generator[tuple[int, list[Any]], None, None]:
        """Yield start and rows of every task as it finishes; closing ends the workers."""
        tasks = Tasks([*ranges][::-1], size)
        cases = sum(stop - start for start, stop in tasks.left)
        if self.cluster is None and (self.count == 0 or cases < 2):
            while tasks.left:
                start, stop = tasks.take(1)
                rows, seconds = timed(asked, start, stop)
                tasks.took(stop - start, seconds)
                yield start, rows
            return
        deaths = 0
        while tasks.left:
            begun: dict[Any, tuple[int, int]] = {}
            with self._executor(asked) as (submit, workers):
                try:
                    while tasks.left or begun:
                        while tasks.left and len(begun) < 2 * workers:
                            task = tasks.take(workers)
                            begun[submit(*task)] = task
                        done, _ = futures.wait(begun, return_when=futures.FIRST_COMPLETED)
                        for future in done:
                            rows, seconds = future.result()
                            start, stop = begun.pop(future)
                            deaths = 0
                            tasks.took(stop - start, seconds)
                            yield start, rows
                except BrokenProcessPool:
                    tasks.left += begun.values()
                    deaths += 1
                    if deaths == DEATHS:
                        raise InputError(
                            f"study: a worker died {DEATHS} times with nothing done (memory?)"
                        ) from None

    @contextlib.contextmanager
    def _executor(self, asked: Asked) -> Iterator[tuple[Submit, int]]:
        """Yield a function that submits a task, and the number of workers."""
        if self.cluster is not None:
            connect = plugins("clusters")["dask"].load()
            with connect(self.cluster, asked, retries=DEATHS) as there:
                yield there
            return
        executor: Any = futures.ProcessPoolExecutor(
            self.count, initializer=_begin, initargs=(asked,)
        )
        own = functools.partial(executor.submit, _timed_here)
        try:
            yield own, self.count
        except BaseException:  # Ctrl-C or a failed case: wait for no other
            for process in list((executor._processes or {}).values()):
                process.terminate()
            raise
        finally:
            executor.shutdown(cancel_futures=True)
