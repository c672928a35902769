"""The take in memory: what a run recorded, as numpy views over frames and avatars."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.crowd.events import OUTCOMES, VARIABLES, Events
from crowdsim.crowd.record import Cast, TakeData
from crowdsim.errors import TakeError, nearest
from crowdsim.motion.strikes import LIMBS, SIDES

if TYPE_CHECKING:
    from crowdsim.poses.sampler import PoseSampler

__all__ = ["STRIKE", "VARIABLES", "Cast", "Events", "Take"]


STRIKE = np.dtype(
    [
        ("seconds", "f8"),
        ("attacker", "i4"),
        ("victim", "i4"),
        ("hand", "U5"),
        ("limb", "U10"),
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
        return PoseSampler(self, self.policies)

    def joint_names(self, avatar: int) -> tuple[str, ...]:
        """Return the names of an avatar's joints, in the order of ``joints``; parents come before their children.

        Raises:
            TakeError: There is no such avatar, or the take was opened without its policies.
        """
        return self.sampler.motions[self._policy_of(avatar)].skeleton.names

    def joints(self, avatar: int, seconds: ArrayLike) -> Array:
        """Return where an avatar's joints are, as exported and rendered: blends, planted feet, strikes and all.

        Args:
            avatar: Number of the avatar.
            seconds: One time or several, from 0 to ``seconds`` of the take [s], between control frames too.

        Returns:
            Positions in the world [m]; NaN while the avatar is absent. Shape (J, 3) for one time, else
            (T, J, 3), float32; J joints, named by ``joint_names``.

        Raises:
            TakeError: There is no such avatar or time, or the take was opened without its policies.
        """
        self._policy_of(avatar)
        times = np.asarray(seconds, dtype=float)
        outside = times[~((times >= 0.0) & (times <= self.seconds + 1e-6))]
        if outside.size:
            raise TakeError(f"{outside[0]:g} s is not in the take, expected 0 to {self.seconds:g} s")
        flat = times.reshape(-1)
        result = np.empty((len(flat), len(self.joint_names(avatar)), 3), np.float32)
        for which, _, _, positions, _ in self.sampler.moments(np.full(len(flat), avatar), flat):
            result[which] = positions
        return result.reshape(*times.shape, *result.shape[1:])

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
            ValueError: There is no such outcome.
        """
        if outcome is not None and outcome not in OUTCOMES:
            expected = f"{', '.join(OUTCOMES)}{nearest(outcome, OUTCOMES)}"
            raise ValueError(f"outcome is {outcome!r}, expected one of {expected}")
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

    def _policy_of(self, avatar: int) -> int:
        if not 0 <= avatar < self.avatar_count:
            raise TakeError(f"there is no avatar {avatar}, expected 0 to {self.avatar_count - 1}")
        return int(self.cast.policies[avatar])
