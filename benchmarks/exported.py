"""Figures of exported motion, measured from the BVH files by independent code.

    python benchmarks/exported.py [RUN ...] [--mocap DIR] [--frames 450] [--seconds 0.4] [--quick] [--json]

Without a RUN, `brawl_30`, `armies_200` and, with --mocap or CROWDSIM_MOCAP, `brawl_30_cmu` are run here with BVH as
their only output. A reader in this folder, in plain numpy, reads and poses the files. The take gives strikes and
decisions, the policy's bundle gives body sizes and where actions begin in the capture, and `crowdsim perform` or the
capture's files give the captured motion. The package's own code is used only for the figures of `crowdsim inspect`
that are printed beside these. The captured motion is measured in the same way.

- Calm frames: a second or more from transitions and strikes, where the files must equal the captured motion.
- Feet: a foot is in contact while its ball is lower than 3 cm and rises or falls slower than 0.15 m/s; its slide is
  the horizontal speed of the ball during contact.
- Knees and elbows: flexion towards the side to which the capture bends them; `clips_with_backward_hinges` are clips of
  the capture whose knees fold forward or whose elbows fold backward in the files; such elbows are corrected first.
- Peaks: the greatest speed and acceleration of any joint over the greatest in the capture.
- Fists: distance of the middle of the striking fist from the surface of head or torso at the time of the strike.
- Bodies: overlap of discs of 0.2 m around pelvises, of torso capsules (pelvis to neck) and of heads, as a share of
  avatar-frames.
- Transitions: area under the ROC curve of a classifier of windows around transitions and around other decisions;
  `content` is the same for the captured motion behind them. See `_transition_classifier.py`.

All avatars of a run must use one policy and be present from its start to its end.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from _exported_measures import Stage, feet, fists, hinges, overlap, peaks, undisturbed
from _quick import small_policies
from _transition_classifier import classify_transitions
from _witness import Sizes, read_figure, read_sizes, read_source

from crowdsim.assets import find_bundle
from crowdsim.core.types import Array

SCENES = {"brawl_30": 60, "brawl_30_cmu": 60, "armies_200": 30}
"""What is run without a RUN, and frames a second of its files."""
QUICK, FEW = 150, 8
"""Control frames and avatars of a quick run."""


def crowdsim(*words: str) -> str:
    """Call the command line."""
    program = "from crowdsim.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(done.stderr.strip() or f"crowdsim {' '.join(words)} failed")
    return done.stdout


def play(name: str, fps: int, frames: int | None, folder: Path, mocap: Path | None, most: int | None = None) -> Path:
    """Run a scenario with BVH files as its only output, and no more avatars than ``most``."""
    from crowdsim import load_scenario, run_to

    overrides = ["outputs.ply=null", f"outputs.bvh.fps={fps}"]
    if frames is not None:
        overrides.append(f"duration={frames}")
    scenario = load_scenario(name, overrides)
    if most is not None:
        scenario = load_scenario(name, overrides, fraction=min(1.0, most / scenario.avatar_count))
    run_to(folder / name, scenario, mocap=mocap)
    return folder / name


def clips_of(bundle: Path, folder: Path, mocap: Path | None) -> list[Path]:
    """The files of the motion that a policy was trained on; the performer's are performed again."""
    motion = json.loads((bundle / "policy.json").read_text())["recipe"]["motion"]
    performer = motion.get("performer")
    if performer is not None:
        if performer["stance"] != "orthodox":
            sys.exit(f"{bundle}: a {performer['stance']} performer is beyond this benchmark")
        out = folder / f"performer_{performer['seed']}_{performer['seconds']:g}"
        if not out.exists():
            words = ("--seconds", str(performer["seconds"]), "--seed", str(performer["seed"]), "--out", str(out))
            crowdsim("perform", *words)
        return sorted(out.glob("*.bvh"))
    if mocap is None:
        sys.exit(f"{bundle}: was trained on capture, expected --mocap or CROWDSIM_MOCAP")
    return sorted(path for pattern in motion["capture"]["clips"] for path in Path(mocap).glob(pattern))


