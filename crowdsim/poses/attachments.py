"""What avatars carry, where their joints are: the one place that puts attachments into the world."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.cast import Cast
from crowdsim.crowd.record import TakeData
from crowdsim.errors import TakeError
from crowdsim.motion import quaternion

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy


class Held(NamedTuple):
    """Capsules that avatars carry; m of them.

    Attributes:
        avatars: Number of the avatar. Shape (m,).
        starts: One end of the axis in the world [m]. Shape (m, 3).
        ends: The other end [m]. Shape (m, 3).
        radii: Radius [m]. Shape (m,).
        colours: Red, green and blue in 0..1. Shape (m, 3).
    """

    avatars: Array
    starts: Array
    ends: Array
    radii: Array
    colours: Array


def place_attachments(cast: Cast, avatars: Array, positions: Array, rotations: Array) -> Held:
    """Return the capsules that some avatars of one skeleton carry; those of absent avatars are left out.

    They grow with the body.

    Args:
        cast: All avatars.
        avatars: Numbers of some of them. Shape (n,).
        positions: Positions of their joints in the world, NaN while absent [m]. Shape (n, J, 3).
        rotations: Their rotations. Shape (n, J, 4).
    """
    props, types = cast.held, np.asarray(cast.types)[avatars]
    order = np.argsort(props["type"], kind="stable")
    low, high = (np.searchsorted(props["type"][order], types, side=side) for side in ("left", "right"))
    who = np.repeat(np.arange(len(avatars)), high - low)
    first = np.repeat(np.cumsum(high - low) - (high - low), high - low)
    rows = props[order[np.arange(len(who)) - first + np.repeat(low, high - low)]]
    there = np.isfinite(positions[who, rows["joint"], 0])
    who, rows = who[there], rows[there]
    at, turned = positions[who, rows["joint"]].astype(float), rotations[who, rows["joint"]].astype(float)
    sizes = np.asarray(cast.scales, float)[avatars[who]]
    starts, ends = (
        at + sizes[:, None] * quaternion.rotate(turned, rows[key].astype(float)) for key in ("start", "end")
    )
    return Held(avatars[who], starts, ends, rows["radius"] * sizes, rows["colour"])


def check_attachments(take: TakeData, policies: Sequence[Policy]) -> None:
    """Hold the joints that carry something against those that there are.

    Raises:
        TakeError: The skeleton of an avatar that carries something does not have its joint.
    """
    cast = take.cast
    fewest = np.full(len(cast.type_names), np.iinfo(np.int32).max)
    counts = np.array([len(policy.database.skeleton.names) for policy in policies], np.int32)
    np.minimum.at(fewest, cast.types, counts[cast.policies])
    for key, props in (("attachments", cast.attachments), ("faces", cast.faces)):
        for index in np.flatnonzero(props["joint"] >= fewest[props["type"]])[:1]:
            kind, joint = props["type"][index], props["joint"][index]
            raise TakeError(
                f"take {take.scenario!r}: {key}[{index}].joint is {joint}, expected one below {fewest[kind]}, the "
                f"joints of the policy of type {cast.type_names[kind]!r}"
            )
