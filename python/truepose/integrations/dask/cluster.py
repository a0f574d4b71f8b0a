"""Monte Carlo studies on the workers of a dask cluster."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from concurrent.futures import Executor
from typing import Any

from truepose.exceptions import InputError
from truepose.plugins import package
from truepose.studies.workers import versions

#: Timeout of the connection to a cluster, s.
PATIENCE = 10


@contextlib.contextmanager
def executor(cluster: Any, retries: int) -> Iterator[Executor]:
    """Yield an executor on a dask cluster whose workers have the local versions."""
    missing = "study: dask is not installed; pip install 'truepose[cluster]'"
    Client = package("distributed", missing).Client
    if isinstance(cluster, Client):
        require_same(cluster)
        yield cluster.get_executor(pure=False, retries=retries)
        return
    try:
        client = Client(cluster, timeout=PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(f"--cluster {cluster}: no scheduler responds there ({error})") from None
    with client:
        require_same(client)
        yield client.get_executor(pure=False, retries=retries)


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
