"""What the arrays of a bundle must be, so that nothing in one can lead compiled code out of bounds.

J joints, E end sites, C capsules, M clips, F control frames, P playback frames, N strikes of the database, S states,
A actions, Q of them of states, H falls, G staggers, U celebrations, R rests, X ways into them, B pieces of
them, Y ways into walks, Z parts of them, T transitions, L rows of paths, K strikes in actions.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from crowdsim.array_checks import (
    Ascending,
    Check,
    Column,
    Index,
    Offsets,
    Relation,
    Within,
    check_relations,
    check_table,
    parents_first,
    true_or_false,
    unit_quaternions,
)
from crowdsim.core.threats import CELLS
from crowdsim.core.types import Array
from crowdsim.motion.body import PARTS
from crowdsim.motion.strikes import LIMBS
from crowdsim.policy.behind_checks import frames_of, relations_behind

STATE_VALUES = "state_values"
"""Name of the array of ``Behaviour.state_values``, one after another."""

DEFENCE = "defence"
"""Name of the array of ``Policy.defence``."""

FAR, NEAR, TURNS = 1e6, 1e3, 1e5
"""Greatest positions in the world of a clip and in the frame of a body [m], and headings that are not wrapped [rad]."""
LONGEST = 4096
"""Control frames of the longest action that is read; tables that control makes have its square."""
MOST = 4096
"""Most actions of a state."""

_FAR, _NEAR = Within(-FAR, FAR), Within(-NEAR, NEAR)


def _ints(shape: tuple[int | str, ...], *checks: Check) -> Column:
    return Column("int32", shape, checks)


def _bytes(shape: tuple[int | str, ...], *checks: Check) -> Column:
    return Column("uint8", shape, checks)


def _singles(shape: tuple[int | str, ...], *checks: Check) -> Column:
    return Column("float32", shape, checks)


def _doubles(shape: tuple[int | str, ...], *checks: Check) -> Column:
    return Column("float64", shape, checks)


def _flags(shape: tuple[int | str, ...]) -> Column:
    return Column("bool", shape, (true_or_false,))


_COSTS = Within(0.0, NEAR)

TABLE: Mapping[str, Column] = {
    "skeleton_parents": _ints(("J",), parents_first),
    "skeleton_offsets": _doubles(("J", 3), _NEAR),
    "skeleton_end_parents": _ints(("E",), Index("J")),
    "skeleton_end_offsets": _doubles(("E", 3), _NEAR),
    "body_fist_offsets": _doubles((2, 3), _NEAR),
    "body_head_offset": _doubles((3,), _NEAR),
    "body_sole_offsets": _doubles((2, 2, 3), _NEAR),
    "body_capsule_joints": _ints(("C",), Index("J")),
    "body_capsule_starts": _doubles(("C", 3), _NEAR),
    "body_capsule_ends": _doubles(("C", 3), _NEAR),
    "body_capsule_radii": _doubles(("C", 2), Within(1e-6, NEAR)),
    "body_capsule_parts": _bytes(("C",), Within(0, len(PARTS) - 1)),
    "graph_frames_kept": _flags(("F",)),
    "database_clip_starts": _ints(("M+1",), Offsets("F", least=2)),
    "database_root_positions": _singles(("P", 3), _FAR),
    "database_rotations": _singles(("P", "J", 4), unit_quaternions),
    "database_ground": _doubles(("P", 3), _FAR),
    "database_contacts": _flags(("P", 2)),
    "database_fists": _singles(("P", 2, 3), _NEAR),
    "database_heads": _singles(("P", 3), _NEAR),
    "database_necks": _singles(("P", 3), _NEAR),
    "database_pelvises": _singles(("P", 3), _NEAR),
    "database_strike_frames": _ints(("N",), Index("P"), Ascending()),
    "database_strike_limbs": _bytes(("N",), Within(0, len(LIMBS) - 1)),
    "database_strike_peaks": _ints(("N",), Index("P")),
    "database_strike_speeds": _singles(("N",), Within(0.0, NEAR)),
    "database_strike_positions": _singles(("N", 3), _NEAR),
    "graph_state_frames": _ints(("S",), Index("F", least=1), Ascending(strictly=True)),
    "graph_action_next": _ints(("A",), Index("S")),
    "graph_action_offsets": _ints(("S+1",), Offsets("Q", least=1, most=MOST)),
    "graph_action_first": _ints(("A",), Index("F", least=1)),
    "graph_action_lengths": _ints(("A",), Within(1, LONGEST)),
    "graph_action_costs": _singles(("A",), _COSTS),
    "graph_transition_from": _ints(("T",), Index("F"), Ascending()),
    "graph_transition_to": _ints(("T",), Index("F")),
    "graph_transition_costs": _singles(("T",), _COSTS),
    "actions_paths": _singles(("L", 3), _NEAR),
    "actions_strike_times": _singles(("K",), Within(0.0, LONGEST)),
    "actions_offsets": _ints(("S+1",)),
    "actions_next": _ints(("A",)),
    "actions_lengths": _ints(("A",)),
    "actions_shifts": _singles(("A", 3), _NEAR),
    "actions_costs": _singles(("A",), _COSTS),
    "actions_path_offsets": _ints(("A+1",), Offsets("L", least=1, most=LONGEST)),
    "actions_strike_offsets": _ints(("A+1",), Offsets("K")),
    "actions_strike_positions": _singles(("K", 3), _NEAR),
    "actions_strike_origins": _singles(("K", 2), _NEAR),
    "actions_strike_speeds": _singles(("K",), Within(0.0, NEAR)),
    "actions_strike_ids": _ints(("K",), Index("N")),
    "falls_fall": _ints(("H",), Index("A")),
    "falls_lie": _ints(("H",), Index("A")),
    "falls_rise": _ints(("H",), Index("A")),
    "falls_direction": _singles(("H",), _FAR),
    "falls_stagger": _ints(("G",), Index("A")),
    "falls_cheer": _ints(("U",), Index("A")),
    "falls_cheer_stop": _ints(("U",)),
    "falls_stagger_direction": _singles(("G",), _FAR),
    "falls_stop": _ints(("H",)),
    "falls_stagger_stop": _ints(("G",)),
    "rests_frames": _ints(("R", 6), Index("F")),
    "rests_enter": _ints(("X",), Index("A")),
    "rests_state": _ints(("X",), Index("S"), Ascending(strictly=True)),
    "rests_hold": _ints(("B",), Index("A")),
    "rests_leave": _ints(("B",), Index("A")),
    "rests_row": _ints(("X",), Index("B")),
    "rests_next": _ints(("B",), Index("B")),
    "walks_spans": _ints(("R", 2), Index("F")),
    "walks_take": _ints(("Y",), Index("A")),
    "walks_piece": _ints(("Y",), Ascending()),
    "walks_row": _ints(("Y",)),
    "walks_hold": _ints(("Z",), Index("A")),
    "walks_next": _ints(("Z",)),
    DEFENCE: _singles(("Q", CELLS), _NEAR),
    "values": Column("float32 float16 uint8 uint16", ("V",)),
    STATE_VALUES: Column("float32 float16 uint8 uint16", ("W",)),
}
"""Every array of a bundle. Entries that ``relations`` hold against others, which have passed, have no check here."""

_FLOATS = Within(-1e12, 1e12)


def check_arrays(arrays: Mapping[str, Array], sizes: Mapping[str, int], stride: int, optional: tuple[str, ...]) -> None:
    """Hold the arrays of a bundle against their table, and against one another.

    Args:
        arrays: The arrays by name.
        sizes: Sizes that ``policy.json`` states: joints J, clips M, and entries of tables V and W.
        stride: Playback frames in a control frame.
        optional: Arrays that may be missing.

    Raises:
        ArrayFault: One is not what it must be.
    """
    found = check_table(TABLE, arrays, sizes, optional)
    for name in ("values", STATE_VALUES):
        if name in arrays and arrays[name].dtype.kind == "f":
            check_table({name: Column(str(arrays[name].dtype), ("V",), (_FLOATS,))}, {name: arrays[name]}, {})
    relations = _relations(stride, found)
    relations += relations_behind(arrays)
    check_relations(relations, arrays)


def _relations(stride: int, sizes: Mapping[str, int]) -> tuple[Relation, ...]:
    """Return what must be true of the arrays of a bundle together; each may rely on those before it."""
    between = "the strikes between first and last frame of each action"
    whole = sizes["P"] == sizes["F"] * stride
    return (
        Relation(
            "database_root_positions", f"{sizes['F']} control frames of {stride} playback frames", lambda _: whole
        ),
        Relation("body_capsule_parts", "a capsule of the trunk among them", _have_trunk),
        *(_equal(f"actions_{own}", f"graph_{other}") for own, other in _SAME.items()),
        Relation("actions_path_offsets", "a row of paths for each frame of an action", _have_paths),
        Relation("graph_action_first", "actions that end in the frame of their next state", _end_in_states),
        Relation("graph_action_first", "actions that stay in their clips", _stay_in_clips),
        Relation("actions_strike_offsets", between, lambda arrays: _count_strikes(arrays, stride)),
        Relation("actions_strike_ids", between, lambda arrays: _name_strikes(arrays, stride)),
        Relation("actions_strike_times", "the frames of strikes in the database", lambda a: _time_strikes(a, stride)),
    )


_SAME = {"offsets": "action_offsets", "next": "action_next", "lengths": "action_lengths"}


def _equal(name: str, other: str) -> Relation:
    return Relation(name, f"the same as in {other}", lambda arrays: arrays[name] == arrays[other])


def _have_trunk(arrays: Mapping[str, Array]) -> bool:
    return bool(np.isin(PARTS.index("shirt"), arrays["body_capsule_parts"]))


def _have_paths(arrays: Mapping[str, Array]) -> bool:
    return np.array_equal(np.diff(arrays["actions_path_offsets"]), arrays["actions_lengths"])


def _end_in_states(arrays: Mapping[str, Array]) -> Array:
    result: Array = frames_of(arrays)[1] == arrays["graph_state_frames"][arrays["graph_action_next"]]
    result[int(arrays["graph_action_offsets"][-1]) :] = True
    return result


def _stay_in_clips(arrays: Mapping[str, Array]) -> Array:
    starts = arrays["database_clip_starts"]
    first, last = (np.searchsorted(starts, frames, side="right") for frames in frames_of(arrays))
    result: Array = first == last
    return result


def _strikes_of(arrays: Mapping[str, Array], stride: int) -> tuple[Array, Array]:
    """Return the first strike of the database in each action, and one past the last. Shapes (A,)."""
    low, high = (
        np.searchsorted(arrays["database_strike_frames"], stride * frames, side="right") for frames in frames_of(arrays)
    )
    return low, high


def _count_strikes(arrays: Mapping[str, Array], stride: int) -> bool:
    low, high = _strikes_of(arrays, stride)
    return np.array_equal(np.diff(arrays["actions_strike_offsets"]), high - low)


def _name_strikes(arrays: Mapping[str, Array], stride: int) -> Array:
    offsets, (low, _) = arrays["actions_strike_offsets"].astype(np.int64), _strikes_of(arrays, stride)
    result: Array = arrays["actions_strike_ids"] == np.repeat(low - offsets[:-1], np.diff(offsets)) + np.arange(
        offsets[-1]
    )
    return result


def _time_strikes(arrays: Mapping[str, Array], stride: int) -> Array:
    owners = np.repeat(frames_of(arrays)[0], np.diff(arrays["actions_strike_offsets"]))
    at = arrays["database_strike_frames"][arrays["actions_strike_ids"]]
    result: Array = arrays["actions_strike_times"] == (at / stride - owners).astype(np.float32)
    return result
