"""Only processes with the certificates of a batch can speak to its processes."""

import os
import socket
import ssl
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
from batches import serving, write_batch
from scenes import crowdsim

from crowdsim.batch.workers import BatchOptions, connect, dashboard_address, find_certificates
from crowdsim.errors import BatchError

PAGES = ("/", "/status", "/info/main/workers.html", "/json/counts.json", "/metrics", "/health", "/proxy/80/127.0.0.1/")


def listening() -> list[tuple[str, int]]:
    """Return the addresses at which this process and those that it has started listen."""
    own = psutil.Process()
    found = [one for process in (own, *own.children(recursive=True)) for one in process.net_connections()]
    return [(one.laddr.ip, one.laddr.port) for one in found if one.status == psutil.CONN_LISTEN]


def answer(address: tuple[str, int], text: bytes, context: ssl.SSLContext | None = None) -> bytes:
    """Return what a process answers; nothing where it ends the connection."""
    with socket.create_connection(address, timeout=10) as plain:
        try:
            with context.wrap_socket(plain) if context else plain as line:
                line.sendall(text)
                return line.recv(1000)
        except (ConnectionError, ssl.SSLError):
            return b""


def stranger() -> ssl.SSLContext:
    """Return what a client without certificates speaks TLS with."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    return context


@pytest.fixture
def scheduler() -> Iterator[str]:
    """Address of a scheduler with a worker in this process; Dask's configuration has the certificates for it."""
    with serving(n_workers=1, processes=False, protocol="tls://") as address:
        yield address


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Any]:
    """Certificates of another authority than that of the scheduler, as files."""
    from distributed import Security

    security = Security.temporary()
    (tmp_path / "ca.pem").write_text(security.tls_ca_file)
    (tmp_path / "key.pem").write_text(security.tls_client_key)
    return {"ca_file": tmp_path / "ca.pem", "certificate": tmp_path / "ca.pem", "key": tmp_path / "key.pem"}


def test_workers_of_this_machine_show_nothing_to_those_without_the_certificates_of_the_batch() -> None:
    before, options = set(listening()), BatchOptions(jobs=2)
    with connect(options, find_certificates(options)) as client:
        assert client.submit(abs, -3).result() == 3
        addresses = set(listening()) - before
        own = client.scheduler_info(n_workers=-1)
        inner = [own["address"], *own["workers"], *(facts["nanny"] for facts in own["workers"].values())]
        assert len(inner) == 5
        assert all(address.startswith("tls://127.0.0.1:") for address in inner)
        encrypted = {("127.0.0.1", int(address.rsplit(":", 1)[1])) for address in inner}
        assert encrypted < addresses
        for address in encrypted:
            assert answer(address, b"GET / HTTP/1.0\r\n\r\n") == b""
            assert answer(address, b"x" * 100, stranger()) == b""
        for address in addresses - encrypted:
            assert address[0] == "127.0.0.1"
            for page in PAGES:
                assert answer(address, f"GET {page} HTTP/1.0\r\n\r\n".encode()).startswith(b"HTTP/1.1 404")
        assert dashboard_address(client) == ""
        paths = [sys.path, *client.run(lambda: list(sys.path)).values()]
        (place,) = {Path(path.partition("dask-scratch-space")[0]) for each in paths for path in each if "dask-" in path}
        assert stat.S_IMODE(place.stat().st_mode) == 0o700
        assert all("dask-scratch-space" in path[0] for path in paths)
    assert not place.exists()


HOMELESS = """
import os, pwd
from crowdsim.batch import workers
from crowdsim.batch.workers import BatchOptions, connect, dashboard_address, find_certificates
def unknown(number):
    raise KeyError(number)
if __name__ == "__main__":
    pwd.getpwuid, workers.PATIENCE = unknown, 120.0
    options = BatchOptions(jobs=1, dashboard=True)
    with connect(options, find_certificates(options)) as client:
        assert dashboard_address(client).startswith("http://127.0.0.1:")
    assert "HOME" not in os.environ
"""


