"""Workers of a study: processes or threads here, or a cluster."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import platform
import signal
import threading
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from truepose.arguments import whole
from truepose.exceptions import InputError, choose
from truepose.plugins import plugins

On = Literal["processes", "threads"]
#: Deaths of workers in a row, without progress, that end a study.
DEATHS = 3


def versions() -> dict[str, str]:
    """Return the versions that determine a worker's numbers."""
    from importlib.metadata import version

    python = ".".join(platform.python_version_tuple()[:2])
    return {"truepose": version("truepose"), "numpy": np.__version__, "Python": python}


def _begin() -> None:
    """Prepare a worker process: it ignores Ctrl-C and ends with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for number in (signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
        signal.signal(number, signal.SIG_DFL)  # a fork has its parent's handlers

    def end_with(parent: Any) -> None:
        parent.join()
        os._exit(1)

    parent = multiprocessing.parent_process()
    threading.Thread(target=end_with, args=(parent,), daemon=True).start()


@dataclass
class Workers:
    """Runner of tasks; a task lost with its worker runs again."""

    count: int
    on: On = "processes"
    cluster: Any = None  #: address of a dask scheduler, or a dask cluster or client

    def __post_init__(self) -> None:
        if self.on not in (known := get_args(On)):
            raise InputError(choose("on", self.on, known))
        whole("workers", self.count, 0)

    def each(
        self, function: Callable[..., Any], tasks: dict[Any, tuple[Any, ...]]
    ) -> Generator[tuple[Any, Any], None, None]:
        """Yield key and function(*task) of every task as it finishes; closing ends the workers."""
        if self.cluster is None and (self.count == 0 or len(tasks) < 2):
            yield from ((key, function(*task)) for key, task in tasks.items())
            return
        left, deaths = dict(tasks), 0
        while left:
            before = len(left)
            with self._executor() as executor:
                futures = {executor.submit(function, *task): key for key, task in left.items()}
                try:
                    for future in as_completed(futures):
                        yield futures[future], future.result()
                        del left[futures[future]]
                except BrokenProcessPool:
                    deaths = deaths + 1 if len(left) == before else 0
                    if deaths == DEATHS:
                        raise InputError(
                            f"study: a worker died {DEATHS} times with nothing done (memory?)"
                        ) from None

    @contextlib.contextmanager
    def _executor(self) -> Iterator[Executor]:
        if self.cluster is not None:
            connect = plugins("clusters")["dask"].load()
            with connect(self.cluster, retries=DEATHS) as there:
                yield there
            return
        processes = self.on == "processes"
        kind: Any = ProcessPoolExecutor if processes else ThreadPoolExecutor
        executor: Executor = kind(self.count, initializer=_begin if processes else None)
        try:
            yield executor
        except BaseException:  # Ctrl-C or a failed case: wait for no other
            for process in list((getattr(executor, "_processes", None) or {}).values()):
                process.terminate()
            raise
        finally:
            executor.shutdown(cancel_futures=True)
