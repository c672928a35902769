"""Whether a change keeps results byte for byte: digests of what the performer, policies and shipped scenarios give.

    python tests/digests.py --write before.json       # with the code as it was
    python tests/digests.py --compare before.json     # with the change; exits with 1 where something differs

Takes, exports and pictures of every shipped scenario, arrays of every trained policy, clips of the performer. Left out
are files that hold timings (manifests, profiles, checkpoints) or what results were made from (lists of outputs, the
description of a policy).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
LEFT_OUT = {"manifest.json", ".crowdsim-outputs.json", "profile.csv", "checkpoint.bin", "policy.json", "timings.json"}


class Scene(NamedTuple):
    """What is made of a scenario.

    Attributes:
        frames: Control frames.
        exports: What is exported, clouds of every tenth frame.
        pictures: Output frames that are drawn.
        scenario: The scenario, where it is not called as the scene is.
        sets: What is changed in it.
        fraction: Share of the avatars.
        extend: Control frames by which the run is extended.
    """

    frames: int
    exports: tuple[str, ...] = ()
    pictures: str = ""
    scenario: str = ""
    sets: tuple[str, ...] = ()
    fraction: float = 1.0
    extend: int = 0


SCENES = {
    "duel": Scene(400, ("--bvh", "--ply", "--pcd"), "0:60", extend=200),
    "moving_target": Scene(300, ("--bvh",), "100:110"),
    "moving_target_fast": Scene(300, ("--bvh",), "100:110"),
    "bout": Scene(1500, ("--bvh",), "900:906"),
    "defenders": Scene(600, ("--bvh",), "300:306", "duel", ("types.boxer.policy=boxer_defender",)),
    "brawl_30": Scene(600, ("--pcd",), "300:306"),
    "builds": Scene(
        300,
        ("--bvh", "--ply"),
        "200:206",
        "brawl_30",
        tuple(
            f"types.boxer.{key}={{kind: normal, mean: 1, deviation: 0.04}}"
            for key in ("scale", "girth", "legs", "arms", "speed")
        ),
    ),
    "brawl_last_standing": Scene(600, ("--bvh",), "300:306"),
    "brawl_30_cmu": Scene(600, ("--ply",), "300:306"),
    "armies_200": Scene(120, ("--bvh",), "100:102"),
    "crowd_10k": Scene(60, (), "50:51"),
    "crowd_100k": Scene(30),
    "crowd_1m": Scene(10, fraction=0.3),
}


def digest(folder: Path) -> str:
    """Return one digest of the names and bytes of all files below a folder, but for files that hold timings."""
    total = hashlib.sha256()
    for path in sorted(item for item in folder.rglob("*") if item.is_file() and item.name not in LEFT_OUT):
        total.update(f"{path.relative_to(folder).as_posix()}\0{path.stat().st_size}\0".encode())
        total.update(path.read_bytes())
    return total.hexdigest()


def command(*arguments: str) -> None:
    """Run a command of this checkout's crowdsim; a failure ends the program."""
    program = "from crowdsim.cli import main; main()"
    subprocess.run([sys.executable, "-c", program, *arguments, "--quiet"], check=True, cwd=ROOT, stdout=sys.stderr)


def measure(names: list[str]) -> dict[str, str]:
    """Return the digests of the named scenes, of the performer and of all trained policies."""
    found: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        command("perform", "--seconds", "60", "--seed", "3", "-o", str(folder / "performer"))
        found["performer"] = digest(folder / "performer")
        for scene in names:
            about, run = SCENES[scene], folder / scene
            sets = [item for change in about.sets for item in ("--set", change)]
            amount = ["--frames", str(about.frames), "--fraction", str(about.fraction)]
            command("run", about.scenario or scene, "--out", str(run), *amount, *sets)
            if about.extend:
                command("run", about.scenario or scene, "--out", str(run), *sets, "--extend", str(about.extend))
            found[f"{scene}: run"] = digest(run)
            if about.exports:
                out = folder / f"{scene}_export"
                every = [] if about.exports == ("--bvh",) else ["--every", "10"]
                command("export", str(run), *about.exports, *every, "--out", str(out))
                found[f"{scene}: export"] = digest(out)
            if about.pictures:
                out = folder / f"{scene}_pictures"
                command("render", str(run), "--png", "--frames", about.pictures, "--size", "320x180", "--out", str(out))
                found[f"{scene}: pictures"] = digest(out)
            print(scene, file=sys.stderr)
    for policy in sorted((ROOT / "policies").glob("*/policy.json")):
        found[f"policy {policy.parent.name}"] = digest(policy.parent)
    return found


def main() -> int:
    """Write digests to a file, or compare with those of one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", choices=[[], *SCENES], default=[], help="scenes; all by default")
    way = parser.add_mutually_exclusive_group(required=True)
    way.add_argument("--write", type=Path, metavar="FILE")
    way.add_argument("--compare", type=Path, metavar="FILE")
    options = parser.parse_args()
    found = measure(options.scenes or list(SCENES))
    if options.write:
        options.write.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
        return 0
    before = json.loads(options.compare.read_text(encoding="utf-8"))
    different = [key for key, value in found.items() if before.get(key) != value]
    print("\n".join(f"differs: {key}" for key in different) or f"{len(found)} digests agree")
    return bool(different)


if __name__ == "__main__":
    sys.exit(main())