def test_a_dashboard_is_there_on_demand_even_without_a_home(tmp_path: Path) -> None:
    program = tmp_path / "homeless.py"
    program.write_text(HOMELESS)
    without = {name: value for name, value in os.environ.items() if name != "HOME"}
    done = subprocess.run([sys.executable, program], env=without, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


def test_certificates_of_another_authority_and_none_are_refused(scheduler: str, files: dict[str, Any]) -> None:
    options = BatchOptions(scheduler=scheduler, **files)
    with pytest.raises(BatchError, match="no scheduler answers there"), connect(options, find_certificates(options)):
        pass
    plain = BatchOptions(scheduler=scheduler.replace("tls", "tcp"), insecure=True)
    with pytest.raises(BatchError, match="no scheduler answers there"), connect(plain, find_certificates(plain)):
        pass
    own = BatchOptions(scheduler=scheduler)
    with connect(own, find_certificates(own)) as client:
        assert client.submit(abs, -3).result() == 3


def test_certificates_are_those_of_files(files: dict[str, Any]) -> None:
    from distributed import LocalCluster, Security

    names = {key: str(path) for key, path in files.items()}
    roles = {f"tls_{role}_{part}": names[file] for role in ("scheduler", "worker") for part, file in
             (("cert", "certificate"), ("key", "key"))}  # fmt: skip
    security = Security(
        tls_ca_file=names["ca_file"], tls_client_cert=names["certificate"], tls_client_key=names["key"],
        require_encryption=True, **roles,
    )  # fmt: skip
    with LocalCluster(
        n_workers=1, processes=False, protocol="tls://", dashboard_address="127.0.0.1:0", security=security
    ) as own:
        options = BatchOptions(scheduler=own.scheduler_address, **files)
        with connect(options, find_certificates(options)) as client:
            assert client.submit(abs, -3).result() == 3


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--scheduler", "tcp://127.0.0.1:1"], "--scheduler tcp://127.0.0.1:1: without TLS everybody who reaches the "
         "scheduler runs programs as you do; expected tls://HOST:8786, or --insecure where only "
         "trusted users reach it"),
        (["--scheduler", "nowhere"], "--scheduler nowhere: without TLS everybody"),
        (["--scheduler", "tls://127.0.0.1:1"], "--scheduler tls://127.0.0.1:1: needs certificates; expected "
         "--tls-ca-file, --tls-cert and --tls-key, or distributed.comm.tls in Dask's configuration"),
        (["--scheduler", "tls://127.0.0.1:1", "--insecure"], "tls://127.0.0.1:1: expected no --insecure with tls://"),
        (["--scheduler", "tcp://a:1", "--insecure", "--tls-key", "x"], "expected certificates only for tls://"),
        (["--scheduler", "tls://a:1", "--tls-ca-file", "x", "--tls-cert", "x"], "tls://a:1: certificates cannot be us"),
        (["--scheduler", "tls://a:1", "--tls-ca-file", "four.yaml", "--tls-cert", "x"], "certificates cannot be used"),
        (["--scheduler", "tcp://a:1", "--dashboard"], "has a dashboard of its own, expected no --dashboard"),
        (["--insecure"], "--insecure and certificates are for another scheduler, expected --scheduler"),
        (["--tls-cert", "x"], "--insecure and certificates are for another scheduler, expected --scheduler"),
    ],
)  # fmt: skip
def test_a_scheduler_without_tls_or_certificates_is_refused(
    workplace: Path, capsys, words: list[str], said: str
) -> None:
    import dask
    import distributed.config  # noqa: F401  which sets the defaults

    write_batch(workplace)
    with dask.config.set({"distributed.comm.tls.ca-file": None}):
        assert crowdsim("batch", "four.yaml", "--out", "all", *words) == 2
    assert said in capsys.readouterr().err
    assert not (workplace / "all").exists()
