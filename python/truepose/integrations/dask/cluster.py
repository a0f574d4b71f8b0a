"""Monte Carlo studies on the workers of a dask cluster."""

import contextlib
import functools
import pickle
from collections.abc import Iterator
from typing import Any

from truepose.exceptions import InputError
from truepose.plugins import package
from truepose.studies.workers import Asked, Submit, timed, versions

#: Timeout of the connection to a cluster, s.
PATIENCE = 10


@contextlib.contextmanager
def executor(cluster: Any, asked: Asked, retries: int) -> Iterator[tuple[Submit, int]]:
    """Yield a function that submits a task to a dask cluster, and the number of its threads.

    Workers must have the local versions. `asked` is sent once, as the result of a task: a worker
    gets it from another one, and it is sent again if all that have it are lost.
    """
    missing = "study: dask is not installed; pip install distributed pyarrow"
    Client = package("distributed", missing).Client
    with contextlib.ExitStack() as stack:
        client = cluster
        if not isinstance(cluster, Client):
            try:
                client = Client(cluster, timeout=PATIENCE, set_as_default=False)
            except (OSError, TimeoutError, ValueError) as error:
                why = f"no scheduler responds there ({error})"
                raise InputError(f"--cluster {cluster}: {why}") from None
            stack.enter_context(client)
        require_same(client)
        # Bytes: a worker that cannot load them raises an error in a task.
        data = package("cloudpickle", missing).dumps(asked)
        there = client.submit(_same, data, pure=False, retries=retries)
        own = client.get_executor(pure=False, retries=retries)
        yield functools.partial(own.submit, _timed, there), sum(client.nthreads().values())


def _same(data: bytes) -> bytes:
    return data


def _timed(data: bytes, start: int, stop: int) -> tuple[list[Any], float]:
    return timed(_loaded(data), start, stop)


@functools.lru_cache(1)
def _loaded(data: bytes) -> Asked:
    asked: Asked = pickle.loads(data)
    return asked


def require_same(client: Any) -> None:
    """Raise InputError if a worker has another version of truepose, numpy or Python."""
    here = versions()
    try:
        there = client.run(versions)
    except Exception as error:  # a worker without truepose cannot unpickle the call
        raise InputError(
            f"--cluster: a worker has no truepose {here['truepose']}: {error}"
        ) from None
    if not there:
        raise InputError("--cluster: the scheduler has no workers; start some: dask worker ADDRESS")
    for worker, found in there.items():
        for name, version in here.items():
            if found[name] != version:
                raise InputError(
                    f"--cluster: worker {worker} has {name} {found[name]}, here is {version}"
                )
