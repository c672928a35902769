"""Kernels are kept where the user may write, and a read-only installation says where."""

import os
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from crowdsim.jit import environment
from crowdsim.jit.environment import choose_kernel_cache
from crowdsim.jit.folders import source_digest


@pytest.fixture
def read_only(tmp_path, monkeypatch):
    """A package folder that looks read-only; the cache and temporary folders are the test's own."""
    package = tmp_path / "site" / "crowdsim"
    package.mkdir(parents=True)
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(environment.tempfile, "gettempdir", lambda: str(tmp_path / "tmp"))
    really = os.access
    closed = {package}
    monkeypatch.setattr(environment.os, "access", lambda path, mode: Path(path) not in closed and really(path, mode))
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


def test_a_users_cache_that_others_may_write_is_not_taken(read_only, tmp_path):
    package, _ = read_only
    theirs = tmp_path / "cache" / "crowdsim" / "kernels"
    theirs.mkdir(parents=True)
    theirs.chmod(0o777)
    with pytest.warns(RuntimeWarning, match="kept in .*tmp"):
        choose_kernel_cache(package)
    assert Path(os.environ["NUMBA_CACHE_DIR"]).parent.parent == tmp_path / "tmp"


def test_a_temporary_folder_of_somebody_else_is_not_taken(read_only, tmp_path, monkeypatch):
    package, _ = read_only
    (tmp_path / "cache").write_text("in the way")
    theirs = tmp_path / "tmp" / f"crowdsim-{os.getuid()}"
    theirs.mkdir(parents=True)
    theirs.chmod(0o777)
    with pytest.warns(RuntimeWarning, match="every process compiles them again"):
        choose_kernel_cache(package)
    assert os.environ["NUMBA_CACHE_DIR"] == ""


def test_where_the_variable_decides_it_does(read_only, monkeypatch):
    package, _ = read_only
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/somewhere")
    choose_kernel_cache(package)
    assert os.environ["NUMBA_CACHE_DIR"] == "/somewhere"


def test_numba_is_loaded_without_scipys_linear_algebra_which_comes_when_it_is_asked_for():
    program = (
        "import sys; from crowdsim.jit.environment import load_numba; load_numba()\n"
        "assert 'numba.np.arraymath' in sys.modules and 'scipy.linalg' not in sys.modules\n"
        "import scipy.linalg.cython_blas\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr


LEAF = "from {name}.jit import kernel\n\nSTEP = 1.0\n\n\n@kernel\ndef step(x):\n    return x + STEP\n"
CALLER = """from {name}.jit import kernel
from {name}.leaf_kernels import step


@kernel
def twice(x):
    return step(step(x))
"""
OTHER = "from {name}.jit import kernel\n\n\n@kernel\ndef other(x):\n    return x * 2\n"
PROGRAM = """
import sys, {name}.caller_kernels as caller, {name}.other_kernels as other
result = caller.twice(0.0), other.other(2)
hits = [len(kernel.stats.cache_hits) for kernel in (caller.twice, other.other)]
print(*result, *hits)
"""


@pytest.fixture
def package_copy(tmp_path):
    """A package with the decorator and three kernel files, and a function that runs it in a process of its own."""
    folder = tmp_path / "twig"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    shutil.copytree(Path(environment.__file__).parent, folder / "jit", ignore=shutil.ignore_patterns("__pycache__"))
    for path in (folder / "jit").glob("*.py"):
        path.write_text(path.read_text().replace("crowdsim.jit", "twig.jit"))
    for stem, text in (("leaf", LEAF), ("caller", CALLER), ("other", OTHER)):
        (folder / f"{stem}_kernels.py").write_text(text.format(name="twig"))

    def run(**environment):
        done = subprocess.run(
            # Python itself does not notice an edit that leaves time and size of a file as they are.
            [sys.executable, "-B", "-W", "error", "-c", PROGRAM.format(name="twig")],
            capture_output=True, text=True, timeout=120, check=False,
            env={**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": "", **environment},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return [float(word) for word in done.stdout.split()]

    return folder, run


def cached(folder):
    """Folders of compiled code by the file they belong to."""
    found = {}
    for path in folder.rglob("*_kernels-*"):
        found.setdefault(path.name.split("-")[0], []).append(path)
    return found


def test_an_edited_leaf_recompiles_its_callers_and_nothing_else(package_copy):
    folder, run = package_copy
    assert run() == [2.0, 4.0, 0, 0]
    assert run() == [2.0, 4.0, 1, 1]
    leaf = folder / "leaf_kernels.py"
    facts = leaf.stat()
    leaf.write_text(leaf.read_text().replace("STEP = 1.0", "STEP = 5.0"))
    os.utime(leaf, ns=(facts.st_atime_ns, facts.st_mtime_ns))
    assert run() == [10.0, 4.0, 0, 1]
    assert {stem: len(paths) for stem, paths in cached(folder).items()} == {
        "leaf_kernels": 1, "caller_kernels": 1, "other_kernels": 1,
    }  # fmt: skip


def test_an_edited_compiler_recompiles_everything(package_copy):
    folder, run = package_copy
    run()
    compilers = folder / "jit" / "compilers.py"
    compilers.write_text(compilers.read_text() + "\n")
    before = cached(folder)
    assert run() == [2.0, 4.0, 0, 0]
    after = cached(folder)
    assert {stem: len(paths) for stem, paths in after.items()} == dict.fromkeys(before, 1)
    assert not [stem for stem in before if before[stem] == after[stem]]


def test_kernels_of_a_package_that_cannot_be_written_are_kept_elsewhere(package_copy, tmp_path):
    folder, run = package_copy
    elsewhere = tmp_path / "cache"
    assert run(NUMBA_CACHE_DIR=str(elsewhere)) == [2.0, 4.0, 0, 0]
    assert run(NUMBA_CACHE_DIR=str(elsewhere)) == [2.0, 4.0, 1, 1]
    assert not cached(folder)
    assert sorted(cached(elsewhere)) == ["caller_kernels", "leaf_kernels", "other_kernels"]


def run_with(folder, program, *arguments, **environment):
    """What a program prints and reports that imports modules of a folder beside this package."""
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments], capture_output=True, text=True, timeout=120, check=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), *sys.path]), **environment},
    )  # fmt: skip
    return done.stdout.strip(), done.stderr


