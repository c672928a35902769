"""How well avatars fight over a whole run: when and how often strikes land, and how near opponents keep."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.cast import Cast
from crowdsim.crowd.chunk import Chunk
from crowdsim.crowd.events import OUTCOMES, VARIABLES, Events
from crowdsim.crowd.kernels.layout import BLOCKED, EVADED
from crowdsim.crowd.record import TakeData
from crowdsim.crowd.statistics import overlapping
from crowdsim.motion.strikers import GROUPS, LIMBS

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

AFTER = 10.0
"""Time that avatars are given to come together; positions are measured from then on [s]."""
OUT_OF_REACH = 1.5
"""An opponent farther away than this over the ground is out of reach [m]."""
AIR, HAND = 1.4, 1.0
"""A strike is thrown at the air when the opponent is farther away than ``AIR`` over the ground [m]; one of a striker
that reaches farther than ``HAND``, as a boxer's hands do, when it is that much farther away (``air_distances``)."""
_REACH = 95.0
"""Percentile of the reaches of a striker's strikes that is its reach."""
STUCK = 10.0
"""An avatar is stuck when its opponent is out of reach for longer than this at a stretch [s]."""

_READ_AVATAR_FRAMES = 4_000_000
_BLOCK_AVATAR_FRAMES = 500_000
_SAMPLED_AVATAR_FRAMES = 2_000_000


@dataclass(frozen=True)
class FightMeasures:
    """A run as a fight. Figures of which there is nothing to measure are None.

    *Counted time* is the time of avatars that are present and have an opponent that is present, an avatar or a
    scripted target, from ``after`` on (``measure_fights``). Distances are over the ground, in metres whatever the
    scales. Rates are over all the time that avatars are present.

    Attributes:
        first_landed_seconds: Time of the first strike that landed [s].
        out_of_reach_share: Share of counted time in which the opponent is farther away than ``OUT_OF_REACH``.
        stuck_avatars: Number of avatars out of reach for longer than ``STUCK`` at a stretch of counted time, whether
            or not they changed their opponent meanwhile; None when the counted time is too short for it.
        stuck_share: The same over the number of avatars that have counted time.
        thrown_per_minute: Strikes thrown per avatar per minute.
        landed_per_minute: Strikes landed per avatar per minute.
        least_landed_per_minute: Strikes landed per minute by the avatar that lands least.
        landed_share: Share of the strikes thrown that landed.
        blocked_share: Share of the strikes thrown that a forearm or glove of the victim stopped.
        evaded_share: Share of the strikes thrown that the victim evaded.
        air_share: Share of strikes thrown while the opponent was farther away than ``air_distances``; of those thrown
            with an opponent. Positions are interpolated between control frames.
        turned_away_share: Share of counted time in which the opponent is more than 90 degrees off the heading.
        distance_median: Median distance to the opponent in counted time [m]; of frames evenly picked in long runs
            of large crowds.
        overlap_share: Share of avatar-frames in which the disc that a body takes up overlaps another's; likewise of
            frames evenly picked.
    """

    first_landed_seconds: float | None
    out_of_reach_share: float | None
    stuck_avatars: int | None
    stuck_share: float | None
    thrown_per_minute: float | None
    landed_per_minute: float | None
    least_landed_per_minute: float | None
    landed_share: float | None
    blocked_share: float | None
    evaded_share: float | None
    air_share: float | None
    turned_away_share: float | None
    distance_median: float | None
    overlap_share: float | None


