"""The take in memory: what a run recorded, as numpy views over frames and avatars."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdsim.crowd.events import VARIABLES, Events
from crowdsim.errors import TakeError
from crowdsim.frame_ranges import frame_limit, output_frames

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy
    from crowdsim.take.poses import PoseSampler

__all__ = ["STRIKE", "VARIABLES", "Cast", "Events", "Take"]

Array = NDArray[Any]

STRIKE = np.dtype(
    [
        ("seconds", "f8"),
        ("attacker", "i4"),
        ("victim", "i4"),
        ("hand", "U5"),
        ("x", "f4"),
        ("y", "f4"),
        ("z", "f4"),
        ("speed", "f4"),
        ("landed", "?"),
    ]
)
"""A row of ``Take.strikes``."""


@dataclass(frozen=True)
class Cast:
    """What is constant for each avatar over a run; N avatars.

    Attributes:
        names: Name of each avatar. Shape (N,), str.
        types: Index into ``type_names``. Shape (N,), int16.
        teams: Index into ``team_names``. Shape (N,), int16.
        policies: Index into ``policy_names``. Shape (N,), int16.
        scales: Size of the body over its skeleton's. Shape (N,), float32.
        speeds: Motion frames in a control frame. Shape (N,), float32.
        type_names: Names of the avatar types.
        team_names: Names of the teams.
        policy_names: Names of the policies.
        colours: Colour of each type, red, green, blue in 0..1; NaN where the scenario gives none. Shape (types, 3).
    """

    names: Array
    types: Array
    teams: Array
    policies: Array
    scales: Array
    speeds: Array
    type_names: tuple[str, ...]
    team_names: tuple[str, ...]
    policy_names: tuple[str, ...]
    colours: Array


@dataclass(frozen=True)
class Take:
    """A recorded run; F control frames, N avatars. Absent avatars have action -1.

    The recorded variables may be numpy arrays or lazily read ones; slice them to get numpy.

    Attributes:
        action: Action that each avatar does, a number of its policy's graph. Shape (F, N), int32.
        action_frame: Frames of that action done, in control frames from its state. Shape (F, N), float32.
        x: Where the avatar stands [m]. Shape (F, N), float32.
        z: Likewise [m].
        heading: Where it looks [rad].
        opponent: Avatar that it fights, ``-2 - k`` for scripted target k, -1 for nobody. Shape (F, N), int32.
        cast: What is constant for each avatar.
        targets: Places of scripted targets [m]. Shape (F, G, 3), float32.
        target_names: Names of scripted targets. Length G.
        events: Strikes.
        control_rate: Control frames a second.
        scenario: Name of the scenario.
        seed: Seed of the run.
        fingerprints: Fingerprint of each policy's bundle.
        status: ``done`` or ``interrupted``.
        reactions: Whether those whom a strike lands on give way to it.
        policies: The policies, in the order of ``cast.policy_names``, where they are loaded: by ``crowdsim.run`` and
            ``crowdsim.open_run``. Poses need them.
    """

    action: Any
    action_frame: Any
    x: Any
    z: Any
    heading: Any
    opponent: Any
    cast: Cast
    targets: Any
    target_names: tuple[str, ...]
    events: Events
    control_rate: float
    scenario: str
    seed: int
    fingerprints: tuple[str, ...]
    status: str
    reactions: bool = True
    policies: tuple[Policy, ...] = field(default=(), repr=False, compare=False)

    @property
    def frame_count(self) -> int:
        """Number of control frames F."""
        return int(self.action.shape[0])

    @property
    def avatar_count(self) -> int:
        """Number of avatars N."""
        return int(self.action.shape[1])

    @property
    def seconds(self) -> float:
        """Time from the first control frame to the last [s]."""
        return max(self.frame_count - 1, 0) / self.control_rate

    def output_frames(self, fps: float) -> int:
        """Return how many output frames at ``fps`` lie between the first control frame and the last, both included."""
        return output_frames(self.frame_count, self.control_rate, fps)

    def frame_limit(self, fps: float) -> int:
        """Return how many output frames at ``fps`` the take lasts, its last control frame included."""
        return frame_limit(self.frame_count, self.control_rate, fps)

    @cached_property
    def sampler(self) -> PoseSampler:
        """Poses of the take, made on first use.

        Raises:
            TakeError: The take was opened without its policies, or with others.
        """
        from crowdsim.take.poses import PoseSampler

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
        told = np.empty((len(flat), len(self.joint_names(avatar)), 3), np.float32)
        for which, _, _, positions, _ in self.sampler.moments(np.full(len(flat), avatar), flat):
            told[which] = positions
        return told.reshape(*times.shape, *told.shape[1:])

    def strikes(self, landed: bool | None = None) -> Array:
        """Return the strikes as a table, in the order of time.

        Args:
            landed: Only those that landed, or only those that did not; all when None.

        Returns:
            A structured array, a row a strike: ``seconds`` [s], ``attacker``, ``victim`` (an avatar, ``-2 - k`` for
            scripted target k, -1 for nobody), ``hand`` (``left`` or ``right``), ``x``, ``y``, ``z`` of the fist [m],
            its highest ``speed`` before [m/s], and ``landed``. Shape (S,), dtype ``STRIKE``.
        """
        events = self.events
        table = np.empty(len(events.frame), STRIKE)
        table["seconds"] = np.asarray(events.frame, dtype=float) / self.control_rate
        table["hand"] = np.where(np.asarray(events.hand) == 0, "left", "right")
        for name in ("attacker", "victim", "speed", "landed"):
            table[name] = getattr(events, name)
        for column, name in enumerate("xyz"):
            table[name] = np.asarray(events.point)[:, column]
        table = table[np.argsort(table["seconds"], kind="stable")]
        return table if landed is None else table[table["landed"] == landed]

    def _policy_of(self, avatar: int) -> int:
        if not 0 <= avatar < self.avatar_count:
            raise TakeError(f"there is no avatar {avatar}, expected 0 to {self.avatar_count - 1}")
        return int(self.cast.policies[avatar])
