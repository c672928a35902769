"""What the arrays of a bundle must be, so that nothing in one can lead compiled code out of bounds.

J joints, E end sites, C capsules, M clips, F control frames, P playback frames, N strikes of the database, S states,
A actions, Q of them of states, H falls, G staggers, U celebrations, R rests, X ways into them, B pieces of
them, Y ways into walks, Z parts of them, T transitions, L rows of paths, K strikes in actions.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from crowdsim.array_checks import (
    ArrayFault,
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
from crowdsim.policy.falls import numbers_of

STATE_VALUES = "state_values"
"""Name of the array of ``Behaviour.state_values``, one after another."""

DEFENCE = "defence"
"""Name of the array of ``Policy.defence``."""

FAR, NEAR = 1e6, 1e3
"""Greatest positions in the world of a clip and in the frame of a body [m]."""
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
    """Raise an ``ArrayFault`` if arrays of a bundle are not what their table says, or do not belong together.

    Args:
        arrays: The arrays by name.
        sizes: Sizes that ``policy.json`` states: joints J, clips M, and entries of tables V and W.
        stride: Playback frames in a control frame.
        optional: Arrays that may be missing.
    """
    found = check_table(TABLE, arrays, sizes, optional)
    for name in ("values", STATE_VALUES):
        if name in arrays and arrays[name].dtype.kind == "f":
            check_table({name: Column(str(arrays[name].dtype), ("V",), (_FLOATS,))}, {name: arrays[name]}, {})
    check_relations(_relations(stride, found) + relations_behind(arrays), arrays)


def _relations(stride: int, sizes: Mapping[str, int]) -> tuple[Relation, ...]:
    """Return what must be true of the arrays of a bundle together; each may rely on those before it."""
    between = "the strikes between first and last frame of each action"
    whole = sizes["P"] == sizes["F"] * stride
    return (
        Relation(
            "database_root_positions", f"{sizes['F']} control frames of {stride} playback frames", lambda _: whole
        ),
        Relation("body_capsule_parts", "a capsule of the trunk among them", _have_trunk),
        *(
            Relation(f"actions_{name}", f"the same as in graph_action_{name}", partial(_equal, name))
            for name in ("offsets", "next", "lengths")
        ),
        Relation("actions_path_offsets", "a row of paths for each frame of an action", _have_paths),
        Relation("graph_action_first", "actions that end in the frame of their next state", _end_in_states),
        Relation("graph_action_first", "actions that stay in their clips", _stay_in_clips),
        Relation("actions_strike_offsets", between, lambda arrays: _count_strikes(arrays, stride)),
        Relation("actions_strike_ids", between, lambda arrays: _name_strikes(arrays, stride)),
        Relation("actions_strike_times", "the frames of strikes in the database", lambda a: _time_strikes(a, stride)),
    )


def frames_of(arrays: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return the control frame on which each action is laid, and its last one. Shapes (A,), int64."""
    first = arrays["graph_action_first"].astype(np.int64)
    return first - 1, first + arrays["graph_action_lengths"] - 1


def _equal(name: str, arrays: Mapping[str, Array]) -> Array:
    return arrays[f"actions_{name}"] == arrays[f"graph_action_{name}"]


def _have_trunk(arrays: Mapping[str, Array]) -> bool:
    return bool(np.isin(PARTS.index("shirt"), arrays["body_capsule_parts"]))


def _have_paths(arrays: Mapping[str, Array]) -> bool:
    return np.array_equal(np.diff(arrays["actions_path_offsets"]), arrays["actions_lengths"])


def _end_in_states(arrays: Mapping[str, Array]) -> Array:
    result = frames_of(arrays)[1] == arrays["graph_state_frames"][arrays["graph_action_next"]]
    result[int(arrays["graph_action_offsets"][-1]) :] = True
    return result


def _stay_in_clips(arrays: Mapping[str, Array]) -> Array:
    starts = arrays["database_clip_starts"]
    first, last = (np.searchsorted(starts, frames, side="right") for frames in frames_of(arrays))
    return first == last


def _strikes_of(arrays: Mapping[str, Array], stride: int) -> list[Array]:
    """Return the first strike of the database in each action, and one past the last. Shapes (A,)."""
    strikes = arrays["database_strike_frames"]
    return [np.searchsorted(strikes, stride * frames, side="right") for frames in frames_of(arrays)]


def _count_strikes(arrays: Mapping[str, Array], stride: int) -> bool:
    low, high = _strikes_of(arrays, stride)
    return np.array_equal(np.diff(arrays["actions_strike_offsets"]), high - low)


def _name_strikes(arrays: Mapping[str, Array], stride: int) -> Array:
    offsets, low = arrays["actions_strike_offsets"].astype(np.int64), _strikes_of(arrays, stride)[0]
    expected = np.repeat(low - offsets[:-1], np.diff(offsets)) + np.arange(offsets[-1])
    return arrays["actions_strike_ids"] == expected


def _time_strikes(arrays: Mapping[str, Array], stride: int) -> Array:
    owners = np.repeat(frames_of(arrays)[0], np.diff(arrays["actions_strike_offsets"]))
    at = arrays["database_strike_frames"][arrays["actions_strike_ids"]]
    return arrays["actions_strike_times"] == (at / stride - owners).astype(np.float32)


_FALLS = ("falls_fall", "falls_lie", "falls_rise", "falls_stagger")
_CHEERS = ("falls_cheer",)
_RESTS = ("rests_enter", "rests_hold", "rests_leave")
_WALKS = ("walks_take", "walks_hold")
"""Names of arrays that hold numbers of actions of ``falls.Falls``, ``rests.Rests`` and ``walks.Walks``."""

