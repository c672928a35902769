"""Runs that fail, and processes that are killed: others are not affected, and what goes on gives the same bytes."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest
from batches import digests, results, write_batch
from faults import KINDS
from scenes import crowdsim

from crowdsim.batch.plan import read_plan
from crowdsim.runs.manifest import read_manifest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs a system that kills"),
]

Process = subprocess.Popen[bytes]

LONG = {"duration": 8000, "outputs": {"take": {"chunk": 128}}}
"""Long enough to be killed in the middle, with checkpoints at short distances."""


def start(folder: Path, *words: str, module: str = "crowdsim.cli") -> subprocess.Popen[bytes]:
    """Start a program in a folder."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-m", module, *words]
    with open(folder / f"{words[0]}-{len(list(folder.glob('*.said')))}.said", "wb") as said:
        return subprocess.Popen(command, cwd=folder, env=environment, stdout=said, stderr=said)


def said(folder: Path) -> str:
    return "\n".join(path.read_text(errors="replace") for path in sorted(folder.glob("*.said")))


def wait_until(is_so: Callable[[], Any], seconds: float = 400) -> Any:
    """Wait until something is so, and return it."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        found = is_so()
        if found:
            return found
        time.sleep(0.05)
    raise AssertionError("never was so")


def at_work(folder: Path) -> list[int]:
    """Return the processes that hold run folders of a batch now, and have written some of their takes."""
    found = []
    for run in folder.glob("runs/*"):
        try:
            owner = json.loads((run / ".crowdsim-lock.json").read_text())
        except (OSError, ValueError):
            continue
        if list(run.glob(".run.partial/take.zarr.partial/x/*.0")) and psutil.pid_exists(owner["pid"]):
            found.append(owner["pid"])
    return found


def status(folder: Path, capsys) -> dict[str, Any]:
    capsys.readouterr()
    code = crowdsim("status", folder, "--json")
    facts = json.loads(capsys.readouterr().out)
    assert code == int(any(run["state"] in ("failed", "damaged") for run in facts["runs"].values()))
    return facts


_ALONE: dict[str, dict[str, str]] = {}


@pytest.fixture
def undisturbed(workplace: Path) -> dict[str, dict[str, str]]:
    """Digests of the runs of a long batch, done one after the other by the command ``run``; the batch is in place."""
    write_batch(workplace, LONG, axes=[{"seed": "0:4"}])
    if not _ALONE:
        for seed in range(4):
            command = ["run", "four.yaml", "--seed", str(seed), "--threads", "1", "--out", f"alone/runs/{seed}"]
            assert crowdsim(*command, "--quiet") == 0
        _ALONE.update({text["take.zarr/x/0.0"]: text for text in digests(workplace / "alone").values()})
    return _ALONE


def check_same(folder: Path, undisturbed: dict[str, dict[str, str]]) -> None:
    found = digests(folder)
    assert len(found) == 4
    for text in found.values():
        assert text == undisturbed[text["take.zarr/x/0.0"]]


def test_ten_forced_failures_of_four_kinds_affect_no_other_run(
    workplace: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    bad, good = list(range(900, 910)), list(range(20))
    seeds = [*bad[:3], *good[:7], *bad[3:6], *good[7:], *bad[6:]]
    write_batch(workplace, axes=[{"seed": seeds}])
    monkeypatch.setenv("DASK_DISTRIBUTED__WORKER__PRELOAD", str(Path(__file__).with_name("faults.py")))
    options = ["--jobs", "2", "--retries", "0", "--timeout", "20s", "--memory", "900M"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-m", "crowdsim.cli", "batch", "trial.yaml", "--out", "all", *options],
        cwd=workplace, env=environment, capture_output=True, text=True, timeout=400, check=False,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert "20 done, 10 failed" in done.stdout, done.stdout + done.stderr
    assert "10 of 30 runs failed" in done.stderr
    seed_of = {id: run.seed for id, run in read_plan(workplace / "all").runs.items()}
    for id, result in results(workplace / "all").items():
        seed = seed_of[id]
        assert result["state"] == ("failed" if seed in bad else "done")
        if seed in bad:
            assert result["cause"] == KINDS[seed % 4], result
            assert result["attempts"] == 1
            assert (workplace / "all" / result["log"]).is_file()
            assert result["command"].startswith("crowdsim run ")
    page = (workplace / "all" / "report" / "index.html").read_text()
    assert "is not liked" in page
    assert "Segmentation fault" in page
    capsys.readouterr()
    facts = status(workplace / "all", capsys)
    assert (facts["state"], facts["done"], facts["failed"]) == ("failed", 20, 10)
    repeat = next(one["command"] for one in results(workplace / "all").values() if one.get("cause") == "hung")
    assert crowdsim(*repeat.split()[1:], "--quiet") == 0
    monkeypatch.delenv("DASK_DISTRIBUTED__WORKER__PRELOAD")
    assert crowdsim("batch", "trial.yaml", "--out", "all", "--jobs", "2") == 0
    assert "30: 10 done, 20 before, 0 failed" in capsys.readouterr().out


def test_the_first_failure_ends_a_batch_that_is_to_fail_fast_and_the_rest_goes_on_later(
    workplace: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    write_batch(workplace, axes=[{"seed": [900, *range(12)]}])
    monkeypatch.setenv("DASK_DISTRIBUTED__WORKER__PRELOAD", str(Path(__file__).with_name("faults.py")))
    command = ["batch", "trial.yaml", "--out", "all", "--jobs", "1", "--retries", "0", "--fail-fast"]
    assert start(workplace, *command).wait(timeout=600) == 1
    facts = status(workplace / "all", capsys)
    assert facts["failed"] == 1
    assert facts["done"] < 12
    monkeypatch.delenv("DASK_DISTRIBUTED__WORKER__PRELOAD")
    assert crowdsim(*command) == 0
    assert len(digests(workplace / "all")) == 13


def test_a_worker_that_is_killed_changes_no_byte(workplace: Path, undisturbed: dict[str, dict[str, str]]) -> None:
    batch = start(workplace, "batch", "trial.yaml", "--out", "all", "--jobs", "2", "--retries", "3")
    for count in (1, 2):
        os.kill(wait_until(lambda: at_work(workplace / "all"))[0], signal.SIGKILL)
        wait_until(lambda count=count: said(workplace).count("was lost; other workers, or new ones, go on") >= count)
    assert batch.wait(timeout=600) == 0, said(workplace)
    check_same(workplace / "all", undisturbed)


def test_a_command_that_is_killed_leaves_no_worker_and_goes_on(
    workplace: Path, undisturbed: dict[str, dict[str, str]], capsys
) -> None:
    words = ("batch", "trial.yaml", "--out", "all", "--jobs", "2")
    batch = start(workplace, *words)
    workers = wait_until(lambda: at_work(workplace / "all"))
    assert status(workplace / "all", capsys)["state"] == "running"
    batch.kill()
    batch.wait()
    wait_until(lambda: not any(psutil.pid_exists(pid) for pid in workers), 400)
    assert status(workplace / "all", capsys)["state"] == "interrupted"
    assert crowdsim(*words) == 0
    check_same(workplace / "all", undisturbed)


@contextmanager
def farm(folder: Path, *workers: Sequence[str], tls: Sequence[str] = ()) -> Iterator[tuple[str, list[Process]]]:
    """Start a scheduler by hand, and a worker for each of some options; give the address and the processes."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"{'tls' if tls else 'tcp'}://127.0.0.1:{port}"
    where = ["--host", f"{address.split(':')[0]}://127.0.0.1", "--port", str(port), "--no-dashboard"]
    processes = [start(folder, "scheduler", *where, *tls, module="dask")]
    try:
        for options in workers:
            processes.append(add_worker(folder, address, *options, *tls))
        yield address, processes
    finally:
        for one in reversed(processes):
            one.terminate()
        _, left = psutil.wait_procs([psutil.Process(one.pid) for one in processes if one.poll() is None], timeout=30)
        for process in left:  # Dask's own end, which is not under test, may wait for ever
            process.kill()
        for one in processes:
            one.wait()


