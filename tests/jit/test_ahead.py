"""Kernels are compiled ahead by processes of their own, each once, and a run needs none of them to go on."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from crowdsim import jit
from crowdsim.jit.signatures import decode, digest, encode, listed, resolve

SLOW = """from twig.jit import kernel


@kernel
def leaf(values):
    total = 0.0
    for i in range(len(values)):
        total += values[i]
    return total


@kernel
def {name}(values, pair):
    return leaf(values) + pair[0] * {factor}
"""
ENTRY = {"uses": ["few"], "arguments": ["float64 1C", ["int64", "int64"]]}
CALL = """
import json, sys
import numpy as np
from numba.core import event
compiled = []
class Listener(event.Listener):
    def on_start(self, event): compiled.append(event.data["dispatcher"].py_func.__name__)
    def on_end(self, event): pass
event.register("numba:compile", Listener())
import twig.first_kernels as first, twig.second_kernels as second
results = [first.first(np.ones(3), (1, 2)), second.second(np.ones(3), (1, 2))]
print(json.dumps([results, compiled]))
"""


@pytest.fixture
def twig(tmp_path):
    """A package with the decorator, two kernels that Python calls, and the list of what they are called with."""
    folder = tmp_path / "twig"
    shutil.copytree(Path(jit.__file__).parent, folder / "jit", ignore=shutil.ignore_patterns("__pycache__"))
    for path in (folder / "jit").glob("*.py"):
        path.write_text(path.read_text().replace("crowdsim.jit", "twig.jit"))
    (folder / "__init__.py").write_text("")
    entries = []
    for factor, name in enumerate(("first", "second"), start=1):
        (folder / f"{name}_kernels.py").write_text(SLOW.format(name=name, factor=factor))
        entries.append({"module": f"twig.{name}_kernels", "name": name, **ENTRY})
    (folder / "jit" / "signatures.json").write_text(json.dumps(entries))

    def start(program, **environment):
        return subprocess.Popen(
            [sys.executable, "-c", program],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": "", **environment},
        )  # fmt: skip

    return folder, start


def finish(process):
    """What a process prints, as JSON."""
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    return json.loads(out)


WAIT = """
import json, time
from pathlib import Path
from twig.jit.ahead import compile_ahead
with compile_ahead(["few"], 2) as missing:
    until = time.monotonic() + 60
    while time.monotonic() < until:
        names = {path.name.split(".")[0] for path in Path("twig").rglob("*.nbc") if ".part." not in path.name}
        if names == {"first", "second"}:
            break
        time.sleep(0.05)
with compile_ahead(["few"], 2) as later:
    pass
print(json.dumps([missing, later, sorted(names)]))
"""


def test_workers_compile_what_is_listed_and_python_loads_it(twig):
    _, start = twig
    missing, later, names = finish(start(WAIT))
    assert missing == "compiling 2 kernels, which takes about 2 s on 2 cores and is done once"
    assert (later, names) == ("", ["first", "second"])
    assert finish(start(CALL)) == [[4.0, 5.0], []]


def test_workers_do_not_import_from_the_folder_that_a_command_is_called_in(twig):
    folder, _ = twig
    decoy = folder.parent / "checkout"
    (decoy / "twig").mkdir(parents=True)
    (decoy / "twig" / "__init__.py").write_text("raise ImportError('a checkout of another version')")
    program = "import sys; sys.path = [path for path in sys.path if path]\n" + WAIT.replace('"twig"', repr(str(folder)))
    environment = {**os.environ, "PYTHONPATH": str(folder.parent), "NUMBA_CACHE_DIR": ""}
    done = subprocess.run([sys.executable, "-c", program], cwd=decoy, env=environment, capture_output=True, text=True)
    assert json.loads(done.stdout)[1:] == ["", ["first", "second"]], done.stderr


def test_processes_at_the_same_time_compile_each_kernel_once(twig):
    _, start = twig
    outcomes = [finish(process) for process in [start(CALL) for _ in range(3)]]
    assert [results for results, _ in outcomes] == [[4.0, 5.0]] * 3
    compiled = sorted(name for _, names in outcomes for name in names)
    assert compiled == ["first", "leaf", "leaf", "second"]


KILLED = """
import json, os, signal, subprocess
import numpy as np
from twig.jit import ahead
started = []
start = ahead._start
def note(number, uses):
    started.append(start(number, uses))
    return started[-1]
ahead._start = note
with ahead.compile_ahead(["few"], 2):
    for process in started:
        process.send_signal(signal.SIGKILL)
    import twig.first_kernels as first
    result = first.first(np.ones(3), (1, 2))
