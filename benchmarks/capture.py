"""How surely faults of capture are found, repaired, and not seen where there are none.

    python benchmarks/capture.py [--json] [--quick] [--clips 30]

Clean clips are those of the embedded boxer and, where CROWDSIM_MOCAP names a folder, the capture in it; and of each
clip versions that are as clean: mirrored, scaled, rotated, re-timed. Faults are made in every clean clip. A fault
counts as found where its kind is among the findings, as repaired where the motion that comes out is that of the clean
clip (joints within 4 % of the body's height of where they should be against the pelvis, and the pelvis's velocity as
close), and as refused where the file would not be trained on. A finding about a clean version is a false alarm.
"""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from _capture_faults import FAULTS, clean_twins
from _quick import command_line

from crowdsim.bvh.io import Bvh, write_bvh
from crowdsim.capture.faults import FAULTS as KINDS
from crowdsim.capture.loading import Capture, load_capture
from crowdsim.core.types import Array
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.performer.session import perform

LONGEST = 8.0
"""Time of each clip that is used [s]."""
CLOSE = 0.04
"""Share of the body's height within which a repaired motion is that of the clean clip."""


def sources(clips: int) -> list[tuple[str, Capture]]:
    """Return clean clips by name: the boxer's, then those of CROWDSIM_MOCAP."""
    found = []
    with tempfile.TemporaryDirectory() as name:
        for performance in perform(60.0, 1, falls=1, rests=1):
            path = Path(name) / f"{performance.clip.name}.bvh"
            write_bvh(path, performance.clip)
            found.append((path.stem, load_capture(path)))
    folder = os.environ.get("CROWDSIM_MOCAP")
    paths = sorted(Path(folder).rglob("*.bvh")) if folder else []
    found += [(path.stem, load_capture(path)) for path in paths]
    step = max(1, -(-len(found) // clips))
    return found[::step]


def measure(clips: int, kinds: list[str] | None = None) -> dict[str, Any]:
    """Return what is found, repaired and refused of each fault, and the false alarms about each clean version."""
    faults = {
        name: {"kind": kind, "made": 0, "found": 0, "repaired": 0, "refused": 0, "missed": []}
        for name, (kind, _) in FAULTS.items()
    }
    clean: dict[str, dict[str, Any]] = {}
    found = sources(clips)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "clip.bvh"
        for name, source in found:
            assert source.body is not None
            motion = source.motion.sliced(0, round(LONGEST * source.clip.fps))
            twins = dict(clean_twins(motion, source.body))
            for version, bvh in twins.items():
                row = clean.setdefault(version, {"files": 0, "alarms": 0, "alarmed": []})
                alarms = [outcome.words for outcome in written(path, bvh).diagnoses]
                row["files"] += 1
                row["alarms"] += bool(alarms)
                row["alarmed"] += [f"{name}: {alarm}" for alarm in alarms]
            plain = twins["as it is"]
            true = written(path, plain)
            for fault, (kind, change) in FAULTS.items():
                if kinds is None or kind in kinds:
                    judge(faults[fault], name, true, written(path, change(plain)))
    return {
        "clips": len(found),
        "seconds": sum(min(LONGEST, source.motion.seconds) for _, source in found),
        "kinds": [kind.name for kind in KINDS],
        "faults": {name: row for name, row in faults.items() if row["made"]},
        "clean": clean,
    }


def written(path: Path, bvh: Bvh) -> Capture:
    """Write a file and read it as a user does."""
    write_bvh(path, bvh)
    return load_capture(path)


def judge(row: dict[str, Any], name: str, true: Capture, capture: Capture) -> None:
    """Count one faulty file."""
    row["made"] += 1
    outcomes = {outcome.diagnosis.fault: outcome for outcome in capture.diagnoses}
    hit = row["kind"] in outcomes or (row["kind"] == "ends" and capture.lead_in > true.lead_in)
    row["found"] += hit
    refused = bool(capture.faults)
    row["refused"] += refused
    restored = not refused and is_restored(true, capture)
    row["repaired"] += restored
    if not (hit and (restored or refused)):
        row["missed"].append(f"{name}: {', '.join(outcomes) or 'nothing found'}")


def is_restored(true: Capture, capture: Capture) -> bool:
    """Return whether the motion is that of a clean clip, where it stands and which way it looks left aside."""
    if capture.body is None or true.body is None or abs(capture.clip.fps / true.clip.fps - 1.0) > 1e-3:
        return False
    first = [span for span in capture.spans if span[1] - span[0] > 4]
    lead = capture.clip.frame_count - true.clip.frame_count
    shift = lead if capture.lead_in >= lead > 0 else 0
    for start, stop in first:
        start, stop = max(start, shift), min(stop, true.clip.frame_count + shift)
        ours, theirs = (
            poses(one, slice(a, b)) for one, a, b in ((capture, start, stop), (true, start - shift, stop - shift))
        )
        if any(np.abs(a - b).max() > CLOSE * true.body.height for a, b in zip(ours, theirs, strict=True)):
            return False
    return bool(first)


def poses(capture: Capture, frames: slice) -> tuple[Array, Array]:
    """Distances between the pelvis and all joints, with heights, and the pelvis's moves in a tenth of a second [m]."""
    assert capture.body is not None
    positions = clip_kinematics(capture.clip.sliced(frames.start, frames.stop))[0]
    pelvis = positions[:, capture.roles["pelvis"]]
    joints = [joint for role, joint in sorted(capture.roles.items())]
    away = positions[:, joints] - pelvis[:, None]
    step = max(1, min(round(0.1 * capture.clip.fps), len(pelvis) - 1))
    moves = pelvis[step:] - pelvis[:-step]
    shape = np.stack([np.linalg.norm(away[..., [0, 2]], axis=-1), away[..., 1]], axis=-1)
    return shape, np.stack([np.linalg.norm(moves[:, [0, 2]], axis=1), moves[:, 1]], axis=-1)


def main() -> None:
    parser = command_line(__doc__, "seconds: three clips")
    parser.add_argument("--clips", type=int, default=30, help="clean clips, at the most")
    parser.add_argument("--kinds", help="kinds of faults, by commas; all by default")
    options = parser.parse_args()
    result = measure(3 if options.quick else options.clips, options.kinds.split(",") if options.kinds else None)
    if options.json:
        print(json.dumps(result, indent=2))
        return
    print(f"{result['clips']} clean clips, {result['seconds']:.0f} s\n")
    print(f"{'fault':46} {'files':>6} {'found':>6} {'repaired':>9} {'refused':>8}")
    for name, row in result["faults"].items():
        print(f"{name:46} {row['made']:6} {row['found']:6} {row['repaired']:9} {row['refused']:8}")
        for missed in row["missed"]:
            print(f"    {missed[:190]}")
    print(f"\n{'clean version':46} {'files':>6} {'false alarms':>13}")
    for name, row in result["clean"].items():
        print(f"{name:46} {row['files']:6} {row['alarms']:13}")
        for alarm in row["alarmed"]:
            print(f"    {alarm[:190]}")


if __name__ == "__main__":
    main()
