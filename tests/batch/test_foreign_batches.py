"""Folders of batches that strangers have made: what is wrong with a file is said with its name, and no file is long."""

import json
import os
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from batches import write_batch
from scenes import crowdsim

from crowdsim.batch.attempts import TaskError, attempt, describe_failure, log_tail, read_attempts
from crowdsim.batch.description import load_batch
from crowdsim.batch.documents import MAXIMUM_BYTES, read_bytes
from crowdsim.batch.plan import Plan, read_plan, resolve, write_frozen, write_plan
from crowdsim.batch.report import read_table, write_report, write_table
from crowdsim.batch.results import read_progress, read_result, write_result
from crowdsim.batch.running import plan_batch
from crowdsim.errors import BatchError
from crowdsim.runs.manifest import signed_text

FAILED = {
    "state": "failed",
    "task": "simulate",
    "cause": "raised",
    "message": "no",
    "attempts": 1,
    "log": "",
    "command": "",
}
DONE = {
    "state": "done", "outputs": "", "statistics": {"strikes_thrown": 3, "landed_share": None},
    "seconds": {"total": 1.5},    "peak_memory_bytes": 1, "bytes": 1, "files": 1,
}  # fmt: skip
PROGRESS = {"runs": 2, "done": 0, "failed": 0, "seconds": 1.0, "seconds_left": None, "dashboard": "", "active": {}}
DEEP = "[" * 100_000 + "]" * 100_000


@pytest.fixture
def stranger(workplace: Path) -> Path:
    """The folder of a batch with two runs, none of which is begun."""
    folder = workplace / "all"
    plan, _ = plan_batch(folder, load_batch(write_batch(workplace, axes=[{"seed": "0:2"}])))
    folder.mkdir()
    environment = {"versions": {"numpy": "2"}, "processor": "Abacus"}
    write_plan(folder, Plan(plan.batch, plan.combinations, plan.runs, {"tiny": "0" * 64}, environment))
    return folder


def first_run(folder: Path) -> str:
    return next(iter(read_plan(folder).runs))


def rewrite(folder: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """Change a plan, and sign it as a stranger would."""
    document = json.loads((folder / "batch.json").read_text())
    change(document)
    (folder / "batch.json").write_text(signed_text(document))


def test_a_folder_without_a_plan_or_with_an_empty_one_is_no_batch(tmp_path: Path) -> None:
    for _ in range(2):
        with pytest.raises(BatchError, match=r"no batch.json here, or an empty one, so this is no batch"):
            read_plan(tmp_path)
        (tmp_path / "batch.json").touch()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "is damaged: Expecting property name"),
        (DEEP, "is damaged: nested too deeply"),
        ('{"a": ' * 80 + "1" + "}" * 80, "is damaged: nested too deeply"),
        ("[]", "is damaged: "),
        ('{"version": NaN}', "is damaged: NaN is no number of JSON"),
        ('{"version": 1e999}', "is damaged: 1e999 is too large for a number"),
        ('{"version": ' + "9" * 5000 + "}", "is damaged: Exceeds the limit"),
        ('{"format": "\\ud800"}', "is damaged: 'utf-8' codec can't encode"),
        (b"\xff\xfe", "is damaged: 'utf-8' codec can't decode"),
        ('{"format": "crowdsim-batch", "version": 1}', "is damaged: version: is 1, expected 2"),
        (" " * (MAXIMUM_BYTES + 1), "is too long, expected at most 8,000,000 bytes"),
    ],
    ids=range(11),
)
def test_documents_that_cannot_be_read_are_refused_by_name(
    stranger: Path, capsys, text: str | bytes, said: str
) -> None:
    id = first_run(stranger)
    (stranger / "results").mkdir()
    for name, read in (
        ("batch.json", read_plan),
        ("progress.json", read_progress),
        (f"results/{id}.json", lambda folder: read_result(folder, id)),
    ):
        (stranger / name).write_bytes(text if isinstance(text, bytes) else text.encode())
        if "version: is 1" in said and name != "batch.json":
            said = "is damaged: "
        with pytest.raises(BatchError) as caught:
            read(stranger)
        assert str(caught.value).startswith(f"{stranger / name}: {said}")
    assert crowdsim("status", "all") == 2
    assert "Traceback" not in capsys.readouterr().err