def add_worker(folder: Path, address: str, *options: str) -> Process:
    always = ["--nthreads", "1", "--no-dashboard", "--death-timeout", "20"]
    return start(folder, "worker", address, *always, *options, module="dask")


@pytest.fixture
def tls(workplace: Path) -> list[str]:
    """Options that name certificates, of Dask's programs and of ``crowdsim batch``."""
    from distributed import Security

    security = Security.temporary()
    (workplace / "ca.pem").write_text(security.tls_ca_file)
    (workplace / "key.pem").write_text(security.tls_client_key)
    return ["--tls-ca-file", "ca.pem", "--tls-cert", "ca.pem", "--tls-key", "key.pem"]


def test_a_scheduler_that_is_killed_is_reported_and_the_command_goes_on(
    workplace: Path, undisturbed: dict[str, dict[str, str]], tls: list[str]
) -> None:
    words = ("batch", "trial.yaml", "--out", "all", *tls, "--scheduler")
    with farm(workplace, [], [], tls=tls) as (address, processes):
        batch = start(workplace, *words, address)
        wait_until(lambda: at_work(workplace / "all"))
        processes[0].kill()
        assert batch.wait(timeout=600) == 1
        assert f"the scheduler at {address} was lost" in said(workplace)
        assert not [path for path in workplace.glob("batch-*.said") if "Traceback" in path.read_text()]
    with farm(workplace, [], [], tls=tls) as (address, _):
        again = start(workplace, *words, address)
        assert again.wait(timeout=600) == 0, said(workplace)
    check_same(workplace / "all", undisturbed)


