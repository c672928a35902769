"""What the first result costs, and what later ones cost.

    python benchmarks/first_result.py [--threads N] [--json] [--quick]

* cold: ``crowdsim run brawl_30`` with nothing compiled and nothing trained, to the prompt: wall time, CPU time of all
  its processes, the most memory that one of them holds, compiled kernels, and how long the command waited for these.
* warm: the same with ``--force``; one control frame of it without outputs, from the command to the prompt; and training
  each shipped policy again.
* reference: importing scipy and Open3D, and numba compiling a function of its own, so that machines can be compared.

Seconds of stages are those that ``crowdsim run --json`` reports. ``outputs`` holds files and megabytes of each output.
With ``--quick`` the policies are small, so is the brawl, and kernels that are compiled already are used.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from _quick import ROOT, command_line, small_policies

QUICK = ("--frames", "60", "--fraction", "0.2")
PROGRAM = "from crowdsim.cli import main; main()"
IMPORTS = "import scipy.spatial, open3d"
COMPILES = """
import numba, time
started = time.perf_counter()
@numba.njit
def total(values):
    result = 0.0
    for i in range(len(values)):
        for j in range(i):
            result += max(values[i], values[j]) ** 0.5
    return result
total.compile((numba.float64[::1],))
print(time.perf_counter() - started)
"""


@contextmanager
def empty(quick: bool) -> Iterator[Path]:
    """Work in a folder with the shipped recipes, none of them trained, and a folder without kernels."""
    before, cache = Path.cwd(), os.environ.get("NUMBA_CACHE_DIR")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        try:
            if quick:
                with small_policies():
                    yield folder / "kernels"
            else:
                os.environ["NUMBA_CACHE_DIR"] = str(folder / "kernels")
                (folder / "policies").mkdir()
                for path in (ROOT / "policies").glob("*.yaml"):
                    shutil.copy(path, folder / "policies")
                os.chdir(folder)
                yield folder / "kernels"
        finally:
            os.environ.pop("NUMBA_CACHE_DIR", None)
            if cache is not None:
                os.environ["NUMBA_CACHE_DIR"] = cache
            os.chdir(before)


def timed(*words: str) -> dict[str, Any]:
    """Run a command of crowdsim; return what it reports, its wall and CPU time [s], and the memory of a process.

    That is the largest process of all commands so far, since that is what the system remembers.
    """
    command = [sys.executable, "-c", PROGRAM, *words, "--json"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    started = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - started
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(done.stderr.strip() or f"crowdsim {' '.join(words)} failed")
    return {
        "report": json.loads(done.stdout),
        "wall_seconds": seconds,
        "cpu_seconds": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "peak_bytes": after.ru_maxrss * (1 if sys.platform == "darwin" else 1024),
    }


def alone(*words: str) -> dict[str, Any]:
    """Return the same of a command that a process of its own has run, so that memory is the command's."""
    program = f"import json, first_result; print(json.dumps(first_result.timed(*{words!r})))"
    path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    environment = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, env=environment)
    if done.returncode:
        sys.exit(done.stderr.strip())
    outcome: dict[str, Any] = json.loads(done.stdout)
    return outcome


def reference() -> dict[str, float]:
    """Return what other software costs here [s], the least of three times."""
    imports, compiles = [], []
    for _ in range(3):
        started = time.perf_counter()
        subprocess.run([sys.executable, "-c", IMPORTS], check=True, capture_output=True)
        imports.append(time.perf_counter() - started)
        done = subprocess.run([sys.executable, "-c", COMPILES], check=True, capture_output=True, text=True)
        compiles.append(float(done.stdout))
    return {"import_seconds": min(imports), "compile_seconds": min(compiles)}


def measure(threads: int, quick: bool) -> dict[str, Any]:
    """Return all figures."""
    each = ("--threads", str(threads))
    words = ("run", "brawl_30", "--out", "brawl_30", *each, *(QUICK if quick else ()))
    capture = os.environ.get("CROWDSIM_MOCAP") is not None
    policies = ("boxer", "boxer_crowd", *(("boxer_cmu",) if capture or quick else ()))
    with empty(quick) as kernels:
        cold = timed(*words)
        compiled = sum(1 for _ in kernels.rglob("*.nbc"))
        # The largest process yet ran the brawl, so that what training holds is read in a process that has only trained.
        trained: dict[str, dict[str, Any]] = {}
        for name in policies:
            # The first training of a policy compiles what the brawl did not need.
            timed("train", name, *each)
            trained[name] = alone("train", name, "--force", *each)
        again = timed(*words, "--force")
        frame = timed("run", "brawl_30", "--frames", "1", "--set", "outputs={}", "--out", "one", *each)
    beside = reference()
    first, later = (one["report"]["runs"][0] for one in (cold, again))
    return {
        "threads": threads,
        "avatars": later["avatars"],
        "control_frames": later["control_frames"],
        "cold": {
            **{key: cold[key] for key in ("wall_seconds", "cpu_seconds", "peak_bytes")},
            "specialisations": compiled,
            "compile_seconds": first["seconds"].get("compile", 0.0),
            "stages": first["seconds"],
            "wall_over_imports": cold["wall_seconds"] / beside["import_seconds"],
        },
        "warm": {
            **{f"train_{name}_seconds": one["wall_seconds"] for name, one in trained.items()},
            "train_peak_bytes": max(one["peak_bytes"] for one in trained.values()),
            "run_seconds": again["wall_seconds"],
            "first_frame_seconds": frame["wall_seconds"],
            "stages": later["seconds"],
            "run_over_imports": again["wall_seconds"] / beside["import_seconds"],
        },
        "reference": beside,
        "outputs": {
            name: {"files": one["files"], "megabytes": one["bytes"] / 1e6} for name, one in later["outputs"].items()
        },
    }


def main() -> None:
    parser = command_line("What the first result costs.", "a minute or two: six avatars, 4 s, small policies")
    parser.add_argument("--threads", type=int, default=min(2, os.cpu_count() or 1))
    options = parser.parse_args()
    outcome = measure(options.threads, options.quick)
    if options.json:
        print(json.dumps(outcome, indent=2))
        return
    cold, warm = outcome["cold"], outcome["warm"]
    print(f"brawl_30, {outcome['avatars']} avatars, {outcome['control_frames']} control frames [s]")
    print(f"{'':<16}{'cold':>9}{'warm':>9}")
    for stage, seconds in cold["stages"].items():
        print(f"{stage:<16}{seconds:9.2f}{warm['stages'].get(stage, 0.0):9.2f}")
    print(f"{'whole command':<16}{cold['wall_seconds']:9.2f}{warm['run_seconds']:9.2f}")
    print(f"cold: {cold['cpu_seconds']:.0f} CPU-seconds, {cold['peak_bytes'] / 1e9:.2f} GB")
    for key, value in warm.items():
        if key.startswith("train_") and key.endswith("_seconds"):
            print(f"{key[6:-8]} trained again: {value:.1f} s")
    print(f"from the command to its first control frame, and the prompt: {warm['first_frame_seconds']:.2f} s")
    print(f"scipy and Open3D imported: {outcome['reference']['import_seconds']:.2f} s")
    for name, one in outcome["outputs"].items():
        print(f"{name}: {one['files']} files, {one['megabytes']:.1f} MB")


if __name__ == "__main__":
    main()
