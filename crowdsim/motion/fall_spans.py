"""Falls, staggers and celebrations of all clips of a motion database, and ground transforms in falls.

They are in control frames, mirror images included.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from crowdsim.core.easing import ease
from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.motion.analysis import ClipAnalysis
from crowdsim.motion.falls import FallSpans, no_falls


def clip_spans(clips: Sequence[ClipAnalysis], stride: int) -> list[FallSpans]:
    """Return the spans of each clip in its control frames; none where no clip has a fall.

    Args:
        clips: The clips.
        stride: Playback frames in a control frame.
    """
    if not any(clip.falls.any for clip in clips):
        return [no_falls() for _ in clips]
    return [_in_control_frames(clip.falls, clip.clip.frame_count // stride - 1, stride) for clip in clips]


def _in_control_frames(found: FallSpans, last: int, stride: int) -> FallSpans:
    """Return spans whose ends are control frames up to ``last``, none shorter, of which no two meet."""

    def ends(frames: Array) -> Array:
        return np.minimum(-(-frames // stride), last).astype(np.int32)

    starts, stops = (found.starts // stride).astype(np.int32), ends(found.stops)
    downs, rises = ends(found.downs), (found.rises // stride).astype(np.int32)
    starts[1:] = np.maximum(starts[1:], stops[:-1] + 1)
    good = (starts < downs) & (downs < rises) & (rises < stops)
    staggers = np.stack([found.staggers[:, 0] // stride, ends(found.staggers[:, 1])], axis=1).astype(np.int32)
    staggers[1:, 0] = np.maximum(staggers[1:, 0], staggers[:-1, 1] + 1)
    clear = staggers[:, 0] < staggers[:, 1]
    for start, stop in zip(starts[good], stops[good], strict=True):
        clear &= (staggers[:, 1] < start) | (staggers[:, 0] > stop)
    cheers = np.stack([found.cheers[:, 0] // stride, ends(found.cheers[:, 1])], axis=1).astype(np.int32)
    apart = np.ones(len(cheers), bool)
    for start, stop in [*zip(starts[good], stops[good], strict=True), *staggers[clear]]:
        apart &= (cheers[:, 1] < start) | (cheers[:, 0] > stop)
    return FallSpans(
        starts[good],
        downs[good],
        rises[good],
        stops[good],
        found.directions[good],
        staggers[clear],
        found.stagger_directions[clear],
        cheers[apart],
    )


def settle_ground(stances: Array, pelvises: Array, spans: FallSpans, stride: int) -> Array:
    """Return ground transforms of a clip that follow the pelvis through falls, where feet say nothing.

    They rest while the body lies, so that lying can be repeated in one place.

    Args:
        stances: Ground transforms, playback frames. Shape (P, 3).
        pelvises: Position of the pelvis [m]. Shape (P, 3).
        spans: The clip's falls in control frames.
        stride: Playback frames in a control frame.
    """
    settled = stances.copy()
    ends = (spans.starts, spans.downs, spans.rises, spans.stops)
    for start, down, rise, stop in zip(*(frames.astype(int) * stride for frames in ends), strict=True):
        inside = np.arange(start, stop + 1)
        out, back = ease((inside - start) / (down - start)), ease((inside - rise) / (stop - rise))
        pelvis = pelvises[:, [0, 2]]
        stirred = (pelvis[down] - pelvis[rise]) * (1.0 - back)[:, None]
        lies, rises = ((inside >= first)[:, None] for first in (down, rise))
        path = np.where(rises, pelvis[inside] + stirred, np.where(lies, pelvis[down], pelvis[inside]))
        away = [settled[frame, :2] - pelvis[frame] for frame in (start, stop)]
        settled[inside, :2] = path + (1.0 - out)[:, None] * away[0] + back[:, None] * away[1]
        # What feet that pass one another on the floor add in whole circles is not kept.
        whole = settled[stop, 2] - settled[start, 2]
        turn = float(ground.wrap(whole))
        settled[stop + 1 :, 2] += turn - whole
        settled[inside, 2] = settled[start, 2] + turn * 0.5 * (out + back)
    return settled


def joined_spans(spans: Sequence[FallSpans], starts: Array, grounds: Array, stride: int, mirrored: bool) -> FallSpans:
    """Return the falls of all clips in frames of the database, with bearings in the ground frames at their starts.

    Args:
        spans: Those of each captured clip, in its control frames.
        starts: First control frame of each clip, mirror images included. Shape (C + 1,).
        grounds: Ground transforms of all playback frames. Shape (P, 3).
        stride: Playback frames in a control frame.
        mirrored: Whether mirror images of all clips follow.
    """
    parts = []
    for image in range(1 + mirrored):
        for index, one in enumerate(spans):
            first = np.int32(starts[image * len(spans) + index])
            sign = np.float32(1 - 2 * image)
            headings = (grounds[stride * (frames + first), 2] for frames in (one.starts, one.staggers[:, 0]))
            bearings = [
                ground.wrap(sign * ways - heading).astype(np.float32)
                for ways, heading in zip((one.directions, one.stagger_directions), headings, strict=True)
            ]
            parts.append(
                FallSpans(
                    one.starts + first,
                    one.downs + first,
                    one.rises + first,
                    one.stops + first,
                    bearings[0],
                    one.staggers + first,
                    bearings[1],
                    one.cheers + first,
                )
            )
    return FallSpans(*(np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])))
