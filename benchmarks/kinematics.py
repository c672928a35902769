"""Forward kinematics in poses per second beside upc-pymotion, and inverse kinematics in limbs per second.

    python benchmarks/kinematics.py [--json] [--quick] [--poses 4096] [--repeats 20]

A pose has 31 joints in a human tree and local rotations as quaternions; the result is the position and the rotation of
every joint in the world. All contenders get the same arrays, in one process, the best of several runs; compilation is
not counted. upc-pymotion runs on one thread. Inverse kinematics bends left arms of these poses onto targets, with the
solver that moves fists and plants feet.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from _quick import best_seconds, command_line
from numpy.typing import NDArray
from pymotion.ops.skeleton_np import fk, fk_quat

from crowdsim.core.workers import CORES
from crowdsim.motion import quaternion
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Skeleton
from crowdsim.poses.kernels.limbs import World, bend_limb
from crowdsim.poses.limbs import Limbs

PARENTS = [-1, 0, 1, 2, 3, 0, 5, 6, 7, 0, 9, 10, 11, 11, 13, 11, 15, 16, 17, 18, 19, 17, 11, 22, 23, 24, 25, 26, 24, 14]
PARENTS.append(14)
ARM = (12, 13, 14)
"""Shoulder, elbow and hand."""
GOAL = 2.5e6
"""Poses a second on one thread that the project asks for."""


@numba.njit(cache=True)
def bend_arms(limbs: Any, rotations: Any, positions: Any, turns: Any, targets: Any, distance: float) -> None:
    """Bend the first limb of every pose onto its target."""
    for i in range(len(targets)):
        target = targets[i, 0], targets[i, 1], targets[i, 2]
        bend_limb(limbs, 0, rotations[i], World(positions[i], turns[i]), target, distance)


def measure(poses: int, repeats: int) -> dict[str, dict[str, float]]:
    """Return poses and limbs a second."""
    rng = np.random.default_rng(0)
    joints = len(PARENTS)
    body = Skeleton(
        tuple(map(str, range(joints))), np.array(PARENTS, np.int32), rng.normal(size=(joints, 3)).astype(np.float32)
    )
    rotations = quaternion.normalise(rng.normal(size=(poses, joints, 4))).astype(np.float32)
    roots = rng.normal(size=(poses, 3)).astype(np.float32)
    wide_rotations, wide_roots = rotations.astype(float), roots.astype(float)
    threads = min(2, CORES)
    forward: dict[str, Callable[[], object]] = {
        "crowdsim, 1 thread": lambda: forward_kinematics(body, roots, rotations, threads=1),
        f"crowdsim, {threads} threads": lambda: forward_kinematics(body, roots, rotations, threads=threads),
        "crowdsim, float64, 1 thread": lambda: forward_kinematics(body, wide_roots, wide_rotations, threads=1),
        "upc-pymotion fk": lambda: fk(rotations, roots, body.offsets, body.parents),
        "upc-pymotion fk_quat": lambda: fk_quat(rotations, roots, body.offsets, body.parents),
    }
    positions = fk(rotations, roots, body.offsets, body.parents)[0]
    gap = float(np.abs(positions - forward_kinematics(body, roots, rotations)[0]).max())
    assert gap < 1e-4, f"we and upc-pymotion differ by {gap}"

    none: Any = None
    hinge = np.array([1.0, 0.0, 0.0])
    both, hinges = np.array([ARM] * 2), np.stack([hinge, hinge])
    arms = Limbs(body.parents, body.offsets, none, none, none, both, hinges, none, none, none, none)
    world, turns = forward_kinematics(body, wide_roots, wide_rotations, threads=1)
    reach = float(np.linalg.norm(body.offsets[ARM[1]]))
    way: NDArray[Any] = rng.normal(size=(poses, 3))
    targets = world[:, ARM[0]] + reach * way / np.linalg.norm(way, axis=1, keepdims=True)
    bent = wide_rotations.copy()
    inverse = best_seconds(lambda: bend_arms(arms, bent, world, turns, targets, reach), repeats)
    return {
        "forward_poses_per_s": {name: poses / best_seconds(work, repeats) for name, work in forward.items()},
        "inverse_limbs_per_s": {"crowdsim, 1 thread": poses / inverse},
    }


def main() -> None:
    parser = command_line(__doc__, "seconds: few poses, run twice")
    parser.add_argument("--poses", type=int, default=4096, help="poses a call")
    parser.add_argument("--repeats", type=int, default=20, help="runs of each, of which the best counts")
    options = parser.parse_args()
    if options.quick:
        options.poses, options.repeats = min(options.poses, 256), min(options.repeats, 2)
    result: dict[str, object] = dict(measure(options.poses, options.repeats))
    forward: dict[str, float] = result["forward_poses_per_s"]  # type: ignore[assignment]
    ours, theirs = forward["crowdsim, 1 thread"], max(forward["upc-pymotion fk"], forward["upc-pymotion fk_quat"])
    result["times_faster_than_upc_pymotion"] = ours / theirs
    result["share_of_goal"] = ours / GOAL
    if options.json:
        print(json.dumps(result, indent=2))
        return
    print(f"{'forward kinematics, 31 joints':36} {'poses/s':>12}")
    for name, speed in forward.items():
        print(f"{name:36} {speed:12,.0f}")
    print(f"{ours / theirs:.1f} times as fast as upc-pymotion on one thread, {ours / GOAL:.2f} times the goal\n")
    print(f"{'inverse kinematics of arms':36} {'limbs/s':>12}")
    for name, speed in result["inverse_limbs_per_s"].items():  # type: ignore[attr-defined]
        print(f"{name:36} {speed:12,.0f}")


if __name__ == "__main__":
    main()
