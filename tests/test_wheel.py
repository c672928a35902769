"""The wheel: what it holds, and that a duel runs in a fresh environment without training."""

import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
POLICIES = ("boxer", "boxer_crowd")
LIMIT = 48_000_000
DUEL = ("run", "duel", "--set", "duration=6s", "--out", "duel")


def run(*command: object, **options) -> subprocess.CompletedProcess:
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=1800, check=False, **options)
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("dist")
    run(sys.executable, ROOT / "release" / "make_wheel.py", "--out", out, env={**os.environ, "PYTHONPATH": str(ROOT)})
    (built,) = out.iterdir()
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory):
    """The command of the wheel in a fresh environment, which sees what this one has installed but no sources."""
    folder = tmp_path_factory.mktemp("fresh")
    work, python = folder / "work", folder / "venv" / "bin" / "python"
    work.mkdir()
    hidden = ("PYTHONPATH", "CROWDSIM_MOCAP", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR")
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    environment["HOME"] = str(folder / "home")
    venv.create(folder / "venv", with_pip=False)
    pip = (sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--disable-pip-version-check")
    run(*pip, "--no-index", "--no-deps", wheel, cwd=work, env=environment)
    (site,) = (folder / "venv").glob("lib/python*/site-packages")
    (site / "installed.pth").write_text(sysconfig.get_path("purelib") + "\n")

    def command(*words: object) -> str:
        """Run the command in the working folder, and return what it reports."""
        return run(folder / "venv" / "bin" / "crowdsim", *words, cwd=work, env=environment).stderr

    where = run(python, "-c", "import crowdsim; print(crowdsim.__file__)", cwd=work, env=environment).stdout
    assert where.strip() == str(site / "crowdsim" / "__init__.py")
    command.site, command.work, command.home = site, work, folder / "home"
    return command


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def unpacked(home: Path, name: str) -> Path:
    """Folder of a bundle in the user's cache."""
    (found,) = home.rglob(f"policies/{name}/policy.json")
    return found.parent


@pytest.mark.slow
def test_the_wheel_holds_every_module_scenario_and_recipe_and_two_packed_policies(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    for path in sorted((ROOT / "crowdsim").rglob("*.py")):
        assert path.relative_to(ROOT).as_posix() in names
    for folder in ("scenarios", "policies"):
        for path in sorted((ROOT / folder).glob("*.yaml")):
            assert f"crowdsim/{folder}/{path.name}" in names
    assert all(f"crowdsim/policies/packed/{name}.json" in names for name in POLICIES)
    assert not [name for name in names if name.endswith((".npy", ".bvh", ".pyc"))]
    assert wheel.stat().st_size <= LIMIT
    assert not (ROOT / "policies" / "packed").exists()


@pytest.mark.slow
def test_git_holds_no_bundle() -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("this is no checkout")
    names = run("git", "ls-files", "policies", cwd=ROOT).stdout.split()
    assert names
    assert all(name.endswith(".yaml") for name in names)


@pytest.mark.slow
def test_a_duel_runs_from_the_wheel_without_training_as_it_does_in_a_checkout(installed, tmp_path) -> None:
    shipped = {path for path in (installed.site / "crowdsim").rglob("*") if "__pycache__" not in path.parts}
    report = installed(*DUEL)
    assert "unpacking policy boxer (once)" in report
    assert "perform" not in report
    assert not [line for line in report.splitlines() if line.startswith(("approach:", "punch:", "fight:"))]
    bundle = unpacked(installed.home, "boxer")
    assert contents(bundle) == contents(ROOT / "policies" / "boxer")
    assert "unpacking" not in installed(*DUEL, "--force")
    assert shipped == {path for path in (installed.site / "crowdsim").rglob("*") if "__pycache__" not in path.parts}

    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run(sys.executable, "-m", "crowdsim.cli", *DUEL, cwd=tmp_path, env=environment)
    ours, theirs = contents(installed.work / "duel"), contents(tmp_path / "duel")
    assert set(ours) == set(theirs)
    # These say how long it took.
    assert {name for name in ours if ours[name] != theirs[name]} <= {"manifest.json", "profile.csv", "checkpoint.bin"}


@pytest.mark.slow
def test_the_policy_of_large_crowds_is_unpacked_as_it_was_trained(installed) -> None:
    report = installed("inspect", "boxer_crowd")
    assert "unpacking policy boxer_crowd (once)" in report
    assert contents(unpacked(installed.home, "boxer_crowd")) == contents(ROOT / "policies" / "boxer_crowd")