def test_kernels_that_cannot_be_kept_run_and_are_reported(tmp_path):
    (tmp_path / "plus.py").write_text(OTHER.format(name="crowdsim"))
    (tmp_path / "file").write_text("in the way")
    printed, reported = run_with(
        tmp_path, "import plus; print(plus.other(2))", NUMBA_CACHE_DIR=str(tmp_path / "file" / "cache")
    )
    assert printed == "4"
    assert "compiled kernels cannot be kept in" in reported


def test_fields_of_named_tuples_decide_which_compiled_code_is_loaded(tmp_path):
    (tmp_path / "pair.py").write_text(
        "from crowdsim.jit import kernel\n\n\n@kernel\ndef first(pair):\n    return pair.a\n"
    )
    program = (
        "import collections, sys, pair\n"
        "pair.Pair = collections.namedtuple('Pair', sys.argv[1], module='pair')\n"
        "print(pair.first(pair.Pair(1.0, 2.0)))"
    )
    assert run_with(tmp_path, program, "a b")[0] == "1.0"
    assert run_with(tmp_path, program, "b a")[0] == "2.0"


def test_code_that_kernels_share_is_not_loaded_for_a_class_that_has_moved(tmp_path):
    (tmp_path / "pair.py").write_text(
        "from crowdsim.jit import kernel\n\n\n@kernel\ndef first(pair):\n    return pair.a\n\n\n"
        "@kernel\ndef twice(pair):\n    return 2 * first(pair)\n"
    )
    program = (
        "import collections, sys, types, pair\n"
        "home = sys.modules[sys.argv[1]] = types.ModuleType(sys.argv[1])\n"
        "home.Pair = collections.namedtuple('Pair', 'a b', module=sys.argv[1])\n"
        "print(pair.twice(home.Pair(1.0, 2.0)))"
    )
    for home in ("here", "there"):
        printed, reported = run_with(tmp_path, program, home)
        assert printed == "2.0", reported


def test_kernels_import_names_from_the_module_that_defines_them(tmp_path):
    path = tmp_path / "some_kernels.py"
    path.write_text("from crowdsim.crowd.kernels import layout\n")
    with pytest.raises(ImportError, match=r"crowdsim\.crowd\.kernels is a package"):
        source_digest(path)
