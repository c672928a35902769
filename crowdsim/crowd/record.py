"""What a run recorded, as numpy views over frames and avatars."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from crowdsim.crowd.cast import Cast
from crowdsim.crowd.events import Events
from crowdsim.scenario.frame_ranges import output_frames

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy


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
        """How long it lasts [s]: each control frame lasts until the next one, or as long as that would take."""
        return self.frame_count / self.control_rate

    def output_frames(self, fps: float) -> int:
        """Return how many output frames at ``fps`` it has."""
        return output_frames(self.frame_count, self.control_rate, fps)