CHANGES: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "an id that leads out": (lambda d: d["combinations"].__setitem__(0, "../../x"), "combinations[0]: is '../../x'"),
    "a scenario that leads out": (lambda d: d["runs"][0].update(scenario="../x"), "runs[0].scenario: is '../x'"),
    "a policy that leads out": (lambda d: d["policies"].update({"../x": ""}), "policies: the key is '../x'"),
    "a run's policy that leads out": (lambda d: d["runs"][0].update(policies=["/x"]), "runs[0].policies[0]: is '/x'"),
    "a huge number": (lambda d: d["runs"][0].update(avatars=10**30), "runs[0].avatars: is 1000000000000"),
    "text for a number": (lambda d: d["runs"][0].update(control_rate="x"), "runs[0].control_rate: is 'x'"),
    "wrong outputs": (lambda d: d["runs"][0].update(outputs={"bvh": 3}), "runs: outputs: "),
    "runs that are missing": (lambda d: d.update(runs=[]), "combinations: are not those of its batch and runs"),
    "a run too many": (lambda d: d["combinations"].append("0" * 16), "combinations: are not those of its batch and"),
    "many runs": (
        lambda d: d["batch"].update(axes=[{"seed": "0:99999"}, {"fps": list(range(9999))}]),
        "axes: ask for 999,890,001 runs, expected at most 100,000",
    ),
    "axes of unequal length": (
        lambda d: d["batch"].update(axes=[{"seed": [1, 2], "fps": [1]}]),
        "axes[0].fps: has 1 values, expected 2",
    ),
    "a column of the table": (lambda d: d["batch"].update(axes=[{"state": [1, 2]}]), "'state' is no key of scenarios"),
    "a number as a version": (lambda d: d["environment"].update(versions={"numpy": 2}), "environment.versions.numpy"),
    "an unknown key": (lambda d: d.update(more=1), "more: unknown key"),
}  # fmt: skip


@pytest.mark.parametrize(("change", "said"), CHANGES.values(), ids=CHANGES)
def test_a_plan_that_is_signed_and_wrong_is_refused(
    stranger: Path, capsys, change: Callable[[dict[str, Any]], Any], said: str
) -> None:
    rewrite(stranger, change)
    assert crowdsim("status", "all") == 2
    message = capsys.readouterr().err
    assert message.startswith("all/batch.json: is damaged: ")
    assert said in message
    assert crowdsim("batch", "trial.yaml", "--out", "all") == 2
    assert "all/batch.json: is damaged: " in capsys.readouterr().err


def test_a_changed_plan_does_not_fit_its_checksum(stranger: Path) -> None:
    text = (stranger / "batch.json").read_text()
    (stranger / "batch.json").write_text(text.replace("Abacus", "Abaqus"))
    with pytest.raises(BatchError, match="its checksum does not fit what it says"):
        read_plan(stranger)


@pytest.mark.parametrize(
    ("document", "said"),
    [
        ({**DONE, "seconds": {"total": "x"}}, "seconds.total: is 'x', expected a number"),
        ({**DONE, "statistics": {"strikes_thrown": [1]}}, "statistics.strikes_thrown: is a list, expected a number"),
        ({**DONE, "bytes": 10**30}, "bytes: is 1000"),
        ({**DONE, "files": True}, "files: is true"),
        ({**FAILED, "message": 3}, "message: is 3, expected text"),
        ({**FAILED, "log": "../../secret.log"}, "log: is '../../secret.log'"),
        ({**FAILED, "log": "/etc/passwd"}, "log: is '/etc/passwd'"),
        ({**FAILED, "log": "logs/0123456789abcdef/../../../x.log"}, "log: is 'logs/0123456789abcdef/../../../x.log'"),
        ({**FAILED, "log": "results/0123456789abcdef/x.log"}, "log: is 'results/"),
        ({"state": "lost"}, "state"),
        ({}, "state"),
    ],
)
def test_a_result_that_is_wrong_is_refused(stranger: Path, capsys, document: dict[str, Any], said: str) -> None:
    id = first_run(stranger)
    write_result(stranger, id, document)
    with pytest.raises(BatchError) as caught:
        write_report(stranger, read_plan(stranger))
    assert str(caught.value).startswith(f"{stranger / 'results' / id}.json: is damaged: ")
    assert said in str(caught.value)
    assert crowdsim("status", "all") == 2
    assert f"all/results/{id}.json: is damaged: " in capsys.readouterr().err


def test_what_a_report_shows_is_a_regular_file_of_the_batch(stranger: Path) -> None:
    (stranger.parent / "secret").write_text("private")
    id, plan = first_run(stranger), read_plan(stranger)
    log, picture = stranger / "logs" / id / "simulate.log", stranger / "report" / "thumbnails" / f"{id}.png"
    write_result(stranger, id, {**FAILED, "log": f"logs/{id}/simulate.log"})
    for path in (log, picture):
        path.parent.mkdir(parents=True)
        path.symlink_to(stranger.parent / "secret")
        with pytest.raises(BatchError, match="links are not followed"):
            write_report(stranger, plan)
        path.unlink()
    os.mkfifo(log)
    with pytest.raises(BatchError, match="is a named pipe, expected a regular file"):
        write_report(stranger, plan)
    log.unlink()
    log.write_text("as it should be")
    assert log_tail(stranger, read_result(stranger, id)) == "as it should be"
    assert "as it should be" in write_report(stranger, plan).read_text()


