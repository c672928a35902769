"""What the arrays of a take must be, so that nothing in one can lead poses out of bounds.

F control frames, N avatars, G scripted targets, E strikes; types, teams and policies as many as have names.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from crowdsim.array_checks import ArrayFault, Check, Column, Index, Sizes, Within, check_array, true_or_false
from crowdsim.core.types import Array
from crowdsim.crowd.events import OUTCOMES
from crowdsim.crowd.kernels.layout import BLOCKED, EVADED, LANDED
from crowdsim.motion.strikes import LIMBS
from crowdsim.poses.known_actions import check_actions
from crowdsim.scenario.parts import STANCES

FAR, TURNS, LATE = 1e7, 1e5, 1e6
"""Greatest positions [m], headings [rad] and control frames of an action."""
SCALES, GIRTHS, LENGTHS, SPEEDS = (0.01, 100.0), (0.1, 10.0), (0.1, 10.0), (0.01, 20.0)
"""Sizes of bodies over their skeletons', thickness for their length, and motion frames in a control frame."""


def _opponents(values: Array, sizes: Sizes) -> str:
    return Index("N", -1 - sizes["G"])(values, sizes)


def _times(values: Array, sizes: Sizes) -> str:
    return Within(-1.0, float(sizes["F"]))(values, sizes)


_PLACE, _HEADING = Within(-FAR, FAR, absent=True), Within(-TURNS, TURNS, absent=True)

FRAMES: Mapping[str, Column] = {
    "action": Column("int32", ("F", "N"), (Within(-1, 2**31 - 1),)),
    "action_frame": Column("float32", ("F", "N"), (Within(0.0, LATE),)),
    "x": Column("float32", ("F", "N"), (_PLACE,)),
    "z": Column("float32", ("F", "N"), (_PLACE,)),
    "heading": Column("float32", ("F", "N"), (_HEADING,)),
    "opponent": Column("int32", ("F", "N"), (_opponents,)),
}
"""What is recorded for every control frame and avatar."""
TARGET = Column("float32", ("F", "G", 3), (Within(-FAR, FAR),))
ABSENT = ("x", "z", "heading")
"""What is not a number while an avatar is absent, and only then."""

CAST: Mapping[str, Column] = {
    "type": Column("int16", ("N",), (Index("types"),)),
    "team": Column("int16", ("N",), (Index("teams"),)),
    "policy": Column("int16", ("N",), (Index("policies"),)),
    "scale": Column("float32", ("N",), (Within(*SCALES),)),
    "speed": Column("float32", ("N",), (Within(*SPEEDS),)),
    "girth": Column("float32", ("N",), (Within(*GIRTHS),)),
    "legs": Column("float32", ("N",), (Within(*LENGTHS),)),
    "arms": Column("float32", ("N",), (Within(*LENGTHS),)),
    "tempo": Column("float32", ("N",), (Within(0.0, 1e6, absent=True),)),
    "aggression": Column("float32", ("N",), (Within(0.0, 1e6),)),
    "range": Column("float32", ("N",), (Within(-FAR, FAR),)),
    "stance": Column("uint8", ("N",), (Within(0, len(STANCES)),)),
    "group": Column("int32", ("N",), (Index("groups"),)),
}
"""What is constant for each avatar, but for its name."""

_LIMB: tuple[Check, ...] = (Within(0, len(LIMBS) - 1),)

EVENTS: Mapping[str, Column] = {
    "frame": Column("float32", ("E",), (_times,)),
    "attacker": Column("int32", ("E",), (Index("N"),)),
    "victim": Column("int32", ("E",), (_opponents,)),
    "hand": Column("uint8", ("E",), (Within(0, 1),)),
    "point": Column("float32", ("E", 3), (Within(-FAR, FAR),)),
    "speed": Column("float32", ("E",), (Within(0.0, 1e4),)),
    "landed": Column("bool", ("E",), (true_or_false,)),
    "limb": Column("uint8", ("E",), _LIMB),
    "outcome": Column("uint8", ("E",), (Within(0, len(OUTCOMES) - 1),)),
    "damage": Column("float32", ("E",), (Within(0.0, 1e8),)),
    "down": Column("bool", ("E",), (true_or_false,)),
}
"""The strikes."""


def check_strikes(events: Mapping[str, Array]) -> None:
    """Hold the variables of strikes, which have passed their table, against one another.

    Raises:
        ArrayFault: A strike lands on no avatar, or on its own attacker, or its outcome is impossible, or not what
            ``landed`` says.
    """
    victim, outcome = events["victim"], events.get("outcome")
    impossible = (victim == -1) | (victim == events["attacker"])
    _refuse_victim(victim, events["landed"] & impossible, "another avatar or a target to land on")
    if outcome is None:
        return
    _refuse_victim(victim, (outcome == EVADED) & impossible, "another avatar or a target that evades")
    _refuse_victim(victim, (outcome == BLOCKED) & (impossible | (victim < 0)), "another avatar, which blocks")
    wrong = np.flatnonzero(events["landed"] != (outcome == LANDED))
    if len(wrong):
        at = int(wrong[0])
        expected = OUTCOMES[LANDED] if events["landed"][at] else "another, since it did not land"
        raise ArrayFault("outcome", f"is {OUTCOMES[outcome[at]]} at [{at}], expected {expected}")


def _refuse_victim(victim: Array, wrong: Array, expected: str) -> None:
    if wrong.any():
        at = int(np.argmax(wrong))
        raise ArrayFault("victim", f"is {victim[at]} at [{at}], expected {expected}")


def check_absent(name: str, values: Array, action: Array) -> None:
    """Hold what is not a number while an avatar is absent against who is absent.

    Raises:
        ArrayFault: An avatar that is there is nowhere.
    """
    wrong = np.isnan(values) & (action >= 0)
    if wrong.any():
        at = ", ".join(map(str, np.unravel_index(int(np.argmax(wrong)), wrong.shape)))
        raise ArrayFault(name, f"holds nan at [{at}], expected a number where an avatar is present")


def check_rows(rows: Mapping[str, Array], sizes: Mapping[str, int], counts: Array) -> None:
    """Hold some control frames of a take against their table, and against the policies; arguments as above.

    Raises:
        ArrayFault: They are something else.
    """
    found = dict(sizes)
    for name, column in FRAMES.items():
        check_array(name, rows[name], column, found)
    for name in ABSENT:
        check_absent(name, rows[name], rows["action"])
    check_actions(rows["action"], counts)