class FightCounter:
    """Measures a run chunk by chunk as it comes, in memory that does not grow with its length.

    Args:
        cast: The avatars.
        policies: Their policies, in the order of ``cast.policy_names``.
        rate: Control frames per second.
        frames: Control frames planned, by which frames are picked for medians and overlaps.
        after: Time from which positions are counted [s].
    """

    def __init__(self, cast: Cast, policies: Sequence[Policy], rate: float, frames: int, after: float = AFTER) -> None:
        self._scales, self._policies = cast.widths, np.asarray(cast.policies)
        self._air_from = air_distances(policies)
        self._rate = rate
        self._begin = int(np.ceil(after * rate - 1e-6))
        self._every = max(1, -(-frames * len(self._scales) // _SAMPLED_AVATAR_FRAMES))
        self._last: tuple[Array, Array, Array] | None = None
        self._first_landed: float | None = None
        self._present, self._thrown, self._landed, self._stretch, self._longest = np.zeros(
            (5, len(self._scales)), np.int32
        )
        self._outcomes = np.zeros(len(OUTCOMES), np.int64)
        self._seen = np.zeros(len(self._scales), bool)
        self._frames = self._known = self._out = self._away = self._aimed = self._air = 0
        self._looked = self._overlapping = 0
        self._distances: list[Array] = []

    def add(self, chunk: Chunk) -> None:
        """Count one more chunk; chunks come in the order of time."""
        self._add_strikes(chunk)
        self._last = (chunk.x[-1].copy(), chunk.z[-1].copy(), chunk.targets[-1].copy())
        self._present += np.count_nonzero(chunk.action >= 0, axis=0).astype(np.int32)
        some = slice(-chunk.first % self._every, None, self._every)
        here = chunk.action[some] >= 0
        self._looked += int(np.count_nonzero(here))
        x, z = (np.where(here, values[some], np.nan) for values in (chunk.x, chunk.z))
        self._overlapping += int(np.count_nonzero(overlapping(x, z, self._scales)))
        rows = max(1, _BLOCK_AVATAR_FRAMES // max(len(self._scales), 1))
        for first in range(max(self._begin - chunk.first, 0), chunk.frames, rows):
            self._add_positions(chunk, slice(first, min(first + rows, chunk.frames)))

    def _add_positions(self, chunk: Chunk, rows: slice) -> None:
        dx, dz, known = opponent_offsets(chunk, rows)
        opponent = np.asarray(chunk.opponent[rows])
        of_opponent = np.take_along_axis(opponent, np.maximum(opponent, 0), axis=1)
        # An avatar that is down has no opponent, and no other needs to face it.
        known = known & ((opponent < 0) | (of_opponent != -1))
        distances = np.hypot(dx, dz)
        out = known & (distances > OUT_OF_REACH)
        heading = chunk.heading[rows]
        away = known & (dx * np.sin(heading) + dz * np.cos(heading) < 0.0)
        self._known += int(np.count_nonzero(known))
        self._out += int(np.count_nonzero(out))
        self._away += int(np.count_nonzero(away))
        self._seen |= known.any(axis=0)
        for k in range(len(out)):
            self._stretch += 1
            self._stretch *= out[k]
            np.maximum(self._longest, self._stretch, out=self._longest)
            if self._frames % self._every == 0:
                self._distances.append(distances[k, known[k]])
            self._frames += 1

    def _add_strikes(self, chunk: Chunk) -> None:
        events = chunk.events
        attacker, landed = np.asarray(events.attacker, np.int64), np.asarray(events.landed, bool)
        self._thrown += np.bincount(attacker, minlength=len(self._scales)).astype(np.int32)
        self._landed += np.bincount(attacker[landed], minlength=len(self._scales)).astype(np.int32)
        self._outcomes += np.bincount(events.outcome, minlength=len(OUTCOMES))
        frames = np.asarray(events.frame, float)
        if self._first_landed is None and landed.any():
            self._first_landed = float(frames[landed].min()) / self._rate
        distances = self._strike_distances(chunk, frames, attacker, np.asarray(events.victim, np.int64))
        self._aimed += int(np.count_nonzero(np.isfinite(distances)))
        limbs = np.asarray(events.limb, np.int64)
        self._air += int(np.count_nonzero(distances > self._air_from[self._policies[attacker], limbs]))

    def _strike_distances(self, chunk: Chunk, frames: Array, attacker: Array, victim: Array) -> Array:
        """Return how far the opponent is at each strike [m]; NaN without one. Shape (S,)."""
        before = np.clip(np.floor(frames).astype(np.int64) - chunk.first, -1, chunk.frames - 1)
        if self._last is None:
            before = np.maximum(before, 0)
        after = np.minimum(before + 1, chunk.frames - 1)
        share = np.clip(frames - chunk.first - before, 0.0, 1.0)[:, None]
        offsets = [self._offsets(chunk, rows, attacker, victim) for rows in (before, after)]
        # A share of zero takes nothing from a frame in which an avatar may be absent.
        offset = np.where(share > 0.0, offsets[0] * (1.0 - share) + offsets[1] * share, offsets[0])
        # An avatar that is down has no opponent.
        avatar = np.flatnonzero(victim >= 0)
        then = np.where(share[:, 0] > 0.0, after, before)[avatar]
        offset[avatar[chunk.opponent[then, victim[avatar]] == -1]] = np.nan
        return np.linalg.norm(offset, axis=1)

    def _offsets(self, chunk: Chunk, rows: Array, attacker: Array, victim: Array) -> Array:
        """Return x and z from attackers to victims in rows of a chunk; row -1 is the frame before. Shape (S, 2)."""
        found = np.full((len(rows), 2), np.nan)
        scripted, avatar = victim <= -2, victim >= 0
        for component, values in enumerate((chunk.x, chunk.z)):
            own, target = values[rows, attacker], chunk.targets[..., 2 * component]
            found[avatar, component] = values[rows[avatar], victim[avatar]] - own[avatar]
            found[scripted, component] = target[rows[scripted], -2 - victim[scripted]] - own[scripted]
            earlier = rows < 0
            if self._last is not None and earlier.any():
                last, target = self._last[component], self._last[2][:, 2 * component]
                both, aimed = earlier & avatar, earlier & scripted
                found[both, component] = last[victim[both]] - last[attacker[both]]
                found[aimed, component] = target[-2 - victim[aimed]] - last[attacker[aimed]]
        return found

    def finish(self) -> FightMeasures:
        """Return what has been measured."""
        minutes = self._present / self._rate / 60.0
        total, thrown, landed = float(minutes.sum()), int(self._thrown.sum()), int(self._landed.sum())
        here = minutes > 0.0
        least = float((self._landed[here] / minutes[here]).min()) if here.any() else None
        long_enough = self._frames / self._rate > STUCK and self._seen.any()
        stuck = int(np.count_nonzero(self._longest / self._rate > STUCK)) if long_enough else None
        distances = np.concatenate(self._distances) if self._distances else np.zeros(0)
        return FightMeasures(
            first_landed_seconds=self._first_landed,
            out_of_reach_share=_ratio(self._out, self._known),
            stuck_avatars=stuck,
            stuck_share=None if stuck is None else stuck / int(np.count_nonzero(self._seen)),
            thrown_per_minute=_ratio(thrown, total),
            landed_per_minute=_ratio(landed, total),
            least_landed_per_minute=least,
            landed_share=_ratio(landed, thrown),
            blocked_share=_ratio(int(self._outcomes[BLOCKED]), thrown),
            evaded_share=_ratio(int(self._outcomes[EVADED]), thrown),
            air_share=_ratio(self._air, self._aimed),
            turned_away_share=_ratio(self._away, self._known),
            distance_median=float(np.median(distances)) if len(distances) else None,
            overlap_share=_ratio(self._overlapping, self._looked),
        )


def air_distances(policies: Sequence[Policy]) -> Array:
    """Return from which distance of the opponent on strikes are thrown at the air [m], by policy and striker.

    It is ``AIR`` for strikers that reach no farther than ``HAND``, and as much more as the strikes of a policy with
    strikers of that kind, on either side, reach farther over the ground.

    Args:
        policies: The policies.

    Returns:
        Shape (policies, strikers).
    """
    found = np.full((len(policies), len(LIMBS)), AIR)
    for row, policy in zip(found, policies, strict=True):
        database = policy.database
        reaches = np.hypot(*np.reshape(database.strike_positions, (-1, 3)).astype(float)[:, [0, 2]].T)
        for limbs in GROUPS.values():
            struck = reaches[np.isin(database.strike_limbs, limbs)]
            if len(struck):
                row[list(limbs)] += max(float(np.percentile(struck, _REACH)) - HAND, 0.0)
    return found


def measure_fights(take: TakeData, policies: Sequence[Policy], after: float = AFTER) -> FightMeasures:
    """Return how well avatars fight in a take, read a few frames at a time.

    Args:
        take: The take, in memory or lazily read.
        policies: Its policies, in the order of ``cast.policy_names``.
        after: Time from which positions are counted [s].
    """
    counter = FightCounter(take.cast, policies, take.control_rate, take.frame_count, after)
    for chunk in chunks_of(take):
        counter.add(chunk)
    return counter.finish()


def opponent_offsets(chunk: Chunk, rows: slice = slice(None)) -> tuple[Array, Array, Array]:
    """Return x and z from each avatar to its opponent [m], and whether both are there.

    Args:
        chunk: Frames of a run.
        rows: Which of its frames.

    Returns:
        Offsets along x and z, and where they are known. Shape (frames, N) each.
    """
    action, opponent = chunk.action[rows], chunk.opponent[rows]
    x, z, targets = chunk.x[rows], chunk.z[rows], chunk.targets[rows]
    other = np.maximum(opponent, 0)
    known = (action >= 0) & (opponent >= 0) & (np.take_along_axis(action, other, axis=1) >= 0)
    ox, oz = np.take_along_axis(x, other, axis=1), np.take_along_axis(z, other, axis=1)
    scripted = opponent <= -2
    if scripted.any():
        row, avatar = np.nonzero(scripted)
        points = targets[row, -2 - opponent[row, avatar]]
        ox[row, avatar], oz[row, avatar] = points[:, 0], points[:, 2]
        known |= scripted & (action >= 0)
    return ox - x, oz - z, known


def chunks_of(take: TakeData) -> Iterator[Chunk]:
    """Yield a take's frames in chunks, each with the strikes thrown since the frame before its first."""
    rows = max(1, _READ_AVATAR_FRAMES // max(take.avatar_count, 1))
    strikes = {name: np.asarray(getattr(take.events, name)) for name in Events.__dataclass_fields__}
    order = np.argsort(strikes["frame"], kind="stable")
    strikes = {name: values[order] for name, values in strikes.items()}
    ends = [*range(rows, take.frame_count, rows), take.frame_count] if take.frame_count else []
    begin = first = 0
    for end in ends:
        last = len(order) if end == take.frame_count else int(np.searchsorted(strikes["frame"], end - 1, side="right"))
        yield Chunk(
            first=first,
            **{name: np.asarray(getattr(take, name)[first:end]) for name in VARIABLES},
            targets=np.asarray(take.targets[first:end]),
            events=Events(**{name: values[begin:last] for name, values in strikes.items()}),
        )
        first, begin = end, last


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None