OF_FALLS = (*_FALLS, "falls_direction", "falls_stagger_direction")
OF_STOPS = ("falls_stop", "falls_stagger_stop")
OF_CHEERS = (*_CHEERS, "falls_cheer_stop")
OF_RESTS = (*_RESTS, "rests_frames", "rests_state", "rests_row", "rests_next")
OF_WALKS = (*_WALKS, "walks_spans", "walks_piece", "walks_row", "walks_next")
GROUPS = (OF_FALLS, OF_CHEERS, OF_STOPS, OF_RESTS, OF_WALKS)
"""Names of the arrays of actions behind those of states; of a group all are there or none. Older bundles lack some."""

BEHIND = tuple(name for group in GROUPS for name in group)


def relations_behind(arrays: Mapping[str, Array]) -> tuple[Relation, ...]:
    """Return what must be true of the arrays of falls, rests and walks that are there.

    An ``ArrayFault`` is raised where one of them is there without the others.
    """
    relations: tuple[Relation, ...] = ()
    for what, own, needed, more in (
        ("falls", OF_FALLS, (), _FALL_RELATIONS),
        ("celebrations", OF_CHEERS, OF_FALLS, _CHEER_RELATIONS),
        ("stops of falls", OF_STOPS, OF_FALLS, _STOP_RELATIONS),
        ("rests", OF_RESTS, (), _REST_RELATIONS),
        ("walks", OF_WALKS, OF_RESTS, _WALK_RELATIONS),
    ):
        some = [name for name in own if name in arrays]
        if some and any(name not in arrays for name in (*own, *needed)):
            raise ArrayFault(some[0], f"is there without the other arrays of {what}, expected all of them or none")
        relations += more if some else ()
    return relations


def count_behind(arrays: Mapping[str, Array]) -> int:
    """Return how many actions of falls, rests and walks there are by these arrays, which need not be right."""
    return sum(arrays[name].size for name in (*_FALLS, *_CHEERS, *_RESTS, *_WALKS) if name in arrays)


def _falls_behind(arrays: Mapping[str, Array]) -> bool:
    fall, lie, rise, stagger = (arrays[name] for name in _FALLS)
    numbers = numbers_of(fall, lie, rise, stagger, arrays.get(_CHEERS[0], stagger[:0]))
    count = sum(len(arrays[name]) for name in (*_RESTS, *_WALKS) if name in arrays)
    last = len(arrays["graph_action_next"]) - count
    return np.array_equal(numbers, np.arange(arrays["graph_action_offsets"][-1], last))


def _rests_behind(arrays: Mapping[str, Array]) -> bool:
    numbers = np.concatenate([arrays[name] for name in (*_RESTS, *_WALKS) if name in arrays])
    last = len(arrays["graph_action_next"])
    return np.array_equal(numbers, np.arange(last - len(numbers), last))


def _lie_between(arrays: Mapping[str, Array]) -> Array:
    before, last = frames_of(arrays)
    fall, lie, rise = (arrays[name] for name in _FALLS[:3])
    return (before[lie] == last[fall]) & (last[lie] <= before[rise])


def _stop_within(action: str, stop: str, arrays: Mapping[str, Array]) -> Array:
    before, last = frames_of(arrays)
    return (before[arrays[action]] < arrays[stop]) & (arrays[stop] <= last[arrays[action]])


def _ascend(frames: Array) -> Array:
    return np.all(np.diff(frames, axis=1) >= 0, axis=1)


def _below(values: Array, end: int) -> Array:
    return (values >= 0) & (values < end)


def _come_to_an_end(arrays: Mapping[str, Array]) -> Array:
    pieces, following = len(arrays["rests_hold"]), arrays["walks_next"]
    own = pieces + np.arange(len(following))
    return _below(following, pieces + len(following)) & ((following < pieces) | (following > own))


_FALL_RELATIONS = (
    Relation("falls_fall", "falls, each with its lie and rise, behind the actions of states", _falls_behind),
    Relation("falls_lie", "lying between a fall and a rise", _lie_between),
)
_CHEER_RELATIONS = (
    Relation("falls_cheer_stop", "frames of celebrations", partial(_stop_within, "falls_cheer", "falls_cheer_stop")),
)
_STOP_RELATIONS = (
    Relation("falls_stop", "frames of rises", partial(_stop_within, "falls_rise", "falls_stop")),
    Relation("falls_stagger_stop", "frames of staggers", partial(_stop_within, "falls_stagger", "falls_stagger_stop")),
)
_REST_RELATIONS = (
    Relation("rests_enter", "rests behind the actions of states and falls", _rests_behind),
    Relation("rests_frames", "frames that ascend", lambda arrays: _ascend(arrays["rests_frames"])),
)
_WALK_RELATIONS = (
    Relation(
        "walks_spans",
        "frames that ascend to the one at ease behind them",
        lambda arrays: _ascend(np.column_stack([arrays["walks_spans"], arrays["rests_frames"][:, 2]])),
    ),
    Relation("walks_piece", "pieces of rests", lambda arrays: _below(arrays["walks_piece"], len(arrays["rests_hold"]))),
    Relation(
        "walks_row",
        "parts of walks, or pieces of rests",
        lambda arrays: _below(arrays["walks_row"], len(arrays["rests_hold"]) + len(arrays["walks_hold"])),
    ),
    Relation("walks_next", "parts that come later, or pieces of rests", _come_to_an_end),
)