def test_a_worker_of_a_scheduler_that_is_killed_is_reported_and_the_others_go_on(
    workplace: Path, undisturbed: dict[str, dict[str, str]]
) -> None:
    with farm(workplace, ["--no-nanny"], ["--no-nanny"]) as (address, processes):
        words = ("batch", "trial.yaml", "--out", "all", "--insecure", "--scheduler", address)
        batch = start(workplace, *words)
        pid = wait_until(lambda: at_work(workplace / "all"))[0]
        (killed,) = (one for one in processes[1:] if one.pid == pid)
        killed.kill()
        killed.wait()
        wait_until(lambda: "was lost; other workers, or new ones, go on with its tasks" in said(workplace))
        assert batch.wait(timeout=600) == 0, said(workplace)
        assert start(workplace, *words).wait(timeout=600) == 0
        assert "4: 0 done, 4 before, 0 failed" in said(workplace)
    check_same(workplace / "all", undisturbed)


def test_a_worker_that_differs_is_refused_at_the_start_and_not_used_later(workplace: Path) -> None:
    write_batch(workplace, {"duration": 3000}, axes=[{"seed": "0:12"}])
    other = workplace / "other.py"
    other.write_text(
        "from crowdsim.runs import provenance\nprovenance.sources_hash = lambda: 'another'\n"
        "def dask_setup(worker):\n    pass\n"
    )
    with farm(workplace, ["--preload", str(other)]) as (address, processes):
        words = ("batch", "trial.yaml", "--insecure", "--scheduler", address, "--out")
        refused = start(workplace, *words, "none")
        assert refused.wait(timeout=600) == 2
        assert "version of sources: was " in said(workplace)
        assert ", is another, as against this process" in said(workplace)
        assert not (workplace / "none").exists()
        processes[1].terminate()
        processes[1].wait(timeout=600)
        processes[1] = add_worker(workplace, address)
        batch = start(workplace, *words, "all")
        wait_until(lambda: list(workplace.glob("all/runs/*")))
        processes.append(add_worker(workplace, address, "--preload", str(other)))
        wait_until(lambda: "is not used, since it differs: version of sources" in said(workplace))
        assert batch.wait(timeout=600) == 0, said(workplace)
    assert {result["state"] for result in results(workplace / "all").values()} == {"done"}


def test_ranges_of_pictures_give_the_video_of_one_rendering(workplace: Path) -> None:
    render = {"fps": 120, "size": [32, 24], "png": True, "frames": [30, 300]}
    write_batch(workplace, axes=[{"seed": [3]}], outputs={"render": render})
    assert crowdsim("batch", "trial.yaml", "--out", "all", "--jobs", "2", "--quiet") == 0
    (run,) = (workplace / "all" / "runs").iterdir()
    frozen = next((workplace / "all" / "scenarios").glob("*/scenario.resolved.yaml"))
    assert crowdsim("run", frozen, "--out", "single", "--threads", "1", "--quiet") == 0
    how = ["--size", "32x24", "--fps", "120", "--png", "--mp4", "--frames", "30:300", "--threads", "1"]
    assert crowdsim("render", "single", *how, "--quiet") == 0
    assert read_manifest(run)["files"] == read_manifest(workplace / "single")["files"]
    assert len(list((run / "frames").iterdir())) == 270
