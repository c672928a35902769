"""The motion database: all clips in one, with a global frame index; clips are only ranges of it."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from crowdsim.core.types import Array, Progress
from crowdsim.errors import MotionError
from crowdsim.motion import ground, quaternion
from crowdsim.motion.analysis import ClipAnalysis, analyse_clip
from crowdsim.motion.body import Body
from crowdsim.motion.clip_grounds import clip_grounds
from crowdsim.motion.fall_spans import clip_spans, joined_spans
from crowdsim.motion.falls import FallSpans, no_falls
from crowdsim.motion.measuring import MeasuredClip
from crowdsim.motion.mirroring import mirrored
from crowdsim.motion.resampling import resample
from crowdsim.motion.rests import RestSpans, find_rests, in_control_frames, joined_rests, no_rests
from crowdsim.motion.skeleton import Clip, Skeleton
from crowdsim.motion.strikers import HANDS, mirror_limb


@dataclass(frozen=True)
class MotionDatabase:
    """Motion of one skeleton at the playback rate, on a common floor, with what was found in it.

    Every clip holds whole control frames, so playback frame ``p`` lies at control frame ``p / stride`` for all clips.
    F counts control frames, P = F * stride playback frames, J joints, S strikes, C clips.

    Attributes:
        skeleton: The skeleton of every clip [m].
        body: What the skeleton is as a body.
        control_rate: Control frames a second.
        playback_rate: Playback frames a second.
        clip_names: Names of the clips, a mirrored one with the suffix ``~mirror``. Length C.
        clip_starts: First control frame of each clip, and F. Shape (C + 1,), int32.
        root_positions: Position of the root in its clip's world, the floor at 0 [m]. Shape (P, 3), float32.
        rotations: Local joint rotations, continuous in sign within a clip. Shape (P, J, 4), float32.
        ground: Ground transform of the body in its clip's world: where its feet are, as in ``Tracks.stances``, and
            turned by as much in all frames that headings are where bodies face on the average, mirror images by as
            much the other way. A punch sways pelvis and shoulders, and hardly this: where one motion is laid upon
            another, feet stay where they are. Feet of a body that travels pass one another: hips and shoulders say
            where it faces. Shape (P, 3), float64; headings are continuous within a clip.
        contacts: Whether the left and right foot are planted. Shape (P, 2), bool.
        fists: Position of the left and right fist in the frame's own ground frame [m]. Shape (P, 2, 3), float32.
        heads: Centre of the head in the frame's own ground frame [m]. Shape (P, 3), float32.
        necks: Upper end of the torso's capsule, likewise. Shape (P, 3), float32.
        pelvises: Lower end of the torso's capsule, likewise. Shape (P, 3), float32.
        strike_frames: Playback frame at which each strike reaches furthest, ascending. Shape (S,), int32.
        strike_limbs: What strikes, numbers of ``strikers.LIMBS``; left ones are even. Shape (S,), uint8.
        strike_peaks: Playback frame of the limb's highest speed before that. Shape (S,), int32.
        strike_speeds: That speed, relative to the pelvis [m/s]. Shape (S,), float32.
        strike_positions: Position of what strikes at ``strike_frames`` in that frame's ground frame [m].
            Shape (S, 3), float32.
        falls: Falls, staggers and celebrations, control frames, with bearings in the ground frames at their
            starts. There are no strikes in them.
        rests: Spans in which the body stands at ease, guards before and after included, control frames; none where
            they were not searched for. There are no strikes in them either.
    """

    skeleton: Skeleton
    body: Body
    control_rate: float
    playback_rate: float
    clip_names: tuple[str, ...]
    clip_starts: Array
    root_positions: Array
    rotations: Array
    ground: Array
    contacts: Array
    fists: Array
    heads: Array
    necks: Array
    pelvises: Array
    strike_frames: Array
    strike_limbs: Array
    strike_peaks: Array
    strike_speeds: Array
    strike_positions: Array
    falls: FallSpans = field(default_factory=no_falls)
    rests: RestSpans = field(default_factory=no_rests)

    @property
    def stride(self) -> int:
        """Playback frames in a control frame."""
        return round(self.playback_rate / self.control_rate)

    @property
    def frame_count(self) -> int:
        """Number of control frames F."""
        return int(self.clip_starts[-1])

    @property
    def captured_frames(self) -> int:
        """Number of control frames before the mirror images: that of frame f is f + this. F without mirror images."""
        count = len(self.clip_names) // 2
        images = tuple(f"{name}~mirror" for name in self.clip_names[:count])
        return int(self.clip_starts[count]) if count and self.clip_names[count:] == images else self.frame_count

    @property
    def segment_starts(self) -> Array:
        """First control frame of each stretch of clips between falls and rests, and of each of these, and F. Int32."""
        spans = np.concatenate([self.falls.spans, self.rests.frames[:, [0, -1]]])
        if not len(spans):
            return self.clip_starts
        cuts = np.concatenate([self.clip_starts, spans[:, 0], spans[:, 1] + 1])
        return np.unique(cuts).astype(np.int32)

    @property
    def segment_names(self) -> tuple[str, ...]:
        """Names of the clips that ``segment_starts`` leaves whole, and empty ones for parts of others."""
        whole = dict(zip(zip(self.clip_starts[:-1], self.clip_starts[1:], strict=True), self.clip_names, strict=True))
        return tuple(whole.get(ends, "") for ends in itertools.pairwise(self.segment_starts))

    def standing(self, stride: int = 1) -> Any:
        """Return an index of the frames outside falls and rests: all of them, as a slice, where there are none.

        Args:
            stride: Frames in a control frame: 1 for control frames, ``self.stride`` for playback frames.
        """
        if not len(self.falls.spans) and not len(self.rests.frames):
            return slice(None)
        return np.repeat(~self.apart, stride)

    @property
    def apart(self) -> Array:
        """Which control frames behaviours do not choose: those of falls, staggers and rests. Shape (F,), bool."""
        result: Array = self.falls.mask(self.frame_count) | self.rests.mask(self.frame_count)
        return result

    @property
    def beside_falls(self) -> Array:
        """Which control frames are near falls and staggers, from which behaviours choose nothing. Shape (F,), bool."""
        return self.falls.beside(self.clip_starts, self.control_rate)

    @property
    def telling(self) -> Array:
        """Which control frames tell what bodies do: all but walks at ease, which change no fight. Shape (F,), bool."""
        result: Array = ~self.rests.chosen(self.rests.walked).mask(self.frame_count)
        return result

    @property
    def head_heights(self) -> Array:
        """Heights of the head's centre in playback frames outside falls and rests [m]. Float32."""
        result: Array = self.heads[self.standing(self.stride), 1]
        return result

    @property
    def seconds(self) -> float:
        """Length of all clips [s]."""
        return self.frame_count / self.control_rate


