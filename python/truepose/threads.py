"""Parallel maps over threads."""

import os
from collections.abc import Callable, Iterable, Iterator

from truepose import _core


def cores() -> int:
    """Return the number of cores that this process may use (taskset limits it)."""
    on_linux = hasattr(os, "sched_getaffinity")
    return len(os.sched_getaffinity(0)) if on_linux else os.cpu_count() or 1


def each(
    work: Callable,
    items: Iterable,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Iterator:
    """Yield work(item) in the order of the items, computed on all cores.

    `progress` is called with the numbers of finished and of all items after each.

    Threads suffice because the core releases the interpreter's lock. The waiting thread receives
    signals; on Ctrl-C it stops the core's loops in the others and drops items not yet started.
    """
    from concurrent.futures import ThreadPoolExecutor  # takes a tenth of numpy's import

    pool = ThreadPoolExecutor(cores())
    stopping = 0
    try:
        futures = [pool.submit(work, item) for item in items]
        for done, future in enumerate(futures, 1):
            result = future.result()
            progress(done, len(futures))
            yield result
    except KeyboardInterrupt:
        stopping = 1
        raise
    finally:
        _core.stop(stopping)
        pool.shutdown(cancel_futures=True)
        _core.stop(-stopping)
