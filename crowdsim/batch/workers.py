"""The Dask scheduler and workers that do a batch: those of this machine alone, or those behind a given address."""

from __future__ import annotations

import logging
import os
import platform
import signal
import socket
import time
import urllib.request
import uuid
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module, metadata
from importlib.util import find_spec
from multiprocessing.spawn import get_executable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from crowdsim.batch.documents import read_bytes
from crowdsim.core.types import FileName
from crowdsim.core.workers import CORES
from crowdsim.errors import BatchError, OutputError
from crowdsim.files import remove_plain, write_plain, write_text
from crowdsim.runs.provenance import document_difference, origin_of

if TYPE_CHECKING:
    from distributed import Client, LocalCluster, Security

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
_HIDDEN: dict[str, Any] = {"distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []}
"""Dask's processes listen for a browser in any case; then there is nothing to be seen."""
TOKEN = ".crowdsim-batch-token"
_STALLED = 60.0
"""When nothing has been compiled for so long, kernels are left to the workers [s]."""


@dataclass(frozen=True)
class BatchOptions:
    """How a batch is done.

    Attributes:
        jobs: Workers of this machine.
        scheduler: Address of a scheduler with workers of its own.
        insecure: Whether that scheduler may do without TLS.
        ca_file: Certificate of the authority that has signed those of scheduler and workers.
        certificate: Certificate by which they know this command.
        key: Its key, unless the file of the certificate has it.
        dashboard: Whether workers of this machine have Dask's dashboard.
        fail_fast: Whether the first failure ends the batch.
        retries: How often a task that failed is tried again.
        timeout: How long a task may take [s].
        memory: Memory that a worker of this machine may take [bytes].
        mocap: Folder of capture for policies that are trained from it.
        threads: Threads that train and compile beforehand.
        command: The command, for manifests.
        device: Where control runs, one of ``cuda.device.DEVICES``; workers of this machine take one GPU each.
    """

    jobs: int = 1
    scheduler: str | None = None
    insecure: bool = False
    ca_file: FileName | None = None
    certificate: FileName | None = None
    key: FileName | None = None
    dashboard: bool = False
    fail_fast: bool = False
    retries: int = 1
    timeout: float = 1800.0
    memory: int | None = None
    mocap: FileName | None = None
    threads: int = 1
    command: str = ""
    device: str = "cpu"


def require_dask(options: BatchOptions) -> None:
    """Raise a ``BatchError`` if a package is missing that a batch needs."""
    more = {"cryptography": options.scheduler is None, "bokeh": options.dashboard}
    for package in ("distributed", "jinja2", *(name for name, is_needed in more.items() if is_needed)):
        if find_spec(package) is None:
            raise BatchError(f"crowdsim batch needs the package {package!r}; pip install 'crowdsim[farm]'")


def find_certificates(options: BatchOptions) -> Security | None:
    """Return the certificates by which command, scheduler and workers know each other; None where there are none.

    Those of workers of this machine are made here, kept in memory, and end with the batch. Those for another scheduler
    come from options, or from Dask's configuration (``distributed.comm.tls``).

    Raises:
        BatchError: The scheduler has none, which ``insecure`` does not allow, or they cannot be used.
    """
    from distributed import Security

    given = {"tls_ca_file": options.ca_file, "tls_client_cert": options.certificate, "tls_client_key": options.key}
    given = {name: str(path) for name, path in given.items() if path is not None}
    if options.scheduler is None:
        return Security.temporary()
    is_tls, where = options.scheduler.startswith("tls://"), f"--scheduler {options.scheduler}"
    if not is_tls and not options.insecure:
        what = "without TLS everybody who reaches the scheduler runs programs as you do"
        raise BatchError(f"{where}: {what}; expected tls://HOST:8786, or --insecure where only trusted users reach it")
    if is_tls == options.insecure or (given and not is_tls):
        raise BatchError(f"{where}: expected {'no --insecure with' if is_tls else 'certificates only for'} tls://")
    if not is_tls:
        return None
    expected = "expected --tls-ca-file, --tls-cert and --tls-key, or distributed.comm.tls in Dask's configuration"
    try:
        security = Security(require_encryption=True, **given)
        if security.get_connection_args("client")["ssl_context"] is None:
            raise BatchError(f"{where}: needs certificates; {expected}")
    except (OSError, ValueError) as error:
        raise BatchError(f"{where}: certificates cannot be used: {error}; {expected}") from None
    return security


@contextmanager
def connect(options: BatchOptions, security: Security | None) -> Iterator[Client]:
    """Give a client of the scheduler that does the work; without one, workers of this machine do it, and end here.

    Raises:
        BatchError: The scheduler does not answer, or workers do not start.
    """
    import dask
    from distributed import Client, LocalCluster

    quiet = logging.CRITICAL
    with ExitStack() as stack:
        hidden = {} if options.dashboard or options.scheduler else _HIDDEN
        stack.enter_context(dask.config.set({**_SETTINGS, **hidden, "logging.distributed": "critical"}))
        if options.scheduler is None:
            program = os.fsdecode(get_executable())
            what, expected = "workers of this machine do not start", f"expected that this user may execute {program}"
            # Dask may wait for ever for one that it cannot start.
            if not os.access(program, os.X_OK):
                raise BatchError(f"{what}: it cannot be executed; {expected}")
            # All processes load modules from there first, this one too; Dask's own place may be another user's.
            private = TemporaryDirectory(prefix="crowdsim-batch-", ignore_cleanup_errors=True)
            stack.enter_context(dask.config.set({"temporary-directory": stack.enter_context(private)}))
            if options.dashboard:
                _load_bokeh(private.name)
            try:
                cluster = LocalCluster(
                    n_workers=options.jobs,
                    threads_per_worker=1,
                    processes=True,
                    memory_limit="auto" if options.memory is None else options.memory,
                    security=security,
                    dashboard_address="127.0.0.1:0",
                    scheduler_kwargs={"dashboard": options.dashboard},
                    silence_logs=quiet,
                )
            except RuntimeError as error:
                raise BatchError(f"{what}: {error}; {expected}") from error
            stack.enter_context(cluster)
            client = stack.enter_context(Client(cluster, set_as_default=False))
            stack.callback(_end_workers, cluster)
            yield client
            return
        for logger in map(logging.getLogger, ("distributed", "distributed.client")):
            stack.callback(logger.setLevel, logger.level)
            logger.setLevel(quiet)
        try:
            client = Client(options.scheduler, timeout=PATIENCE, security=security, set_as_default=False)
        except Exception as error:
            # What answers may be no scheduler at all, and what it says anything.
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            what = f"no scheduler answers there within {PATIENCE:g} s ({reason})"
            raise BatchError(f"--scheduler {options.scheduler}: {what}; expected one such as tls://HOST:8786") from None
        stack.enter_context(client)
        yield client


def _load_bokeh(folder: str) -> None:
    """Load what draws the dashboard, and looks for the user's home as it loads; without one, a folder is its home."""
    try:
        Path.home()
    except RuntimeError:
        os.environ["HOME"] = folder
        try:
            import_module("bokeh.settings")
        finally:
            del os.environ["HOME"]


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
        with urllib.request.urlopen(address, timeout=PATIENCE) as answer:
            return address if answer.status == 200 else ""
    return ""


def check_workers(client: Client, folder: Path) -> dict[str, Any]:
    """Return the environment that all workers share, once they have been found to see the folder of a batch.

    Raises:
        BatchError: A worker is of another version, of another kind of processor than others, has several threads, or
            cannot see or write the folder; the message names which, and where it runs.
    """
    token = place_token(folder)
    try:
        answers = client.run(describe_worker, str(folder), token, on_error="return")
    finally:
        remove_plain(folder, [TOKEN])
    threads = {address: facts["nthreads"] for address, facts in client.scheduler_info(n_workers=-1)["workers"].items()}
    findings = [*worker_findings(answers, threads, folder)]
    if findings:
        raise BatchError("\n".join(findings))
    return dict(next(iter(answers.values()))["environment"])


def compile_kernels(uses: Collection[str], processes: int, notify: Callable[[str], None] | None = None) -> None:
    """Compile the kernels that some uses need and that are not compiled yet; where they are, nothing is loaded.

    Args:
        uses: What kernels will be needed for.
        processes: Processes that compile.
        notify: Called with what is missing, and about how long it takes.
    """
    from crowdsim.jit.ahead import compile_ahead, compile_listed
    from crowdsim.jit.signatures import listed

    with compile_ahead(uses, processes) as missing:
        if missing and notify is not None:
            notify(missing)
        left, since = missing, time.monotonic()
        while left and time.monotonic() - since < _STALLED:
            for one in listed(uses):
                compile_listed(one)
            # What the other processes are compiling is left to them, and looked at again.
            time.sleep(0.1)
            before = left
            with compile_ahead(uses, 0) as left:
                since = since if left == before else time.monotonic()


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


@cache
def describe_environment() -> dict[str, Any]:
    """Return what the results of this process depend on, beside scenarios and policies.

    Returns:
        ``versions`` of crowdsim, its sources, Python and packages, and the ``processor``.
    """
    document = origin_of("", ()).document()
    more = {"python": platform.python_version(), "distributed": metadata.version("distributed")}
    return {"versions": {**document["versions"], **more}, "processor": document["processor"]}


def place_token(folder: Path) -> str:
    """Write what a worker must find in the folder of a batch, and return it."""
    token = uuid.uuid4().hex
    write_text(folder / TOKEN, token)
    return token


def describe_worker(folder: str, token: str) -> dict[str, Any]:
    """Return what this process is, and how it sees the folder of a batch.

    Returns:
        The ``environment``, ``host``, and ``folder``: what is wrong with it, nothing where it is the right one.
    """
    path = Path(folder)
    try:
        found = read_bytes(path, TOKEN)
        wrong = "" if found == token.encode() else "is another folder" if found else "is not there"
        if not wrong:
            own = f"{TOKEN}-{socket.gethostname()}-{os.getpid()}"
            write_plain(path, own, token)
            remove_plain(path, [own])
    except (OSError, BatchError, OutputError) as error:
        wrong = f"cannot be used: {error}"
    return {"environment": describe_environment(), "host": socket.gethostname(), "folder": wrong}
