"""Control on a GPU gives the bytes of control on a processor; numba's simulator takes the place of the GPU."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("numba_cuda", reason="needs numba-cuda: pip install crowdsim[test-cuda]")

HERE = Path(__file__).parent


def simulate(*names):
    """Return what ``simulated.py`` prints of crowds."""
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}
    done = subprocess.run(
        [sys.executable, HERE / "simulated.py", *names], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        *("scattered", "crowded", "armies", "one", "targets"),
        *("crowd_1m", "duel", "moving_target", "armies_200", "brawl_last_standing"),
    ],
)
def test_a_gpu_gives_the_bytes_of_a_processor_and_either_goes_on_where_the_other_stopped(name):
    runs = simulate(name)[name]
    expected = runs["cpu"]
    assert expected["frames"] > 20
    assert expected["strikes"] > 0 or name in ("one", "armies", "armies_200", "duel")
    for how, found in runs.items():
        assert found == expected, how