def follow(sizes: Sizes, action: Array, phase: Array, pace: float, seconds: Array, rate: float) -> tuple[Array, Array]:
    """Where an avatar is in the capture, from what the take tells of it.

    Args:
        sizes: Numbers of the bundle.
        action: Its action in each control frame. Shape (C,).
        phase: Control frames of it done. Shape (C,).
        pace: Motion frames in a control frame.
        seconds: Times that are asked for. Shape (F,).
        rate: Control frames a second.

    Returns:
        The playback frame at each time, shape (F,); and of each decision its time [s], the playback frame that it left
        and the one that it went on from, shape (n, 3).
    """
    phase = np.minimum(phase, sizes.lengths[action])
    fresh = np.concatenate([[True], (action[1:] != action[:-1]) | (phase[1:] < phase[:-1] + 0.5 * pace)])
    clock = seconds * rate
    now = np.minimum(np.floor(clock + 1e-6).astype(int), len(action) - 1)
    later = np.minimum(now + 1, len(action) - 1)
    part = clock - now
    began = np.where((later > now) & fresh[later], 1.0 - phase[later] / pace, np.inf)
    gone = np.minimum(phase[now] + part * pace, sizes.lengths[action[now]])
    new = part >= began - 1e-6
    ahead = np.where(new, part - np.where(new, began, 0.0), 0.0) * pace
    frames = np.where(
        new, sizes.first[action[later]] + ahead * sizes.stride, sizes.first[action[now]] + gone * sizes.stride
    )
    rows = np.flatnonzero(fresh[1:]) + 1
    left = sizes.first[action[rows - 1]] + sizes.lengths[action[rows - 1]] * sizes.stride
    return frames, np.stack([(rows - phase[rows] / pace) / rate, left, sizes.first[action[rows]]], axis=1)


def read_stage(run: Path, policies: Path | None, folder: Path, mocap: Path | None) -> Stage:
    """Read a run: BVH files, take, bundle and capture."""
    group: Any = zarr.open_group(store=str(run / "take.zarr"), mode="r")
    names = group.attrs["policy_names"]
    if len(names) != 1:
        sys.exit(f"{run}: has {len(names)} policies, expected one")
    bundle = find_bundle(names[0]) if policies is None else policies / names[0]
    control = float(group.attrs["control_rate"])
    outcome = json.loads((bundle / "policy.json").read_text())["fingerprint"]
    if outcome != group.attrs["policy_fingerprints"][0]:
        sys.exit(f"{run}: {bundle} is not the bundle that it was run with")
    sizes = read_sizes(bundle)
    action, phase = np.asarray(group["action"][:]).astype(int), np.asarray(group["action_frame"][:]).astype(float)
    if (action < 0).any():
        sys.exit(f"{run}: avatars come late or leave, expected all of them all the time")
    read = [read_figure(run / "bvh" / f"{name}.bvh", sizes) for name in group["name"][:]]
    fps, speeds = round(read[0][2]), np.asarray(group["speed"][:]).astype(float)
    if fps > sizes.rate or sizes.rate % fps:
        sys.exit(f"{run}: has BVH files of {fps} frames a second, expected {sizes.rate:g} or a whole part of it")
    seconds = np.arange(len(read[0][0].head)) / fps
    followed = [follow(sizes, action[:, n], phase[:, n], pace, seconds, control) for n, pace in enumerate(speeds)]
    events = {name: np.asarray(group["events"][name][:]) for name in ("attacker", "victim", "hand", "landed")}
    return Stage(
        sizes=sizes,
        source=read_source(clips_of(bundle, folder, mocap), sizes),
        figures=[one[0] for one in read],
        scales=np.array([one[1] for one in read]),
        speeds=speeds,
        fps=fps,
        frames=np.stack([frames for frames, _ in followed]),
        decisions=[decisions for _, decisions in followed],
        events={**events, "seconds": np.asarray(group["events"]["frame"][:]) / control},
    )


