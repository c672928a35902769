"""The take in memory: what a run recorded, as numpy views over frames and avatars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.crowd.cast import Cast
from crowdsim.crowd.events import OUTCOMES, VARIABLES, Events
from crowdsim.crowd.record import TakeData
from crowdsim.errors import TakeError, nearest
from crowdsim.motion.strikes import LIMBS, SIDES
from crowdsim.scenario.frame_ranges import parse_times

if TYPE_CHECKING:
    from crowdsim.poses.sampler import PoseSampler

__all__ = ["STRIKE", "VARIABLES", "Cast", "Events", "Take"]


STRIKE = np.dtype(
    [
        ("seconds", "f8"),
        ("attacker", "i4"),
        ("victim", "i4"),
        ("hand", "U5"),
        ("limb", "U11"),
        ("x", "f4"),
        ("y", "f4"),
        ("z", "f4"),
        ("speed", "f4"),
        ("landed", "?"),
        ("outcome", "U7"),
    ]
)
"""A row of ``Take.strikes``."""


@dataclass(frozen=True)
class Take(TakeData):
    """A recorded run: ``TakeData``, its poses, and its strikes as a table."""

    @cached_property
    def sampler(self) -> PoseSampler:
        """Poses of the take, made on first use.

        Raises:
            TakeError: The take was opened without its policies, or with others.
        """
        from crowdsim.poses.sampler import PoseSampler

        if not self.policies:
            raise TakeError("the take has no policies, which poses need; crowdsim.open_run opens a run with both")
        return PoseSampler(self, self.policies, obstacles=getattr(self, "obstacles", None))

    def joint_names(self, avatar: int | str) -> tuple[str, ...]:
        """Return the names of an avatar's joints, in the order of ``joints``; parents come before their children.

        Raises:
            TakeError: There is no such avatar, or the take was opened without its policies.
        """
        return self.sampler.motions[self.cast.policies[self.cast.number(avatar)]].skeleton.names

    def times(self, times: ArrayLike | None) -> Array:
        """Return times of the take [s], those of all control frames when None.

        Args:
            times: Seconds as numbers, between control frames too; text such as ``4s``, or ``60`` for a control frame,
                or a sequence of these; or text such as ``2s:5s`` for the control frames of a range.

        Returns:
            Shape () for one time, else (T,) or as the numbers have, float64.

        Raises:
            TakeError: A time means nothing, or is not in the take.
        """
        if times is None:
            return np.arange(self.frame_count) / self.control_rate
        try:
            found = np.asarray(self._read_times(times), dtype=float)
        except (TypeError, ValueError):
            what = f"times are {times!r}"[:100]
            raise TakeError(f"{what}, expected seconds as numbers, or text as in 4s, 60 or 2s:5s") from None
        outside = found[~((found >= 0.0) & (found < self.seconds))]
        if outside.size:
            what = f"expected at least 0 and less than {self.seconds:g} s"
            raise TakeError(f"{outside[0]:g} s is not in the take, {what}")
        return found

    def _read_times(self, times: Any) -> Any:
        if isinstance(times, str):
            return parse_times(times, self.control_rate, self.frame_count)
        if isinstance(times, list | tuple) and any(isinstance(time, str) for time in times):
            return [self._read_times(time) for time in times]
        return times

    def joints(self, avatar: int | str | Sequence[int | str] | None = None, seconds: ArrayLike | None = None) -> Array:
        """Return where joints of avatars are, as exported and rendered: blends, planted feet, strikes and all.

        Args:
            avatar: Number or name of an avatar, or several of them, which need policies with as many joints; all when
                None.
            seconds: One time or several, see ``times``; those of all control frames when None.

        Returns:
            Positions in the world [m]; NaN while an avatar is absent. The axes are those of ``seconds``, of avatars
            where they are several, of joints, named by ``joint_names``, and x, y, z: (J, 3) for one avatar at one
            time, (T, J, 3) at several, (T, n, J, 3) for several avatars. float32.

        Raises:
            TakeError: There is no such avatar or time, bodies differ in their joints, or the take was opened without
                its policies.
        """
        one = isinstance(avatar, str) or (avatar is not None and np.ndim(avatar) == 0)
        numbers, when = self.cast.numbers(avatar), self.times(seconds)
        counts = {len(self.joint_names(int(number))) for number in numbers}
        if len(counts) > 1:
            raise TakeError(
                f"avatars have {' and '.join(map(str, sorted(counts)))} joints, expected avatars of one policy"
            )
        who, at = np.tile(numbers, when.size), np.repeat(when.reshape(-1), len(numbers))
        result = np.empty((len(who), counts.pop() if counts else 0, 3), np.float32)
        for which, _, _, positions, _ in self.sampler.moments(who, at):
            result[which] = positions
        return result.reshape(*when.shape, *(() if one else numbers.shape), *result.shape[1:])

    def strikes(self, landed: bool | None = None, outcome: str | None = None) -> Array:
        """Return the strikes as a table, in the order of time.

        Args:
            landed: Only those that landed, or only those that did not; all when None.
            outcome: Only those of which this became: ``missed``, ``landed``, ``blocked``, ``evaded``.

        Returns:
            A structured array, a row a strike: ``seconds`` [s], ``attacker``, ``victim`` (an avatar, ``-2 - k`` for
            scripted target k, -1 for none), ``hand`` (``left`` or ``right``, the side of
            the limb), ``limb`` (``left_hand``, ``right_hand``, ``left_foot``, ``right_foot``), ``x``, ``y``, ``z`` of
            fist or foot [m], its highest ``speed`` before [m/s], ``landed``, and ``outcome``. Shape (S,), dtype
            ``STRIKE``.

        Raises:
            TakeError: There is no such outcome.
        """
        if outcome is not None and outcome not in OUTCOMES:
            expected = f"{', '.join(OUTCOMES)}{nearest(outcome, OUTCOMES)}"
            raise TakeError(f"outcome is {outcome!r}, expected one of {expected}")
        events = self.events
        table = np.empty(len(events.frame), STRIKE)
        table["seconds"] = np.asarray(events.frame, dtype=float) / self.control_rate
        table["hand"] = np.asarray(SIDES)[np.asarray(events.hand)]
        table["limb"] = np.asarray(LIMBS)[np.asarray(events.limb)]
        table["outcome"] = np.asarray(OUTCOMES)[np.asarray(events.outcome)]
        for name in ("attacker", "victim", "speed", "landed"):
            table[name] = getattr(events, name)
        for column, name in enumerate("xyz"):
            table[name] = np.asarray(events.point)[:, column]
        table = table[np.argsort(table["seconds"], kind="stable")]
        table = table if landed is None else table[table["landed"] == landed]
        return table if outcome is None else table[table["outcome"] == outcome]
