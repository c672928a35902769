"""Reading and writing BVH, beside pybvh, bvhio, numpy.loadtxt and polars.

    python benchmarks/bvh.py [--json] [--quick] [--megabytes 20] [--repeats 5]

The file is made here: a body of 31 joints and 96 channels in smooth synthetic motion, six decimals. Everything runs in
one process, single-threaded except polars, the best of several runs; compilation and imports are not counted.

Reading is from a path to an array of numbers, in megabytes of file per second. The BVH readers also read the
hierarchy; numpy and polars get the line where the numbers begin. Writing is from an array of numbers to text in
memory, in megabytes of text per second; the BVH libraries write only to a file and are compared with the row
`crowdsim, to a file`. bvhio, which is slower than 20 MB/s, is timed on a tenth of the frames.
"""

from __future__ import annotations

import contextlib
import io
import json
import tempfile
from collections.abc import Callable
from pathlib import Path

import bvhio
import numpy as np
import polars
import pybvh
from _quick import best_seconds, command_line

from crowdsim.bvh.io import Bvh, format_bvh, format_motion, from_clip, read_bvh, write_bvh
from crowdsim.motion import quaternion
from crowdsim.motion.skeleton import Clip, Skeleton

JOINTS = 31
DECIMALS = 6


def synthetic_motion(frames: int) -> Bvh:
    """Return a body of 31 joints whose angles swing by sines of many periods, walking along z."""
    rng = np.random.default_rng(1)
    parents = np.array([-1, *(joint - 1 if joint % 6 else 0 for joint in range(1, JOINTS))], np.int32)
    skeleton = Skeleton(tuple(f"joint{joint}" for joint in range(JOINTS)), parents, rng.normal(size=(JOINTS, 3)) * 0.1)
    seconds = np.arange(frames)[:, None, None] / 120.0
    periods, phases = rng.uniform(0.4, 4.0, (2, JOINTS, 3))
    angles = rng.uniform(0.1, 1.0, (JOINTS, 3)) * np.sin(2 * np.pi * seconds / periods + phases)
    roots = np.stack([0.1 * np.sin(seconds[:, 0, 0]), 0.9 + 0 * seconds[:, 0, 0], 1.2 * seconds[:, 0, 0] % 9], axis=-1)
    return from_clip(Clip("synthetic", skeleton, 120.0, roots, quaternion.from_euler(angles, "ZXY")))


def reading(path: Path, short: Path, repeats: int) -> dict[str, float]:
    """Return megabytes a second of each reader."""
    head = 1 + next(n for n, line in enumerate(path.read_bytes().split(b"\n")) if line.startswith(b"Frame Time"))
    contenders: dict[str, tuple[Path, Callable[[Path], object]]] = {
        "crowdsim": (path, read_bvh),
        "pybvh": (path, lambda file: pybvh.read_bvh_file(str(file))),
        "bvhio": (short, lambda file: bvhio.readAsBvh(str(file))),
        "numpy.loadtxt": (path, lambda file: np.loadtxt(file, skiprows=head)),
        "polars": (
            path,
            lambda file: polars.read_csv(file, separator=" ", has_header=False, skip_rows=head).to_numpy(),
        ),
    }
    return {
        name: file.stat().st_size / best_seconds(lambda: work(file), repeats) / 1e6  # noqa: B023
        for name, (file, work) in contenders.items()
    }


def writing(bvh: Bvh, folder: Path, path: Path, short: Path, repeats: int) -> dict[str, float]:
    """Return megabytes a second of each writer."""
    table = polars.DataFrame(bvh.motion)
    pybvh_file = pybvh.read_bvh_file(str(path))
    bvhio_file = bvhio.readAsBvh(str(short))
    out = folder / "out.bvh"
    line = " ".join(["%.6f"] * bvh.channel_count)
    contenders: dict[str, Callable[[], object]] = {
        "crowdsim": lambda: format_motion(bvh.motion, DECIMALS),
        "crowdsim, to a file": lambda: write_bvh(out, bvh, decimals=DECIMALS),
        "pybvh, to a file": lambda: pybvh.write_bvh_file(pybvh_file, str(out)),
        "bvhio, to a file": lambda: bvhio.writeBvh(str(out), bvhio_file, DECIMALS),
        "numpy.savetxt": lambda: np.savetxt(io.BytesIO(), bvh.motion, fmt="%.6f"),
        "'%.6f' % row": lambda: "\n".join(line % tuple(row) for row in bvh.motion.tolist()),
        "polars": lambda: table.write_csv(io.BytesIO(), include_header=False, separator=" ", float_precision=DECIMALS),
    }
    speeds = {}
    for name, work in contenders.items():
        seconds = best_seconds(work, repeats)
        size = out.stat().st_size if name.endswith("file") else len(format_motion(bvh.motion, DECIMALS))
        speeds[name] = size / seconds / 1e6
    return speeds


def measure(megabytes: float, repeats: int) -> dict[str, object]:
    """Return the speeds of all, and how many times faster than each we are."""
    bvh = synthetic_motion(200)
    frames = round(megabytes * 1e6 / (len(format_motion(bvh.motion, DECIMALS)) / 200))
    bvh = synthetic_motion(frames)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path, short = folder / "long.bvh", folder / "short.bvh"
        path.write_bytes(format_bvh(bvh, DECIMALS))
        write_bvh(short, synthetic_motion(frames // 10), decimals=DECIMALS)
        read, write = reading(path, short, repeats), writing(bvh, folder, path, short, repeats)
        size = path.stat().st_size
    return {
        "file": {"megabytes": size / 1e6, "frames": frames, "channels": bvh.channel_count},
        "read_mb_per_s": read,
        "write_mb_per_s": write,
        "read_times_faster_than": {key: read["crowdsim"] / value for key, value in read.items() if key != "crowdsim"},
        "write_times_faster_than": {
            key: write["crowdsim, to a file" if key.endswith("file") else "crowdsim"] / value
            for key, value in write.items()
            if not key.startswith("crowdsim")
        },
    }


def main() -> None:
    parser = command_line(__doc__, "seconds: a small file, read and written twice")
    parser.add_argument("--megabytes", type=float, default=20.0, help="size of the file")
    parser.add_argument("--repeats", type=int, default=5, help="runs of each, of which the best counts")
    options = parser.parse_args()
    if options.quick:
        options.megabytes, options.repeats = min(options.megabytes, 0.4), min(options.repeats, 1)
    with contextlib.redirect_stdout(io.StringIO()):  # some of the others print
        result = measure(options.megabytes, options.repeats)
    if options.json:
        print(json.dumps(result, indent=2))
        return
    file = result["file"]
    print(f"{file['megabytes']:.1f} MB, {file['frames']} frames of {file['channels']} channels\n")  # type: ignore[index]
    for title, key in (("reading", "read"), ("writing", "write")):
        print(f"{title:24} {'MB/s':>8} {'we are faster by':>18}")
        ratios = result[f"{key}_times_faster_than"]
        for name, speed in result[f"{key}_mb_per_s"].items():  # type: ignore[attr-defined]
            ratio = f"{ratios[name]:.1f} x" if name in ratios else ""  # type: ignore[index,operator]
            print(f"{name:24} {speed:8.0f} {ratio:>18}")
        print()


if __name__ == "__main__":
    main()
