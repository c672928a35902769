"""Which device control runs on, and what is said where that is missing."""

import subprocess
import sys

import pytest
from scenes import crowdsim

from crowdsim.crowd.cuda import device
from crowdsim.crowd.cuda.device import LARGE, DeviceError, choose_device, missing_for_cuda


def test_the_processor_is_taken_without_looking_for_a_gpu(monkeypatch):
    monkeypatch.setattr(device, "missing_for_cuda", lambda: pytest.fail("looked for a GPU"))
    assert choose_device("cpu", 10 * LARGE) == "cpu"
    assert choose_device("auto", LARGE - 1) == "cpu"
    assert choose_device("auto", LARGE, "scipy") == "cpu"


def test_auto_takes_a_gpu_for_large_crowds_where_there_is_one(monkeypatch):
    monkeypatch.setattr(device, "missing_for_cuda", lambda: "")
    assert choose_device("auto", LARGE) == "cuda"
    monkeypatch.setattr(device, "missing_for_cuda", lambda: "found none")
    assert choose_device("auto", LARGE) == "cpu"


def test_cuda_never_falls_back(monkeypatch):
    monkeypatch.setattr(device, "missing_for_cuda", lambda: "found none")
    with pytest.raises(DeviceError, match=r"^device cuda: found none$"):
        choose_device("cuda", 2)
    monkeypatch.setattr(device, "missing_for_cuda", lambda: "")
    assert choose_device("cuda", 2) == "cuda"
    with pytest.raises(DeviceError, match="cannot search by 'scipy', expected --search auto or kd_tree"):
        choose_device("cuda", 2, "scipy")


def test_an_unknown_device_is_named_with_the_choices():
    with pytest.raises(DeviceError, match=r"device is 'cude', expected one of cpu, cuda, auto \(did you mean 'cuda'\?"):
        choose_device("cude", 2)


def test_a_batch_on_other_machines_names_an_unknown_device_first(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert crowdsim("batch", "duel", "--scheduler", "tcp://127.0.0.1:1", "--device", "cude") == 2
    assert "device is 'cude', expected one of cpu, cuda, auto" in capsys.readouterr().err


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setattr(device, "find_spec", lambda name: None)
    assert missing_for_cuda() == "numba-cuda is not installed, expected: pip install 'crowdsim[cuda]'"


@pytest.mark.parametrize("command", ["run", "profile", "batch"])
def test_commands_say_in_a_line_what_is_missing_and_create_nothing(command, tmp_path):
    missing = missing_for_cuda()
    if not missing:
        pytest.skip("there is a GPU")
    done = subprocess.run(
        [sys.executable, "-m", "crowdsim", command, "duel", "--device", "cuda"],
        capture_output=True, text=True, cwd=tmp_path,
    )  # fmt: skip
    assert (done.returncode, done.stdout, list(tmp_path.iterdir())) == (2, "", [])
    assert done.stderr.splitlines()[-1] == f"device cuda: {missing}"
