"""Figures of exported motion, measured from the BVH files by another reader.

    python benchmarks/exported.py [RUN ...] [--mocap DIR] [--frames N] [--seconds 0.4] [--strips FOLDER] [--quick]
        [--json]

Without a RUN, `brawl_30`, `armies_200` and, with --mocap or CROWDSIM_MOCAP, `brawl_30_cmu` are run here with BVH as
their only output. A reader in this folder, in plain numpy, reads and poses the files. The take gives strikes, opponents
and decisions, the policy's bundle gives body sizes and where actions begin in the source, and `crowdsim perform` or the
capture's files give the source motion, which is measured in the same way. The package's own code is used only for the
figures of `crowdsim inspect` that are printed beside these, and to draw; and its table of skins says what fists touch
(`crowdsim.poses.skins`): `delivery.py` measures that on the meshes. All avatars of a run must use one policy and be
present from its start to its end.

--strips FOLDER draws the ten worst moments of each kind, and the ten most typical blows, into FOLDER/RUN_KIND.png:
strips of frames around them, from the side, with avatars, time and figure. The JSON document has a group for each run,
with these keys:

- `undisturbed`: a second or more from transitions, away from strikes and from other bodies, where the files must equal
  the source motion. See `_exported/calm.py`.
- `feet`: a foot is in contact while its ball is lower than 3 cm and rises or falls slower than 0.15 m/s; its `slide` is
  the horizontal speed of the ball during contact.
- `hinges`: flexion of knees and elbows towards the side to which the source bends them;
  `clips_with_backward_hinges` are clips whose knees fold forward or whose elbows fold backward in the files; such
  elbows are corrected first.
- `peaks`: the greatest speed and acceleration of any joint over the greatest in the source.
- `fists`: distance of the surface of the striking fist from the skin of head or trunk at the time of the strike, inside
  or outside. Strikes lie between frames, and at 30 Hz a fist comes and turns back within one: files have 60 frames a
  second.
- `overlap`: overlap of discs of 0.2 m around pelvises, of torso capsules (pelvis to neck) and of heads, as a share of
  avatar-frames.
- `transition_classifier`: area under the ROC curve of a classifier of windows around transitions and around other
  decisions; `content` is the same for the source motion behind them; `matched` the same for pairs whose source motion
  is alike. See `_exported/transition_classifier.py`.
- `bodies`: capsules that pictures and clouds show, between all avatars. `without_arms` and `with_arms`: `share` of
  avatar-frames deeper than 6 cm, `deepest` [m], `episodes_per_minute` deeper than 8 cm. `by_parts`: share and depth by
  pair of parts. `arm_in_trunk_or_head`: frames in which an avatar's forearm or fist is deeper than 6 cm in a torso or
  head. See `_exported/bodies.py`.
- `strikes`: `missed_buried`, `landed_buried`: strikes whose forearm or fist is deeper than 8 cm in torso or head of
  whom they strike, within 0.3 s; `landed_stay`: how long a landed limb is deeper than 6 cm there, from 0.3 s before
  to 1 s after [s]. See `_exported/arms.py`.
- `accelerations`: `linear` and `angular`, by part of the body, `near_transitions` (0.1 s), `near_landed_strikes`
  (0.2 s) and `everywhere`: frames above the source's 99.9th percentile, in per mille; `worst` of all parts.
  See `_exported/accelerations.py`.
- `jumps`: one-frame jumps of rotations and sudden drops of the pelvis per minute, of the files, of the whole source,
  and of the source as the avatars play it, who strike more often. See `_exported/jumps.py`.
- `gaze`: `facing_share` and `away_share` of frames nearer than 1.5 m in which the head is within 45 degrees of the
  opponent and more than 90 off; `hits_from_behind_share` of landed strikes from over 120 degrees off the front of the
  victim's pelvis; `turned_to_attacker_share` of these after which the head faces the attacker within 1 s.
- `reactions`: how far hits move heads and feet, beside unhit moments. See `_exported/reactions.py`.
- `blows`: what blows do by their impulse: heads, pelvises, trunks, guards, strikes thrown afterwards. See
  `_exported/blows.py`.
- `variety`: repeated motion, the same source among neighbours, the same strikes at once, stillness. See
  `_exported/variety.py`.

Groups have `moments`, the ten worst, and `blows` has `typical` ones, whose value is nearest to the median: value,
avatar, frame, and where there are any the other avatar and parts.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from _exported.accelerations import measure_accelerations
from _exported.arms import measure_strikes
from _exported.blows import measure_blows
from _exported.bodies import measure_bodies
from _exported.calm import undisturbed
from _exported.capsules import find_contacts
from _exported.contact import fists, overlap
from _exported.gaze import measure_gaze
from _exported.joints import feet, hinges, peaks
from _exported.jumps import measure_jumps
from _exported.reactions import measure_reactions
from _exported.run import ExportedRun
from _exported.scenes import bundle_of, crowdsim, open_exported, run_scene
from _exported.strips import draw_strips
from _exported.table import print_table
from _exported.transition_classifier import classify_transitions
from _exported.variety import measure_variety
from _quick import command_line, small_policies

SCENES = {"brawl_30": 60, "brawl_30_cmu": 60, "armies_200": 60}
"""What is run without a RUN, and frames a second of its files."""
QUICK, FEW = 210, 10
"""Control frames and avatars of a quick run."""


def measure(folder: Path, run: ExportedRun, seconds: float) -> dict[str, Any]:
    """Return all figures of a run, and what ``crowdsim inspect`` reports of it."""
    transitions = sum(len(run.transitions(avatar)) for avatar in range(len(run.figures)))
    contacts = find_contacts(run)
    return {
        "avatars": len(run.figures),
        "frames": run.count,
        "transitions_per_second": transitions / (60.0 * run.minutes),
        "database_off_its_capture": run.source.apart,
        "floors_off": float(np.abs(run.source.floors).max()),
        "undisturbed": undisturbed(run),
        "feet": feet(run),
        "hinges": hinges(run),
        "peaks": peaks(run),
        "fists": fists(run),
        "overlap": overlap(run),
        "bodies": measure_bodies(run, contacts),
        "strikes": measure_strikes(run, contacts),
        "accelerations": measure_accelerations(run),
        "jumps": measure_jumps(run),
        "gaze": measure_gaze(run),
        "reactions": measure_reactions(run),
        "blows": measure_blows(run),
        "variety": measure_variety(run),
        "transition_classifier": classify_transitions(run, seconds),
        "inspect": json.loads(crowdsim("inspect", str(folder), "--json")),
    }


def measure_all(options: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of all runs by name; draw strips where they are asked for."""
    results = {}
    strips = None if options.strips is None else options.strips.resolve()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        stack.enter_context(small_policies(wanted=options.quick))
        work: list[tuple[str, Path | None]] = [(run.name, run.resolve()) for run in options.runs]
        if not work:
            names = [name for name in SCENES if options.quick or options.mocap or "cmu" not in name]
            work = [(name, None) for name in names]
        for name, given in work:
            print(f"{name} ...", file=sys.stderr, flush=True)
            frames = QUICK if options.quick else options.frames
            most = FEW if options.quick else None
            path = given or run_scene(name, SCENES[name], frames, folder, options.mocap, most)
            run = open_exported(path, options.policies, folder, options.mocap)
            results[name] = measure(path, run, options.seconds)
            if strips is not None:
                draw_strips(path, bundle_of(path, options.policies), run, results[name], strips)
    return results


def main() -> None:
    """Read the command line, measure and print."""
    parser = command_line(__doc__, f"seconds: {FEW} avatars, {QUICK} control frames, small policies")
    parser.add_argument("runs", type=Path, nargs="*", metavar="RUN", help="folders of runs with BVH files")
    parser.add_argument("--mocap", type=Path, default=os.environ.get("CROWDSIM_MOCAP"), help="folder with capture")
    parser.add_argument("--policies", type=Path, help="folder of bundles; else where runs find them")
    parser.add_argument("--frames", type=int, help="control frames of runs that are made here, else those of scenarios")
    parser.add_argument("--seconds", type=float, default=0.4, help="length of a window around a transition, 0.2 to 1.6")
    parser.add_argument("--strips", type=Path, metavar="FOLDER", help="draw the ten worst moments of each kind there")
    options = parser.parse_args()
    if not 0.2 <= options.seconds <= 1.6:
        parser.error(f"--seconds is {options.seconds}, expected 0.2 to 1.6")
    try:
        results = measure_all(options)
    except ValueError as error:
        sys.exit(str(error))
    if options.json:
        print(json.dumps(results, indent=2))
        return
    for name, outcome in results.items():
        print_table(name, outcome)


if __name__ == "__main__":
    main()