def build_database(
    clips: Sequence[MeasuredClip],
    control_rate: float = 15.0,
    playback_rate: float = 60.0,
    mirror: bool = False,
    trim: bool = True,
    calibrate_floor: bool = True,
    progress: Progress | None = None,
    limbs: Sequence[int] = HANDS,
    rests: bool = False,
    props: Sequence[Mapping[str, Any]] = (),
) -> MotionDatabase:
    """Make one database of measured clips.

    Lead-in calibration poses are cut off, every clip's floor goes to zero, clips are resampled to the playback rate and
    cut to whole control frames, contacts and strikes are found.

    Args:
        clips: The clips; all on the skeleton of the first, whose body is taken.
        control_rate: Control frames a second.
        playback_rate: Playback frames a second, a whole multiple of the control rate.
        mirror: Add every clip's mirror image, after the clips themselves.
        trim: Cut off lead-in calibration poses.
        calibrate_floor: Move every clip so that its planted soles are at y = 0.
        progress: Called with ("motion", clips done, clips) as the work goes on.
        limbs: Limbs whose strikes are found, numbers of ``strikers.LIMBS``; in mirror images those of the other side.
        rests: Search for rests.
        props: What hands hold that strikes, see ``Body.props``.

    Raises:
        MotionError: No clips, a clip too short, skeletons that differ, rates that do not divide, or mirror images of a
            skeleton whose rest pose is no pose of a body.
    """
    stride = round(playback_rate / control_rate)
    if stride < 1 or abs(stride * control_rate - playback_rate) > 1e-6 * playback_rate:
        raise MotionError(
            f"playback rate {playback_rate:g} is no whole multiple of the control rate {control_rate:g}; "
            f"expected {control_rate:g}, {2 * control_rate:g}, {3 * control_rate:g} ..."
        )
    if not clips:
        raise MotionError("no clips; expected at least one")
    body = replace(clips[0].body, props=tuple(props))
    found: list[ClipAnalysis] = []

    def add(clip: Clip, calibrate: bool, striking: Sequence[int]) -> None:
        found.append(analyse_clip(clip, body, calibrate, striking))
        if progress is not None:
            progress("motion", len(found), len(clips) * (2 if mirror else 1))

    for measured in clips:
        add(_whole_frames(measured, clips[0].clip, control_rate, playback_rate, trim), calibrate_floor, limbs)
    if mirror:
        for analysis in found[: len(clips)]:
            add(mirrored(analysis.clip, body), False, [mirror_limb(limb) for limb in limbs])
    return _join(found[: len(clips)], found[len(clips) :], control_rate, playback_rate, rests)


