"""What a run recorded, as numpy views over frames and avatars."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.events import Events
from crowdsim.scenario.frame_ranges import frame_limit, output_frames

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy


_USUAL: dict[str, tuple[float, Any]] = {
    "girths": (1.0, np.float32),
    "legs": (1.0, np.float32),
    "arms": (1.0, np.float32),
    "tempos": (math.nan, np.float32),
    "aggressions": (1.0, np.float32),
    "ranges": (0.0, np.float32),
    "stances": (0, np.uint8),
}
"""What avatars are like whose take does not say."""


def _unknown() -> Array:
    return np.zeros(0)


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
        girths: How thick trunk and limbs are for their length. Shape (N,), float32.
        legs: How long thighs and shanks are for the size of the body. Shape (N,), float32.
        arms: How long upper arms and forearms are for it. Shape (N,), float32.
        tempos: Strikes a minute that the avatar can sustain, NaN for one that never tires. Shape (N,), float32.
        aggressions: How readily it strikes, as a factor. Shape (N,), float32.
        ranges: How much further than others it keeps from its opponent while it rests [m]. Shape (N,), float32.
        stances: 0 any, 1 orthodox, 2 southpaw. Shape (N,), uint8.
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
    girths: Array = field(default_factory=_unknown)
    legs: Array = field(default_factory=_unknown)
    arms: Array = field(default_factory=_unknown)
    tempos: Array = field(default_factory=_unknown)
    aggressions: Array = field(default_factory=_unknown)
    ranges: Array = field(default_factory=_unknown)
    stances: Array = field(default_factory=_unknown)

    def __post_init__(self) -> None:
        """Give all avatars of takes that do not record them the usual body and temperament."""
        for name, (usual, dtype) in _USUAL.items():
            if len(getattr(self, name)) == 0:
                object.__setattr__(self, name, np.full(len(self.names), usual, dtype))

    @property
    def widths(self) -> Array:
        """How thick bodies are: sizes times girths. Shape (N,), float64."""
        return np.asarray(np.asarray(self.scales, float) * self.girths)

    @property
    def stretches(self) -> Array:
        """How long bones of trunks, legs and arms are for the size of the body. Shape (N, 3), float64."""
        return np.stack([np.ones(len(self.legs)), self.legs, self.arms], axis=1).astype(float)


@dataclass(frozen=True)
class TakeData:
    """A recorded run; F control frames, N avatars. Absent avatars have action -1.

    The recorded variables may be numpy arrays or lazily read ones; slice them to get numpy.

    Attributes:
        action: Action that each avatar does, a number of its policy's graph. Shape (F, N), int32.
        action_frame: Frames of that action done, in control frames from its state. Shape (F, N), float32.
        x: Position of the avatar [m]. Shape (F, N), float32.
        z: Likewise [m].
        heading: Where it looks [rad].
        opponent: Avatar that it fights, ``-2 - k`` for scripted target k, -1 for none. Shape (F, N), int32.
        cast: What is constant for each avatar.
        targets: Positions of scripted targets [m]. Shape (F, G, 3), float32.
        target_names: Names of scripted targets. Length G.
        events: Strikes.
        control_rate: Control frames a second.
        scenario: Name of the scenario.
        seed: Seed of the run.
        fingerprints: Fingerprint of each policy's bundle.
        status: ``done`` or ``interrupted``.
        reactions: Whether avatars that a strike lands on react to it.
        collision_avoidance: Whether avatars avoid one another; trunks that lean into others give way then.
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
    collision_avoidance: bool = True
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
