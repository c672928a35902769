"""Small policies for tests of control: random motion, a graph over it, random tables."""

from dataclasses import replace

import numpy as np

from crowdsim.graph.motion_graph import MotionGraph
from crowdsim.motion.body import PARTS, Body
from crowdsim.motion.database import MotionDatabase
from crowdsim.motion.skeleton import Skeleton
from crowdsim.policy.actions import build_actions
from crowdsim.policy.alignment import Alignment
from crowdsim.policy.environment import Axis, build_grid
from crowdsim.policy.policy import Behaviour, Policy
from crowdsim.policy.rewards import ProximityTerm, StrikeTerm, TransitionTerm, target_body


def figure():
    """Return a skeleton of a pelvis, arms, feet and knees, and its body; its gloves are large."""
    names = ("pelvis", "left_elbow", "left_hand", "right_elbow", "right_hand", "left_foot", "right_foot",
             "left_knee", "right_knee")  # fmt: skip
    parents = np.array([-1, 0, 1, 0, 3, 0, 0, 0, 0], np.int32)
    offsets = np.array(
        [[0, 0, 0], [0.2, 0.2, 0.15], [-0.05, 0.2, 0.2], [-0.2, 0.2, 0.15], [0.05, 0.2, 0.2], [0.1, -0.9, 0.1],
         [-0.1, -0.9, 0.1], [0.12, -0.45, 0.2], [-0.12, -0.45, 0.2]], float,
    )  # fmt: skip
    radii = np.array([[0.08, 0.06], [0.08, 0.06], [0.09, 0.12], [0.09, 0.12]])
    body = Body(
        roles={name: joint for joint, name in enumerate(names)}, height=1.75,
        fist_offsets=np.array([[0.0, 0.0, 0.08], [0.0, 0.0, 0.08]]), head_offset=np.zeros(3),
        sole_offsets=np.tile([[0.0, -0.1, -0.05], [0.0, -0.1, 0.15]], (2, 1, 1)), head_radius=0.11, torso_radius=0.15,
        capsule_joints=np.array([1, 3, 2, 4], np.int32), capsule_starts=np.zeros((4, 3)),
        capsule_ends=np.array([offsets[2], offsets[4], [0, 0, 0.08], [0, 0, 0.08]]), capsule_radii=radii,
        capsule_parts=np.array([PARTS.index("skin")] * 2 + [PARTS.index("glove")] * 2, np.uint8),
    )  # fmt: skip
    return Skeleton(names, parents, offsets), body


