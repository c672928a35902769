"""Kernels are kept where the user may write, and a read-only installation says where."""

import os
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from crowdsim import jit
from crowdsim.jit import choose_kernel_cache


@pytest.fixture
def read_only(tmp_path, monkeypatch):
    """A package folder that looks read-only; the cache and temporary folders are the test's own."""
    package = tmp_path / "site" / "crowdsim"
    package.mkdir(parents=True)
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(jit.tempfile, "gettempdir", lambda: str(tmp_path / "tmp"))
    really = os.access
    closed = {package}
    monkeypatch.setattr(jit.os, "access", lambda path, mode: Path(path) not in closed and really(path, mode))
    from numba import config

    monkeypatch.setattr(config, "CACHE_DIR", config.CACHE_DIR)
    return package, closed


def test_beside_a_package_that_can_be_written_nothing_changes(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        choose_kernel_cache(tmp_path)
    assert os.environ["NUMBA_CACHE_DIR"] == ""


def test_a_read_only_package_keeps_kernels_in_the_users_cache_and_warns(read_only, tmp_path):
    package, _ = read_only
    with pytest.warns(RuntimeWarning, match="is read-only; compiled kernels are kept in"):
        choose_kernel_cache(package)
    assert Path(os.environ["NUMBA_CACHE_DIR"]) == tmp_path / "cache" / "crowdsim" / "kernels"
    assert Path(os.environ["NUMBA_CACHE_DIR"]).is_dir()


def test_without_a_cache_they_go_to_a_temporary_folder_of_the_user_alone(read_only, tmp_path):
    package, _ = read_only
    (tmp_path / "cache").write_text("in the way")
    with pytest.warns(RuntimeWarning, match="kept in .*tmp"):
        choose_kernel_cache(package)
    place = Path(os.environ["NUMBA_CACHE_DIR"])
    assert place.parent.parent == tmp_path / "tmp"
    assert place.stat().st_mode & 0o077 == 0


def test_a_temporary_folder_of_somebody_else_is_not_taken(read_only, tmp_path, monkeypatch):
    package, _ = read_only
    (tmp_path / "cache").write_text("in the way")
    theirs = tmp_path / "tmp" / f"crowdsim-{os.getuid()}"
    theirs.mkdir(parents=True)
    theirs.chmod(0o777)
    choose_kernel_cache(package)
    assert os.environ["NUMBA_CACHE_DIR"] == ""


def test_where_the_variable_decides_it_does(read_only, monkeypatch):
    package, _ = read_only
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/somewhere")
    choose_kernel_cache(package)
    assert os.environ["NUMBA_CACHE_DIR"] == "/somewhere"


def test_numba_is_loaded_without_scipys_linear_algebra_which_comes_when_it_is_asked_for():
    program = (
        "import sys; from crowdsim.jit import load_numba; load_numba()\n"
        "assert 'numba.np.arraymath' in sys.modules and 'scipy.linalg' not in sys.modules\n"
        "import scipy.linalg.cython_blas\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