def judge(run: Path, stage: Stage, seconds: float) -> dict[str, Any]:
    """All figures of a run, with what ``crowdsim inspect`` says of it."""
    transitions = sum(int(np.sum(outcome[:, 1] != outcome[:, 2])) for outcome in stage.decisions)
    return {
        "avatars": len(stage.figures),
        "frames": len(stage.figures[0].head),
        "transitions_per_second": transitions / len(stage.figures) / (len(stage.figures[0].head) / stage.fps),
        "database_off_its_capture": stage.source.apart,
        "floors_off": float(np.abs(stage.source.floors).max()),
        "undisturbed": undisturbed(stage),
        "feet": feet(stage),
        "hinges": hinges(stage),
        "peaks": peaks(stage),
        "fists": fists(stage),
        "overlap": overlap(stage),
        "transition_classifier": classify_transitions(stage, seconds),
        "inspect": json.loads(crowdsim("inspect", str(run), "--json")),
    }


def _rows(outcome: dict[str, Any]) -> list[tuple[str, str, str, str, str]]:
    """Lines of the table: figure, from the files, of the capture, as inspect says, where the worst is."""

    def place(worst: dict[str, Any]) -> str:
        return " ".join(
            f"{key} {value:.3g}" if isinstance(value, float) else f"{key} {value}" for key, value in worst.items()
        )

    own, feet_, bends = outcome["inspect"], outcome["feet"], outcome["hinges"]
    rows = []
    calm = outcome["undisturbed"]
    if calm["frames"]:
        gap = f"{1000 * calm['greatest_gap']:.2f}"
        rows.append((f"joints off the capture in {calm['frames']} calm frames [mm]", gap, "", "", ""))
    for key, name in (("median", "median"), ("p95", "95")):
        there = own[f"foot_slide_{name}"], own[f"foot_slide_{name}_captured"]
        said = " of ".join("-" if value is None else f"{value:.3f}" for value in there)
        rows.append(
            (f"slide of standing feet, {key} [m/s]", f"{feet_['slide'][key]:.3f}",
             f"{feet_['slide_of_all_the_capture'][key]:.3f}", said, "")
        )  # fmt: skip
        rows.append(
            (f"  where the capture stands too, {key}", f"{feet_['slide_where_the_capture_stands_too'][key]:.3f}",
             f"{feet_['slide_of_the_capture_there'][key]:.3f}", "", "")
        )  # fmt: skip
    rows.append(("lowest sole [mm]", f"{1000 * feet_['lowest_sole']:.1f}",
                 f"{1000 * feet_['lowest_sole_of_the_capture']:.1f}", "", place(feet_["worst"])))  # fmt: skip
    for name in ("knees", "elbows"):
        bend = bends[name]
        rows.append((f"{name}, least and greatest flexion [deg]", f"{bend['least']:.0f} {bend['greatest']:.0f}",
                     f"{bend['least_of_the_capture']:.0f} {bend['greatest_of_the_capture']:.0f}", "",
                     place(bend["worst"])))  # fmt: skip
        rows.append((f"{name} past straight, of frames", f"{bend['past_straight']:.2%}",
                     f"{bend['past_straight_of_the_capture']:.2%}", "", ""))  # fmt: skip
    for kind, parts in outcome["peaks"].items():
        for part, peak in parts.items():
            rows.append((f"greatest {kind} of {part} over the capture's", f"{peak['ratio']:.2f}", "1.00", "",
                         place(peak["worst"])))  # fmt: skip
            rows.append(("  99.99 %; frames beyond it by 10 %", f"{peak['p9999']:.3g}; {peak['frames_beyond']:.3%}",
                         f"{peak['p9999_of_the_capture']:.3g}", "", ""))  # fmt: skip
    hits, bodies, apart = outcome["fists"], outcome["overlap"], outcome["transition_classifier"]
    rows.append(("strikes landed", f"{hits['landed']}", "", f"{own['strikes_landed']}", ""))
    if hits["landed"]:
        off = hits["gap"]
        rows.append(("fist off what it hits, median, 95 %, most [cm]",
                     f"{100 * off['median']:.2f} {100 * off['p95']:.2f} {100 * off['greatest']:.1f}", "", "",
                     place(hits["worst"])))  # fmt: skip
        rows.append(("  off by more than 2 cm", f"{hits['beyond_2_cm']:.2%}", "", "", ""))
        rows.append(("  misses whose fist is in the body", f"{hits['buried']:.2%}", "", "", ""))
    rows.append(("bodies overlap: discs", f"{bodies['discs']:.3%}", "", f"{own['overlap_share']:.3%}", ""))
    rows.append(("  torsos", f"{bodies['torsos']:.3%}", "", "", place(bodies["worst"])))
    rows.append(("  heads", f"{bodies['heads']:.3%}", "", "", ""))
    rows.append(("transitions per avatar per second", f"{outcome['transitions_per_second']:.2f}", "",
                 f"{own['transitions_per_second']:.2f}", ""))  # fmt: skip
    if apart["auc"] is not None and apart["auc_of_content"] is not None:
        against = f"{apart['transitions']} transitions against {apart['others']} others"
        rows.append((f"AUC of {against}", f"{apart['auc']:.3f}",
                     f"{apart['auc_of_content']:.3f}", "", ""))  # fmt: skip
    return rows


