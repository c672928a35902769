"""Runs that are measured: scenarios that are run here, and the files of the motion behind a run."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import zarr

from _exported.run import ExportedRun, read_run
from crowdsim.assets import find_bundle


def crowdsim(*words: str) -> str:
    """Call the command line and return what it prints.

    Raises:
        ValueError: It failed.
    """
    program = "from crowdsim.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise ValueError(done.stderr.strip() or f"crowdsim {' '.join(words)} failed")
    return done.stdout


def run_scene(
    name: str,
    fps: int,
    frames: int | None,
    folder: Path,
    mocap: Path | None,
    most: int | None = None,
    seed: int | None = None,
) -> Path:
    """Run a scenario with BVH files as its only output, and with at most ``most`` avatars; return its folder.

    ``seed`` is another one than the scenario's.
    """
    from crowdsim import load_scenario, run_to

    overrides = ["outputs.ply=null", f"outputs.bvh.fps={fps}"]
    if frames is not None:
        overrides.append(f"duration={frames}")
    if seed is not None:
        overrides.append(f"seed={seed}")
    scenario = load_scenario(name, overrides)
    if most is not None:
        scenario = load_scenario(name, overrides, fraction=min(1.0, most / scenario.avatar_count))
        # Small policies have no falls: an avatar that is knocked down would leave.
        types = {key: kind.model_copy(update={"damage": None}) for key, kind in scenario.types.items()}
        scenario = scenario.model_copy(update={"types": types, "until": None})
    run_to(folder / name, scenario, mocap=mocap)
    return folder / name


def source_clips(bundle: Path, folder: Path, mocap: Path | None) -> list[Path]:
    """Return the files of the motion that a policy was trained on; the performer's are performed again in ``folder``.

    Raises:
        ValueError: The performer is left-handed, or there is no folder with the capture.
    """
    motion = json.loads((bundle / "policy.json").read_text())["recipe"]["motion"]
    performer = motion.get("performer")
    if performer is not None:
        if performer["stance"] != "orthodox":
            raise ValueError(f"{bundle}: a {performer['stance']} performer is beyond this benchmark")
        session = {key: str(performer[key]) for key in ("seconds", "seed", "falls", "rests")}
        out = folder / "_".join(["performer", *session.values()])
        if not out.exists():
            given = [word for key, value in session.items() for word in (f"--{key}", value)]
            crowdsim("perform", *given, "--out", str(out))
        return sorted(out.glob("*.bvh"))
    if mocap is None:
        raise ValueError(f"{bundle}: was trained on capture, expected --mocap or CROWDSIM_MOCAP")
    return sorted(path for pattern in motion["capture"]["clips"] for path in Path(mocap).glob(pattern))


def bundle_of(run: Path, policies: Path | None) -> Path:
    """Return the bundle of a run's policy, in a folder of bundles or where runs find them.

    Raises:
        ValueError: The run has several policies.
    """
    group: Any = zarr.open_group(store=str(run / "take.zarr"), mode="r")
    names = group.attrs["policy_names"]
    if len(names) != 1:
        raise ValueError(f"{run}: has {len(names)} policies, expected one")
    return find_bundle(names[0]) if policies is None else policies / names[0]


def open_exported(run: Path, policies: Path | None, folder: Path, mocap: Path | None) -> ExportedRun:
    """Read a run: BVH files, take, bundle and source."""
    bundle = bundle_of(run, policies)
    return read_run(run, bundle, source_clips(bundle, folder, mocap))
