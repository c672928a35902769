"""What kernels of poses work on: named tuples of arrays."""

from typing import Any, NamedTuple

from crowdsim.core.types import Array


class Rows(NamedTuple):
    """Control frames of a take; R rows, n avatars.

    Attributes:
        present: Whether each avatar is there. Shape (R, n), bool.
        origins: Playback frame at which its action starts. Shape (R, n), int64.
        lengths: Length of its action [control frames]. Shape (R, n).
        phase: How much of it is done [control frames]. Shape (R, n).
        moved: How long ago it began, which is more where it is over already [frames of motion]. Shape (R, n).
        shifts: Ground transform of its first frame when it starts, relative to the avatar's. Shape (R, n, 3).
        ground: Ground transform. Shape (R, n, 3).
        fresh: Whether its action began on the way to this row. Shape (R, n), bool.
        speeds: Motion frames in a control frame. Shape (n,).
        scales: Size of each body. Shape (n,).
        sizes: Size of the bones of its trunk, legs and arms, by ``segments`` of joints; that of the trunk, head, hands
            and feet is its scale. Shape (n, 3).
        first: Control frame of the first row.
        rate: Control frames a second.
    """

    present: Array
    origins: Array
    lengths: Array
    phase: Array
    moved: Array
    shifts: Array
    ground: Array
    fresh: Array
    speeds: Array
    scales: Array
    sizes: Array
    first: int
    rate: float


class Offsets(NamedTuple):
    """Numbers of n avatars at frames of a grid, between which splines lead.

    Attributes:
        values: One or several for each frame and avatar. Shape (R, n) or (R, n, ...), float32.
        first: The first frame.
        rate: Frames a second.
    """

    values: Array
    first: int
    rate: float


class Moments(NamedTuple):
    """Which avatars are posed, and when.

    Attributes:
        columns: Column of each avatar in the window. Shape (n,).
        times: Shape (T, n), or (T, 1) where they are the same for all [s].
    """

    columns: Array
    times: Array


class Playback(NamedTuple):
    """Where avatars are at T times; n of them.

    Attributes:
        frames: Playback frame; -1 while absent. Shape (T, n), int32.
        fractions: How far on to the next playback frame. Shape (T, n).
        ground: Ground transform. Shape (T, n, 3).
    """

    frames: Array
    fractions: Array
    ground: Array


class Posed(NamedTuple):
    """Poses of n avatars at T times.

    Attributes:
        roots: Position of the root in the world [m]. Shape (T, n, 3), float32.
        rotations: Local rotations, the root's in the world. Shape (T, n, J, 4), float32.
    """

    roots: Array
    rotations: Array


class Transitions(NamedTuple):
    """Where motion does not go on as captured, by avatar and time; C transitions of n avatars, J joints.

    Attributes:
        starts: Those of avatar i are ``starts[i]`` up to ``starts[i + 1]``. Shape (n + 1,).
        owners: Avatar of each, a column of the window. Shape (C,).
        times: When [s]. Shape (C,).
        before: Playback frame that the transition leaves. Shape (C,).
        after: Playback frame that it goes on from. Shape (C,).
        spans: How long before and after it the blend lasts [s]. Shape (C, 2).
        shifts: Ground transform of the motion after it, relative to that of the motion before it. Shape (C, 3).
        signs: 1, or -1 where a joint's quaternion goes on with the other sign; in the last column whether any does.
            Shape (C, J + 1), int8.
        ground: Ground transform of the motion after it. Shape (C, 3).
        directions: Cosine and sine of the angle from the clip's world to the world, for the motion before it and for
            the motion after it. Shape (C, 2, 2).
    """

    starts: Array
    owners: Array
    times: Array
    before: Array
    after: Array
    spans: Array
    shifts: Array
    signs: Array
    ground: Array
    directions: Array


class FootPlants(NamedTuple):
    """When feet are planted; n avatars.

    Attributes:
        spans: Beginning and end of each foot plant, in order [s]. Shape (n, 2, most, 2).
        counts: How many each foot has. Shape (n, 2).
    """

    spans: Array
    counts: Array


class Steps(NamedTuple):
    """What feet do about transitions; C of them.

    Attributes:
        kinds: ``steps.AIRBORNE``, ``steps.STAYS`` or ``steps.STEP``. Shape (C, 2), int8.
        moves: Beginning and end of the time in which the foot moves [s], and how high it rises [m]. Shape (C, 2, 3).
        gaps: How far held points of the feet jump in the world [m]; how feet turn there: a level rotation vector (its
            x and z) and the angle about +y that follows it (y); and rotation vectors by which toes jump on them. After
            less before. Shape (C, 2, 9).
        returns: Rotations of feet, and of toes on them, back over these gaps. Shape (C, 2, 2, 4).
    """

    kinds: Array
    moves: Array
    gaps: Array
    returns: Array


class Footing(NamedTuple):
    """All that decides where feet belong.

    Attributes:
        motion: The playback frames, a ``motion.Frames``.
        transitions: The transitions.
        plants: The foot plants.
        steps: What feet do about the transitions.
    """

    motion: Any
    transitions: Transitions
    plants: FootPlants
    steps: Steps