def _whole_frames(measured: MeasuredClip, first: Clip, control_rate: float, playback_rate: float, trim: bool) -> Clip:
    """Return a clip on the skeleton of the first one, at the playback rate, cut to whole control frames."""
    clip, stride = measured.clip, round(playback_rate / control_rate)
    difference = first.skeleton.difference(clip.skeleton)
    if difference:
        raise MotionError(f"clip {clip.name!r} has another skeleton than {first.name!r}: {difference}")
    motion = replace(clip, skeleton=first.skeleton).sliced(measured.lead_in if trim else 0, clip.frame_count)
    if motion.frame_count:
        motion = resample(motion, playback_rate)
    whole = motion.frame_count // stride * stride
    if whole < 2 * stride:
        raise MotionError(
            f"clip {clip.name!r} has {clip.frame_count} frames ({clip.seconds:.2f} s), expected "
            f"{2 / control_rate:.2f} s or more after any calibration pose"
        )
    return motion.sliced(0, whole)


def _join(
    clips: list[ClipAnalysis],
    images: list[ClipAnalysis],
    control_rate: float,
    playback_rate: float,
    resting: bool,
) -> MotionDatabase:
    """Return the database of clips and, after them, their mirror images."""
    parts, stride = clips + images, round(playback_rate / control_rate)
    lengths = np.array([part.clip.frame_count for part in parts])
    starts = np.concatenate([[0], np.cumsum(lengths)])
    spans = clip_spans(clips, stride)
    rested = [_rests_of(clip, one, stride) if resting else no_rests() for clip, one in zip(clips, spans, strict=True)]
    masks = [_apart(clip, fell, rest, stride) for clip, fell, rest in zip(clips, spans, rested, strict=True)]
    grounds = clip_grounds(clips, spans, rested, stride) + clip_grounds(images, spans, rested, stride)
    falls = joined_spans(spans, starts // stride, np.concatenate(grounds), stride, bool(images))
    fallen = np.concatenate(masks * (2 if images else 1))

    def local(name: str) -> Array:
        positions = [getattr(part.tracks, name) for part in parts]
        joined = [ground.to_local(g if p.ndim == 2 else g[:, None], p) for g, p in zip(grounds, positions, strict=True)]
        return np.concatenate(joined).astype(np.float32)

    def strikes(name: str, shift: bool = False) -> Array:
        values = [getattr(part.strikes, name) for part in parts]
        if shift:
            values = [value + start for value, start in zip(values, starts[:-1], strict=True)]
        return np.concatenate(values).astype(values[0].dtype)[upright]

    # Arms that flail in a fall do not strike.
    upright = ~fallen[np.concatenate([part.strikes.frames + start for part, start in zip(parts, starts, strict=False)])]
    fists, frames, numbers = local("fists"), strikes("frames", shift=True).astype(np.int32), strikes("limbs")
    return MotionDatabase(
        skeleton=parts[0].clip.skeleton,
        body=parts[0].body,
        control_rate=float(control_rate),
        playback_rate=float(playback_rate),
        clip_names=tuple(part.clip.name for part in parts),
        clip_starts=(starts // stride).astype(np.int32),
        root_positions=np.concatenate([part.clip.root_positions for part in parts]).astype(np.float32),
        rotations=np.concatenate([quaternion.continuous(part.clip.rotations) for part in parts]).astype(np.float32),
        ground=np.concatenate(grounds),
        contacts=np.concatenate([part.contacts for part in parts]),
        fists=fists,
        heads=local("heads"),
        necks=local("necks"),
        pelvises=local("pelvises"),
        strike_frames=frames,
        strike_limbs=numbers,
        strike_peaks=strikes("peaks", shift=True).astype(np.int32),
        strike_speeds=strikes("speeds"),
        strike_positions=np.concatenate([fists, local("feet"), local("others")], axis=1)[frames, numbers],
        falls=falls,
        rests=joined_rests(rested, starts // stride, bool(images)),
    )


def _rests_of(clip: ClipAnalysis, falls: FallSpans, stride: int) -> RestSpans:
    """Return the rests of a clip in control frames."""
    fallen = np.repeat(falls.mask(clip.clip.frame_count // stride), stride)
    found = find_rests(clip.tracks, fallen, clip.body.height, clip.clip.fps)
    return in_control_frames(found, clip.clip.frame_count // stride - 1, stride)


def _apart(clip: ClipAnalysis, falls: FallSpans, rests: RestSpans, stride: int) -> Array:
    """Return which playback frames of a clip lie in falls, staggers and rests. Shape (P,), bool."""
    frames = clip.clip.frame_count // stride
    return np.repeat(falls.mask(frames) | rests.mask(frames), stride)
