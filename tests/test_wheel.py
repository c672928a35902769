"""What a built wheel holds."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.slow
def test_the_wheel_holds_every_module_scenario_and_recipe(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(tmp_path), str(ROOT)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    names = set(zipfile.ZipFile(next(tmp_path.glob("*.whl"))).namelist())
    for path in sorted((ROOT / "crowdsim").rglob("*.py")):
        assert path.relative_to(ROOT).as_posix() in names
    for folder in ("scenarios", "policies"):
        for path in sorted((ROOT / folder).glob("*.yaml")):
            assert f"crowdsim/{folder}/{path.name}" in names
    assert not [name for name in names if name.endswith((".npy", ".bvh"))]