print(json.dumps([result, len(started)]))
"""


def test_a_run_goes_on_where_the_workers_are_killed(twig):
    _, start = twig
    assert finish(start(KILLED)) == [4.0, 2]


def test_a_list_of_another_version_harms_nothing(twig):
    folder, start = twig
    entries = [{"module": "twig.first_kernels", "name": "gone", **ENTRY}, {"module": "twig.gone", "name": "x", **ENTRY}]
    (folder / "jit" / "signatures.json").write_text(json.dumps(entries))
    program = "import sys; sys.argv = ['', str(__import__('os').getppid()), '0', 'few']\n"
    assert finish(start(program + "from twig.jit.ahead import work; work(); print('[]')")) == []
    assert finish(start(CALL))[0] == [4.0, 5.0]


def test_workers_end_with_the_process_that_started_them(twig):
    _, start = twig
    program = "from twig.jit.ahead import work; work(); print('[]')"
    begun = time.monotonic()
    assert finish(start(f"import sys; sys.argv = ['', '1', '0', 'few']\n{program}")) == []
    assert time.monotonic() - begun < 30
    assert finish(start(CALL))[1], "nothing was compiled ahead"


def test_the_list_names_kernels_and_types_that_there_are():
    entries = listed()
    for (kernel, signature), entry in zip(resolve(entries), entries, strict=True):
        assert kernel.py_func.__qualname__ == entry.name
        assert [encode(kind) for kind in signature] == entry.arguments
    crowds = {f"{size} {table}" for size in ("few", "many") for table in ("float32", "uint16", "uint8")}
    assert {use for entry in entries for use in entry.uses} == {
        "training",
        "bvh",
        "clouds",
        "bodies",
        "pictures",
        *crowds,
    }


def test_each_type_of_a_table_has_kernels_of_its_own():
    loops = {use: entry for entry in listed() if entry.name == "run_frames" for use in entry.uses}
    assert set(loops) == {"few float32", "few uint16", "few uint8"}
    assert len({digest(entry.arguments) for entry in loops.values()}) == 3


def test_a_kernel_compiled_for_other_arguments_is_compiled_ahead(twig):
    folder, start = twig
    assert finish(start(CALL))[1]
    path = folder / "jit" / "signatures.json"
    entries = json.loads(path.read_text())
    path.write_text(json.dumps([{**entries[0], "arguments": ["float32 1C", ["int64", "int64"]]}, *entries]))
    count = "from twig.jit.ahead import _is_compiled; from twig.jit.signatures import listed\n"
    program = count + "print([_is_compiled(one) for one in listed()].count(False))"
    assert finish(start(program)) == 1
    work = (
        "import sys; sys.argv = ['', str(__import__('os').getppid()), '0', 'few']\n"
        "from twig.jit.ahead import work; work()\n"
    )
    assert finish(start(work + program)) == 0


def test_types_of_arguments_come_back_from_their_text():
    from numba import typeof

    read_only = np.zeros((2, 3), np.float32)
    read_only.flags.writeable = False
    records = np.zeros((2, 3), [("kind", np.int64), ("weight", np.float32), ("wraps", bool)])
    several = read_only, np.zeros(3, bool), np.asfortranarray(np.zeros((2, 2))), records
    for value in (*several, 1, 2.5, True, None, (1, 2.0)):
        assert decode(json.loads(json.dumps(encode(typeof(value))))) == typeof(value)
    with pytest.raises((TypeError, AttributeError)):
        encode(typeof([1]))


FAST = """from twig.jit import kernel

FLAGS = {"reassoc", "contract", "nsz"}


@kernel(fastmath=FLAGS)
def part(values, i):
    return values[i] * 1.1 + values[i - 1] * 0.7 - values[i - 2] * 0.3


@kernel(fastmath=FLAGS)
def total(values):
    result = 0.0
    for i in range(2, len(values)):
        result += part(values, i) * part(values, i - 1)
    return result
"""
SUM = """
import numpy as np
import twig.fast_kernels as fast
print('"' + fast.total(np.sin(np.arange(1000.0))).hex() + '"')
"""


def test_results_have_the_same_bits_whether_what_a_kernel_calls_was_kept_or_not(twig):
    folder, start = twig
    (folder / "fast_kernels.py").write_text(FAST)
    fresh = finish(start(SUM))
    compiled = [path for path in folder.rglob("total.*.nbc") if ".part." not in path.name]
    assert len(compiled) == 1
    compiled[0].unlink()
    assert finish(start(SUM)) == fresh
    assert compiled[0].is_file()


def test_where_no_worker_can_be_started_a_run_goes_on(twig):
    _, start = twig
    program = """
import json
import numpy as np
from twig.jit import ahead
def fail(number, uses):
    raise BlockingIOError("no more processes")
ahead._start = fail
with ahead.compile_ahead(["few"], 2):
    import twig.first_kernels as first
    print(json.dumps(first.first(np.ones(3), (1, 2))))
"""
    assert finish(start(program)) == 4.0


def test_a_worker_that_does_not_stop_is_ended(twig):
    _, start = twig
    program = """
import json, subprocess, sys, time
from twig.jit import ahead
slow = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print(flush=True); time.sleep(60)"
def begin(number, uses):
    process = subprocess.Popen([sys.executable, "-c", slow], stdout=subprocess.PIPE)
    process.stdout.readline()
    return process
ahead._start = begin
with ahead.compile_ahead(["few"], 2):
    begun = time.monotonic()
print(json.dumps(time.monotonic() - begun))
"""
    assert finish(start(program)) < 10
