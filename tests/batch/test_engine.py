"""Workers are checked before runs are sent to them; attempts at tasks are logged so that deaths can be told apart."""

import subprocess
import sys
from multiprocessing import spawn
from pathlib import Path
from typing import Any

import pytest

from crowdsim.batch.attempts import TaskError, attempt, describe_failure, read_attempts
from crowdsim.batch.plan import PlannedRun, estimate
from crowdsim.batch.tasks import Job
from crowdsim.batch.workers import (
    TOKEN,
    BatchOptions,
    connect,
    describe_environment,
    describe_worker,
    place_token,
    worker_findings,
)
from crowdsim.errors import BatchError
from crowdsim.scenario.output import Extent
from crowdsim.scenario.outputs import Outputs

OWN = describe_environment()


def answer(**changes: Any) -> dict[str, Any]:
    return {"environment": OWN, "host": "here", "folder": "", **changes}


def other(part: str, value: Any) -> dict[str, Any]:
    return answer(environment={**OWN, part: value}, host="there")


def findings(one: Any, threads: int = 1) -> list[str]:
    return list(worker_findings({"tcp://a": answer(), "tcp://b": one}, {"tcp://b": threads}, Path("/batch")))


def test_workers_that_are_alike_are_used() -> None:
    assert findings(answer()) == []


def test_a_worker_of_another_version_is_named_with_its_host() -> None:
    versions = {**OWN["versions"], "numpy": "1.0"}
    now = OWN["versions"]["numpy"]
    assert findings(other("versions", versions)) == [
        f"worker tcp://b on there: version of numpy: was {now}, is 1.0, as against this process"
    ]


def test_a_worker_of_another_kind_of_processor_is_named_with_its_host() -> None:
    (said,) = findings(other("processor", "Abacus"))
    assert said.startswith("worker tcp://b on there: has the processor Abacus, and tcp://a has ")


def test_workers_may_have_another_processor_than_the_command_if_all_have() -> None:
    both = {"tcp://a": other("processor", "Abacus"), "tcp://b": other("processor", "Abacus")}
    assert list(worker_findings(both, {}, Path("/batch"))) == []


def test_a_worker_with_several_threads_or_without_the_folder_or_the_package_is_refused() -> None:
    assert findings(answer(), 2) == ["worker tcp://b on here: has 2 threads, expected one; start it with --nthreads 1"]
    assert findings(answer(folder="is not there")) == [
        "worker tcp://b on here: /batch is not there; expected a folder that all workers share"
    ]
    assert findings(ModuleNotFoundError("No module named 'crowdsim'")) == [
        "worker tcp://b: cannot load crowdsim as it is here: No module named 'crowdsim'"
    ]


def test_a_folder_is_known_by_what_was_written_into_it(tmp_path: Path) -> None:
    token = place_token(tmp_path)
    assert describe_worker(str(tmp_path), token)["folder"] == ""
    assert describe_worker(str(tmp_path), "another")["folder"] == "is another folder"
    assert describe_worker(str(tmp_path / "missing"), token)["folder"] == "is not there"
    assert [path.name for path in tmp_path.iterdir()] == [TOKEN]


def test_an_attempt_that_succeeds_leaves_no_log(tmp_path: Path) -> None:
    path = tmp_path / "logs" / "id" / "simulate.log"
    with attempt(path, "one", 1, 60.0):
        assert len(read_attempts(path)) == 1
    assert not path.parent.exists()


def test_what_is_raised_is_logged_with_its_traceback(tmp_path: Path) -> None:
    path = tmp_path / "simulate.log"
    with pytest.raises(TaskError, match="simulate: not liked") as caught, attempt(path, "one", 1, 60.0):
        raise ValueError("not liked")
    assert (caught.value.kind, caught.value.message) == ("raised", "not liked")
    (found,) = read_attempts(path)
    assert found.cause() == ("raised", "not liked")
    assert "Traceback" in found.said


@pytest.mark.parametrize(
    ("deed", "kind", "message"),
    [
        ("import ctypes; ctypes.string_at(0)", "crashed", "Segmentation fault"),
        ("import time; time.sleep(60)", "hung", "did not end within 1 s"),
        ("import os; os._exit(3)", "killed", "was killed, or ran out of memory"),
    ],
)
def test_attempts_that_die_are_counted_and_their_cause_is_known(
    tmp_path: Path, deed: str, kind: str, message: str
) -> None:
    path = tmp_path / "draw.log"
    program = (
        "from pathlib import Path; from crowdsim.batch.attempts import attempt\n"
        f"with attempt(Path({str(path)!r}), 'one', 0, 1.0):\n    {deed}\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, timeout=50, check=False)
    assert done.returncode != 0
    with pytest.raises(TaskError) as caught, attempt(path, "one", 0, 60.0):
        pass
    assert caught.value.kind == kind
    assert message in caught.value.message
    with attempt(path, "another session", 0, 60.0):
        pass


def test_a_job_is_plain_data() -> None:
    assert {field.split(":")[0] for field in Job.__annotations__} == {
        "batch", "run", "session", "environment", "retries", "timeout", "command", "device",
    }  # fmt: skip


def test_a_run_that_a_scheduler_gives_up_has_the_cause_of_its_deaths(tmp_path: Path) -> None:
    run = PlannedRun("id", "four", 0, 4, 10, 15.0, Outputs(), ("tiny",), estimate(Extent(4, 10, 15.0), Outputs()))
    path = tmp_path / "logs" / "id" / "simulate.log"
    path.parent.mkdir(parents=True)
    begun = '{"begin": "simulate", "session": "one", "worker": "tcp://a", "host": "here", "pid": 7}\n'
    path.write_text(begun + "Fatal Python error: Segmentation fault\n" + begun)
    found = describe_failure(tmp_path, run, RuntimeError("given up"), "one")
    assert (found["task"], found["cause"], found["attempts"]) == ("simulate", "killed", 2)
    found = describe_failure(tmp_path, run, RuntimeError("given up"), "one", {("tcp://a", 7)})
    assert (found["cause"], found["message"]) == (
        "memory",
        "took more memory than its worker may (process 7 on here)",
    )
    assert describe_failure(tmp_path, run, RuntimeError("given up"), "two")["cause"] == "lost"


def test_workers_that_cannot_be_started_are_an_error_about_that(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spawn, "_python_exe", b"/nowhere/python")
    expected = r"workers of this machine do not start: .*expected that this user may execute"
    with pytest.raises(BatchError, match=expected), connect(BatchOptions(jobs=1), None):
        pass