def main() -> None:
    """Read the command line, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, nargs="*", metavar="RUN", help="folders of runs with BVH files")
    parser.add_argument("--mocap", type=Path, default=os.environ.get("CROWDSIM_MOCAP"), help="folder with capture")
    parser.add_argument("--policies", type=Path, help="folder of bundles; else where runs find them")
    parser.add_argument("--frames", type=int, default=450, help="control frames of runs that are made here")
    parser.add_argument("--seconds", type=float, default=0.4, help="length of a window around a transition, 0.2 to 1.6")
    parser.add_argument(
        "--quick", action="store_true", help=f"seconds: {FEW} avatars, {QUICK} control frames, small policies"
    )
    parser.add_argument("--json", action="store_true", help="print JSON and nothing else")
    options = parser.parse_args()
    if not 0.2 <= options.seconds <= 1.6:
        parser.error(f"--seconds is {options.seconds}, expected 0.2 to 1.6")
    result = {}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        if options.quick:
            stack.enter_context(small_policies())
        work: list[tuple[str, Path | None]] = [(run.name, run.resolve()) for run in options.runs]
        if not work:
            names = [name for name in SCENES if options.quick or options.mocap or "cmu" not in name]
            work = [(name, None) for name in names]
        for name, given in work:
            print(f"{name} ...", file=sys.stderr, flush=True)
            frames = QUICK if options.quick else options.frames
            most = FEW if options.quick else None
            run = given or play(name, SCENES[name], frames, folder, options.mocap, most)
            result[name] = judge(run, read_stage(run, options.policies, folder, options.mocap), options.seconds)
    if options.json:
        print(json.dumps(result, indent=2))
        return
    for name, outcome in result.items():
        print(f"{name}: {outcome['avatars']} avatars, {outcome['frames']} frames")
        print(f"  {'':48} {'files':>18} {'capture':>10} {'inspect':>16}  worst")
        for figure, shown, captured, said, worst in _rows(outcome):
            print(f"  {figure:48} {shown:>18} {captured:>10} {said:>16}  {worst}")
        for odd in outcome["hinges"]["clips_with_backward_hinges"]:
            print(f"  the capture's {odd['joint'].replace('_', ' ')} folds backward in {odd['clip']}")


if __name__ == "__main__":
    main()