def database(rng, frames=40, stride=4):
    """Return one clip of a body that wanders and throws punches."""
    count = frames * stride
    ground = np.cumsum(rng.normal(0, [0.02, 0.02, 0.03], (count, 3)), axis=0)
    heads = np.array([0.0, 1.6, 0.05]) + rng.normal(0, 0.02, (count, 3))
    strikes = np.sort(rng.choice(np.arange(stride, count - stride), frames // 3, replace=False))
    positions = rng.normal([0, 1.4, 0.6], [0.15, 0.1, 0.1], (len(strikes), 3))
    skeleton, body = figure()
    # Drawn on their own, so that what is drawn above does not depend on them.
    arms = np.random.default_rng(count)
    fists = arms.normal([[0.15, 1.45, 0.3], [-0.15, 1.45, 0.3]], 0.05, (count, 2, 3))
    turns = arms.normal([1.0, 0.0, 0.0, 0.0], 0.1, (count, 7, 4))
    knees = arms.normal([1.0, 0.0, 0.0, 0.0], 0.1, (count, 2, 4))
    turns = np.concatenate([turns, knees], axis=1)
    turns /= np.linalg.norm(turns, axis=-1, keepdims=True)
    return MotionDatabase(
        skeleton=skeleton,
        body=body,
        control_rate=15.0,
        playback_rate=15.0 * stride,
        clip_names=("clip",),
        clip_starts=np.array([0, frames], np.int32),
        root_positions=np.column_stack([ground[:, 0], np.full(count, 1.0), ground[:, 1]]).astype(np.float32),
        rotations=turns.astype(np.float32),
        ground=ground,
        contacts=np.zeros((count, 2), bool),
        fists=fists.astype(np.float32),
        heads=heads.astype(np.float32),
        necks=(heads - [0, 0.15, 0]).astype(np.float32),
        pelvises=(heads - [0, 0.65, 0]).astype(np.float32),
        strike_frames=strikes.astype(np.int32),
        strike_limbs=rng.integers(0, 4, len(strikes)).astype(np.uint8),
        strike_peaks=strikes.astype(np.int32),
        strike_speeds=rng.uniform(4, 9, len(strikes)).astype(np.float32),
        strike_positions=positions.astype(np.float32),
    )


def graph(rng, frames=40, most=3):
    """Return a graph in which every state continues the capture, or goes on after other states."""
    states = np.unique(np.concatenate([rng.choice(np.arange(1, frames - 1), frames // 3, replace=False), [frames - 1]]))
    count = len(states)
    offsets, following, first, lengths, costs = [0], [], [], [], []
    for s in range(count):
        jumps = rng.choice(count - 1, min(most, count - 1), replace=False)
        for j in dict.fromkeys([*([s] if s < count - 1 else [0]), *jumps]):
            following.append(j + 1)
            first.append(states[j] + 1)
            lengths.append(states[j + 1] - states[j])
            costs.append(0.0 if j == s else rng.uniform(0.05, 0.2))
        offsets.append(len(following))
    whole = {"action_offsets": offsets, "action_next": following, "action_first": first, "action_lengths": lengths}
    return MotionGraph(
        state_frames=states.astype(np.int32),
        **{name: np.array(values, np.int32) for name, values in whole.items()},
        action_costs=np.array(costs, np.float32),
        frames_kept=np.ones(frames, bool),
        transition_from=np.zeros(0, np.int32),
        transition_to=np.zeros(0, np.int32),
        transition_costs=np.zeros(0, np.float32),
        threshold=0.2,
    )


def policy(seed=0, lookup="v", frames=40, stride=4, name="synthetic"):
    """Return a policy of random motion with random values for approach and punch."""
    rng = np.random.default_rng(seed)
    motion, model = database(rng, frames, stride), graph(rng, frames)
    jumps = model.action_costs > 0.0
    shifts = rng.normal(0.0, 0.03, (model.action_count, 3)) * jumps[:, None]
    actions = build_actions(motion, model, Alignment(shifts.astype(np.float32), jumps * rng.integers(0, 3, len(jumps))))
    body = target_body(motion)
    approach = build_grid([Axis("distance", 0.0, 4.0, 5, fade=2.0), Axis("bearing", -np.pi, np.pi, 6, wraps=True)])
    punch = build_grid(
        [
            Axis("distance", 0.2, 1.4, 4, fade=0.4),
            Axis("bearing", -np.pi, np.pi, 5, wraps=True),
            Axis("height", 1.2, 1.7, 3, fade=0.3),
        ]
    )
    terms = {
        "approach": (
            ProximityTerm(kind="proximity", distance=(0.4, 0.8), aside=0.1, facing=bool(seed % 2)),
            TransitionTerm(kind="transition"),
        ),
        "punch": (
            StrikeTerm(kind="strike", tolerance=0.3),
            ProximityTerm(kind="proximity", distance=0.5, form="max"),
            TransitionTerm(kind="transition", weight=0.1, each=0.05),
        ),
    }
    behaviours = []
    for grid, (title, rewards) in zip((approach, punch), terms.items(), strict=True):
        rows = actions.state_count if lookup == "v" else actions.action_count
        table = rng.uniform(0, 5, rows * grid.cells).astype(np.float32)
        behaviours.append(Behaviour(title, grid, lookup, table, 2.0, rewards, 0.97))
    values = np.concatenate([behaviour.table for behaviour in behaviours])
    return Policy(name, motion, model, actions, tuple(behaviours), body, values, {}, {}, "", {})


def with_axes(chosen, *axes, seed=3):
    """Return a policy whose behaviours have further axes, with random values."""
    rng, behaviours = np.random.default_rng(seed), []
    for each in chosen.behaviours:
        grid = build_grid([*each.grid.axes, *axes])
        table = rng.uniform(0, 5, len(each.table) * grid.cells // each.grid.cells).astype(np.float32)
        behaviours.append(replace(each, grid=grid, table=table))
    values = np.concatenate([each.table for each in behaviours])
    return replace(chosen, behaviours=tuple(behaviours), values=values)


def with_headings(chosen):
    """Return a policy whose behaviours see which way their target faces, one of them beside its height."""
    return with_axes(chosen, Axis("heading", -np.pi, np.pi, 5, wraps=True))
