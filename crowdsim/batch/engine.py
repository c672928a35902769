"""The Dask scheduler and workers that do a batch: those of this machine alone, or those behind a given address."""

from __future__ import annotations

import logging
import os
import signal
import urllib.request
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crowdsim.batch.environment import TOKEN, describe_environment, describe_worker, place_token
from crowdsim.batch.preparing import compile_kernels
from crowdsim.core.workers import CORES
from crowdsim.errors import BatchError
from crowdsim.runs.origin import document_difference

if TYPE_CHECKING:
    from distributed import Client, LocalCluster

PATIENCE = 5.0
"""How long a scheduler may take to answer [s]."""
_SETTINGS = {
    # Only attempts that had begun count (crowdsim.batch.attempts).
    "distributed.scheduler.allowed-failures": 1_000_000,
    # A worker holds files, not data: it is ended when it takes too much memory, and never waits for less.
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    # Runs begin in their order, one at a time on each worker.
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.worker.profile.enabled": False,
    "distributed.nanny.pre-spawn-environ.NUMBA_NUM_THREADS": 1,
}


def require_dask() -> None:
    """Raise where Dask is not installed.

    Raises:
        BatchError: It is not.
    """
    for package in ("distributed", "jinja2"):
        if find_spec(package) is None:
            raise BatchError(f"crowdsim batch needs the package {package!r}; pip install 'crowdsim[farm]'")


@contextmanager
def connect(scheduler: str | None, jobs: int, memory: int | None = None) -> Iterator[Client]:
    """Give a client of the scheduler that does the work.

    Args:
        scheduler: Its address; None for workers of this machine, which are started and ended here.
        jobs: Workers that are started, each a process with one thread.
        memory: Memory that each of them may take [bytes]; its share of the machine's when None.

    Raises:
        BatchError: The scheduler does not answer.
    """
    import dask
    from distributed import Client, LocalCluster

    quiet = logging.CRITICAL
    with ExitStack() as stack:
        stack.enter_context(dask.config.set({**_SETTINGS, "logging.distributed": "critical"}))
        if scheduler is None:
            cluster = LocalCluster(
                n_workers=jobs,
                threads_per_worker=1,
                processes=True,
                memory_limit="auto" if memory is None else memory,
                dashboard_address="127.0.0.1:0" if find_spec("bokeh") else None,
                silence_logs=quiet,
            )
            stack.enter_context(cluster)
            client = stack.enter_context(Client(cluster, set_as_default=False))
            stack.callback(_end_workers, cluster)
            yield client
            return
        before = logging.getLogger("distributed").level
        logging.getLogger("distributed").setLevel(quiet)
        stack.callback(logging.getLogger("distributed").setLevel, before)
        try:
            client = Client(scheduler, timeout=PATIENCE, set_as_default=False)
        except Exception as error:
            # What answers may be no scheduler at all, and what it says anything.
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            what = f"no scheduler answers there within {PATIENCE:g} s ({reason})"
            raise BatchError(f"--scheduler {scheduler}: {what}; expected one such as tcp://127.0.0.1:8786") from None
        stack.enter_context(client)
        yield client


def _end_workers(cluster: LocalCluster) -> None:
    """End the workers of this machine at once: they hold nothing but files, from which the same command goes on."""
    for nanny in cluster.workers.values():
        nanny.auto_restart = False
        with suppress(OSError, TypeError):
            os.kill(nanny.pid, getattr(signal, "SIGKILL", signal.SIGTERM))


def dashboard_address(client: Client) -> str:
    """Return the address of the scheduler's dashboard; nothing where none answers."""
    with suppress(Exception):
        address = str(client.dashboard_link)
        with urllib.request.urlopen(address, timeout=2.0) as answer:
            return address if answer.status == 200 else ""
    return ""


def check_workers(client: Client, folder: Path) -> dict[str, Any]:
    """Return the environment that all workers share, once they have been found to see the folder of a batch.

    Args:
        client: Client of the scheduler, which has workers.
        folder: The folder.

    Raises:
        BatchError: A worker is of another version, of another kind of processor than others, has several threads, or
            cannot see or write the folder; the message names which, and where it runs.
    """
    token = place_token(folder)
    try:
        answers = client.run(describe_worker, str(folder), token, on_error="return")
    finally:
        (folder / TOKEN).unlink(missing_ok=True)
    threads = {address: facts["nthreads"] for address, facts in client.scheduler_info(n_workers=-1)["workers"].items()}
    findings = [*worker_findings(answers, threads, folder)]
    if findings:
        raise BatchError("\n".join(findings))
    return dict(next(iter(answers.values()))["environment"])


def compile_on_hosts(client: Client, uses: Collection[str]) -> None:
    """Compile the kernels that some uses need, by one worker of every machine, where they are not compiled yet."""
    workers = client.scheduler_info(n_workers=-1)["workers"]
    hosts = {facts["host"]: address for address, facts in workers.items()}
    client.gather(
        [client.submit(compile_kernels, list(uses), CORES, workers=[one], pure=False) for one in hosts.values()]
    )


def worker_findings(answers: Mapping[str, Any], threads: Mapping[str, int], folder: Path) -> Iterable[str]:
    """Yield what is wrong with workers, by what they answered (``describe_worker``) and their numbers of threads."""
    own, first = describe_environment(), None
    for address, answer in sorted(answers.items()):
        if not isinstance(answer, dict):
            yield f"worker {address}: cannot load crowdsim as it is here: {answer}"
            continue
        where = f"worker {address} on {answer['host']}"
        if answer["folder"]:
            yield f"{where}: {folder} {answer['folder']}; expected a folder that all workers share"
        if threads.get(address, 1) != 1:
            yield f"{where}: has {threads[address]} threads, expected one; start it with --nthreads 1"
        found = answer["environment"]
        first = first or (address, found)
        lines = document_difference({**own, "processor": None}, {**found, "processor": None})
        yield from (f"{where}: {line}, as against this process" for line in lines)
        if found["processor"] != first[1]["processor"]:
            what = f"has the processor {found['processor']}, and {first[0]} has {first[1]['processor']}"
            yield f"{where}: {what}; runs give the same bytes on one kind of processor only"