def test_a_scenario_that_was_changed_in_the_folder_of_a_batch_is_written_again(stranger: Path) -> None:
    runs, _ = resolve(load_batch(stranger.parent / "trial.yaml"))
    one = next(iter(runs.values()))
    path = write_frozen(stranger / "scenarios", one)
    path.write_text(path.read_text().replace("seed: 0", "seed: 7"))
    assert path.read_text() != one.text
    assert write_frozen(stranger / "scenarios", one) == path
    assert path.read_text() == one.text


@pytest.mark.parametrize("name", ["batch.json", "runs", "scenarios", "policies", "work", "logs", "results", "report"])
def test_a_batch_does_not_go_on_where_links_lead(stranger: Path, capsys, name: str) -> None:
    (stranger / name).unlink(missing_ok=True)
    (stranger / name).symlink_to(stranger.parent / "policies")
    assert crowdsim("batch", "trial.yaml", "--out", "all") == 2
    assert capsys.readouterr().err.endswith(f"all/{name}: is a symbolic link, expected none in the folder of a batch\n")


def test_a_log_is_not_written_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "simulate.log").symlink_to(tmp_path / "mine")
    with pytest.raises(BatchError, match="links are not followed"), attempt(tmp_path / "simulate.log", "one", 1, 60.0):
        pass
    assert (tmp_path / "mine").read_text() == "mine"


def test_messages_that_are_long_or_no_text_can_be_read_again(stranger: Path) -> None:
    id = first_run(stranger)
    path = stranger / "logs" / id / "simulate.log"
    with pytest.raises(TaskError) as caught, attempt(path, "one", 1, 60.0):
        raise ValueError("name \udc80" + "x" * 2 * MAXIMUM_BYTES)
    assert read_attempts(path)[0].cause() == ("raised", caught.value.message)
    run = read_plan(stranger).runs[id]
    write_result(stranger, id, describe_failure(stranger, run, caught.value, "one"))
    assert read_result(stranger, id)["message"].startswith("name \\udc80xxx")
    assert "name \\udc80xxx" in write_report(stranger, read_plan(stranger)).read_text(encoding="utf-8")


def test_marks_in_a_log_are_checked(tmp_path: Path) -> None:
    path = tmp_path / "simulate.log"
    begin = '{"begin": "simulate", "session": "one", "pid": 7, "timeout": 1.0}'
    path.write_text(
        "\n".join([begin, '{"end": ' + DEEP + "}", '{"end": 3}', '{"begin": "x", "timeout": "y"}', "Timeout ("])
    )
    (found,) = read_attempts(path)
    assert (found.ended, found.cause()[0]) == ({}, "hung")


def test_a_file_that_is_too_long_is_not_read(tmp_path: Path) -> None:
    with open(tmp_path / "batch.json", "wb") as file:
        file.truncate(2_000_000_000)
    tracemalloc.start()
    try:
        with pytest.raises(BatchError, match="is too long"):
            read_plan(tmp_path)
        assert tracemalloc.get_traced_memory()[1] < 3 * MAXIMUM_BYTES
    finally:
        tracemalloc.stop()
    assert read_bytes(tmp_path, "missing") == b""


def test_text_in_a_table_is_no_formula_and_numbers_stay_numbers(stranger: Path) -> None:
    bad = ["=1+1", "+1", "-1", "@x", "\tx", "\rx"]
    for id, message in zip(read_plan(stranger).runs, ["=cmd|' /C calc'!A0", "-2 is text"], strict=True):
        write_result(stranger, id, {**FAILED, "message": message})
    table = read_table(stranger, read_plan(stranger))
    table["level"], table["=key"] = [-2.5, 1.0], bad[:2]
    path = stranger / "summary.csv"
    write_table(table, path)
    head, *rows = path.read_text().splitlines()
    assert head.endswith(",level,'=key")
    assert [row.split(",")[-2:] for row in rows] == [["-2.5", "'=1+1"], ["1.0", "'+1"]]
    assert "'=cmd|' /C calc'!A0" in rows[0]
    assert "'-2 is text" in rows[1]
    table["level"], table["=key"] = bad[2:4], bad[4:]
    write_table(table, path)
    lines = path.read_bytes().decode()
    assert all(f"'{text}" in lines for text in bad[2:])
