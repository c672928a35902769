"""Control on a GPU gives the bytes of control on a processor; numba's simulator takes the place of the GPU."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("numba_cuda", reason="needs numba-cuda: pip install crowdsim[test-cuda]")

HERE = Path(__file__).parent


PLAIN = ("scattered", "crowded", "armies", "alone", "targets", "pre_roll", "entering", "hurt", "falling")
"""Crowds that are small enough for kernels that are not compiled."""


def simulate(*names, **variables):
    """Return what ``simulated.py`` prints of crowds."""
    done = subprocess.run(
        [sys.executable, HERE / "simulated.py", *names],
        env={**os.environ, "NUMBA_ENABLE_CUDASIM": "1", **variables}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout)


def compare(runs):
    """Compare runs by GPU, and those that change their device, with the run by processor; return that."""
    expected = runs["cpu, cpu"]
    assert len(runs) == 4
    assert expected["frames"] > 0
    for devices, found in runs.items():
        assert found == expected, devices
    return expected


def test_a_gpu_gives_the_bytes_of_a_processor_and_either_goes_on_where_the_other_stopped():
    for runs in simulate("scattered", NUMBA_DISABLE_JIT="1").values():
        assert compare(runs)["strikes"] > 10


@pytest.mark.slow
def test_so_it_is_in_crowds_of_every_kind():
    found = {name: compare(runs) for name, runs in simulate(*PLAIN, NUMBA_DISABLE_JIT="1").items()}
    assert set(found) == set(PLAIN)
    assert all(one["strikes"] > 0 for one in found.values())
    assert found["hurt"]["knock_downs"] > 3
    assert found["falling"]["knock_downs"] > 3


@pytest.mark.slow
def test_so_it_is_where_hits_throw_avatars_off_their_feet_without_damage():
    found = {name: compare(runs) for name, runs in simulate("unhurt", "thrown", NUMBA_DISABLE_JIT="1").items()}
    assert found["thrown"]["digests"]["action"] != found["unhurt"]["digests"]["action"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["crowded", "crowd_1m", "duel", "moving_target", "armies_200", "brawl_last_standing"])
def test_so_it_is_with_compiled_kernels_and_in_shipped_scenarios(name):
    compare(simulate(name)[name])
