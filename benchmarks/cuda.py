"""Control on a GPU beside the same machine's processor: what a control frame costs, and whether the bytes are equal.

    python benchmarks/cuda.py [--avatars NUMBERS] [--frames N] [--json] [--quick]

Crowds are those of ``crowd_1m``, as dense as there, with everything that it asks for. Times are medians of frames, with
the record in the memory of the machine; stages are timed in a run of their own, in which the GPU is waited for after
each. Compiling is timed apart, and is 0 where kernels were kept. Without a GPU, a line says what is missing, with exit
code 77.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from _quick import command_line, small_policies
from run_all import LACKING

from crowdsim.core.workers import CORES
from crowdsim.crowd.chunk import STAGES
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.cuda.device import choose_device
from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.jit_warmup import warm_up
from crowdsim.crowd.profiling import parse_counts, with_avatars
from crowdsim.crowd.simulation import Simulation
from crowdsim.errors import CrowdsimError
from crowdsim.preparation.prepare import load_policies
from crowdsim.scenario.scenario import load_scenario

SKIPPED = 8
"""Frames before those that are timed; in the first one everyone decides."""


def run(crowd: Crowd, model: Any, device: str, threads: int, frames: int, profiled: bool) -> dict[str, Any]:
    """Return the median time of a frame and of its stages [ms], a digest of the record and of strikes, and memory."""
    digest, times, stages = hashlib.sha256(), [], []
    with Simulation(crowd, threads, "kd_tree", profiled=profiled, model=model, device=device) as simulation:
        for frame in range(SKIPPED + frames):
            begun = time.perf_counter()
            chunk = simulation.run(1)
            spent = time.perf_counter() - begun
            for values in (*chunk.variables().values(), *vars(chunk.events).values()):
                digest.update(np.ascontiguousarray(values).tobytes())
            if frame >= SKIPPED:
                times.append(spent)
                stages += [] if chunk.timings is None else [chunk.timings[0]]
        found = {"milliseconds": float(np.median(times)) * 1e3, "digest": digest.hexdigest()}
        found["bytes_per_avatar"] = simulation.nbytes / crowd.count
    if profiled:
        found["stage_ms"] = dict(zip(STAGES, np.median(stages, axis=0) * 1e-6, strict=True))
    return found


def measure(crowd: Crowd, frames: int) -> dict[str, Any]:
    """Return what a control frame of a crowd costs on the GPU, on two threads, and on all of them."""
    begun = time.perf_counter()
    model = warm_up(crowd, "kd_tree", False, "cuda")
    compiling = time.perf_counter() - begun
    warm_up(crowd, "kd_tree")
    ours = run(crowd, model, "cuda", CORES, frames, False)
    two = run(crowd, model, "cpu", 2, frames, False)
    return {
        "milliseconds": ours["milliseconds"],
        "stage_ms": run(crowd, model, "cuda", CORES, frames, True)["stage_ms"],
        "cpu_2t_milliseconds": two["milliseconds"],
        "cpu_all_milliseconds": run(crowd, model, "cpu", CORES, frames, False)["milliseconds"],
        "digest_equal": ours["digest"] == two["digest"],
        "bytes_per_avatar": ours["bytes_per_avatar"],
        "compile_seconds": compiling,
    }


def card() -> str:
    """Return the name of the GPU, and what it draws where that can be read."""
    from numba import cuda

    name = cuda.get_current_device().name
    text = name.decode() if isinstance(name, bytes) else str(name)
    if shutil.which("nvidia-smi"):
        asked = ["nvidia-smi", "--query-gpu=power.draw", "--format=csv,noheader"]
        watts = subprocess.run(asked, capture_output=True, text=True, check=False).stdout.strip()
        text += f", {watts.splitlines()[0]}" if watts else ""
    return text


def main() -> None:
    """Measure, and print a table or JSON."""
    # The packages of CUDA are named ``cuda``, as this file is.
    sys.path.remove(str(Path(__file__).resolve().parent))
    parser = command_line(__doc__, "seconds: small crowds, few frames, small policies")
    parser.add_argument("--avatars", default="1k,10k,100k,1m,10m", help="numbers of avatars")
    parser.add_argument("--frames", type=int, default=30, help="frames that are timed")
    arguments = parser.parse_args()
    counts = [200, 1000] if arguments.quick else parse_counts(arguments.avatars, "--avatars")
    frames = 3 if arguments.quick else arguments.frames
    try:
        choose_device("cuda", max(counts))
    except CrowdsimError as error:
        print(error, file=sys.stderr)
        sys.exit(LACKING)
    with ExitStack() as stack:
        if arguments.quick:
            stack.enter_context(small_policies())
        scenario = load_scenario("crowd_1m")
        policies = load_policies(scenario)
        found: dict[str, Any] = {"device": card(), "threads": CORES}
        for count in counts:
            found[str(count)] = measure(draw_crowd(with_avatars(scenario, count), policies), frames)
    if arguments.json:
        print(json.dumps(found))
        return
    print(f"{found['device']}; {CORES} threads of the processor")
    print(f"{'avatars':>12}{'GPU':>10}{'2 threads':>12}{'all':>10}   equal   bytes/avatar   stages [ms]")
    for count in counts:
        one = found[str(count)]
        stages = ", ".join(f"{name} {value:.2f}" for name, value in one["stage_ms"].items())
        times = f"{one['milliseconds']:>10.2f}{one['cpu_2t_milliseconds']:>12.2f}{one['cpu_all_milliseconds']:>10.2f}"
        print(f"{count:>12,}{times}   {one['digest_equal']!s:<5}   {one['bytes_per_avatar']:>12.0f}   {stages}")


if __name__ == "__main__":
    main()
