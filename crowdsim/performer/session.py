"""The embedded boxer: unlabelled clips like those of a capture session, and the ground truth that tests need.

Motion capture cannot ship with the package, so this module performs: a deterministic, parametric boxer, drawn from a
seed. ``perform`` gives clips with their ground truth, ``write_performance`` writes the clips alone as BVH files.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from crowdsim.core.types import Progress
from crowdsim.errors import nearest
from crowdsim.motion.skeleton import Clip
from crowdsim.performer.cheers import CHEERS, write_cheer
from crowdsim.performer.choreographer import Choreographer
from crowdsim.performer.falls import FALLS, STAGGERS, write_fall, write_stagger
from crowdsim.performer.moves import DEFENCES, PUNCHES
from crowdsim.performer.phrases import THEMES, write_score
from crowdsim.performer.player import play_score
from crowdsim.performer.rests import RESTS, write_rest
from crowdsim.performer.score import Score
from crowdsim.performer.skeleton import build_skeleton, mirror_joints
from crowdsim.performer.solo import FOOTWORK, write_solo
from crowdsim.performer.sticks import GRIPS
from crowdsim.performer.truth import Truth, find_truth, mirror_truth

CLIP_SECONDS = 30.0
"""About how long one clip is."""
STANCES = ("orthodox", "southpaw")
MOVES = (*PUNCHES, *DEFENCES, *FOOTWORK, *FALLS, *STAGGERS, *CHEERS, *RESTS)
"""What can be performed alone."""


@dataclass(frozen=True)
class Performance:
    """A clip and what truly happens in it.

    Attributes:
        clip: The motion, as capture would give it.
        truth: Contacts, strikes and defences; for tests only, training never sees it.
    """

    clip: Clip
    truth: Truth


def clip_lengths(seconds: float, fps: float, rng: np.random.Generator) -> list[int]:
    """Split a session into clips of different lengths; return their frames, which add up to the whole session."""
    total = max(round(seconds * fps), 2)
    count = max(1, round(seconds / CLIP_SECONDS))
    shares = rng.uniform(0.7, 1.3, count)
    bounds = np.rint(np.cumsum(shares) / np.sum(shares) * total).astype(int)
    return [int(n) for n in np.diff(bounds, prepend=0)]


def perform(
    seconds: float,
    seed: int,
    fps: float = 60.0,
    stance: str = "orthodox",
    progress: Progress | None = None,
    falls: int = 0,
    rests: int = 0,
    stick: str | None = None,
) -> list[Performance]:
    """Perform a session of boxing: several clips, each from guard to guard.

    Args:
        seconds: Length of all clips together but those of falls and rests [s].
        seed: The same seed gives the same bytes.
        fps: Frames a second.
        stance: "orthodox" (left side leads) or "southpaw", its mirror image.
        progress: Called with ("perform", clips done, clips).
        falls: How often each kind of fall, stagger and celebration is performed, in clips of their own.
        rests: How often each kind of rest is performed, likewise.
        stick: How a stick is held that the blows are struck with, a key of ``sticks.GRIPS``; none when None.

    Raises:
        ValueError: A length or rate is not positive, or the stance or the grip is unknown.
    """
    if not (seconds > 0.0 and fps > 0.0):
        raise ValueError(f"seconds {seconds} and fps {fps}; expected both above 0")
    root = np.random.SeedSequence(seed)
    lengths = clip_lengths(seconds, fps, np.random.default_rng(root.spawn(1)[0]))
    performances = []
    for index, (frames, sequence) in enumerate(zip(lengths, root.spawn(len(lengths)), strict=True)):
        write = partial(write_score, seconds=frames / fps, theme=THEMES[index % len(THEMES)])
        performances.append(_perform(f"performer_{index:02d}", write, sequence, fps, stance, stick=stick))
        if progress is not None:
            progress("perform", index + 1, len(lengths))
    performances += _perform_each((*FALLS, *STAGGERS, *CHEERS), falls, _FALLS_STREAM, seed, fps, stance, stick)
    return performances + _perform_each(RESTS, rests, _RESTS_STREAM, seed, fps, stance, stick)


_FALLS_STREAM, _RESTS_STREAM = 1 << 20, 1 << 21
"""Which streams of a seed falls and rests are drawn from: not those of a session's clips."""


def _perform_each(
    kinds: Sequence[str], count: int, stream: int, seed: int, fps: float, stance: str, stick: str | None
) -> list[Performance]:
    """Perform each of some kinds of falls, staggers, celebrations or rests so many times."""
    performances = []
    for index, kind in enumerate(kinds):
        for take in range(count):
            name = f"performer_fall_{kind}_{take:02d}" if kind in FALLS else f"performer_{kind}_{take:02d}"
            sequence = np.random.SeedSequence(seed, spawn_key=(stream, index, take))
            performances.append(
                _perform(name, partial(_write_move, move=kind, amid=True), sequence, fps, stance, stick=stick)
            )
    return performances


def _write_move(plan: Choreographer, move: str, amid: bool) -> Score:
    """Return the score of one move: between two guards, or of a fall, stagger or rest amid other moves."""
    if move in FALLS:
        return write_fall(plan, move, amid)
    if move in STAGGERS:
        return write_stagger(plan, move, amid)
    if move in CHEERS:
        return write_cheer(plan, move)
    return write_rest(plan, move, amid) if move in RESTS else write_solo(plan, move)


def perform_solo(
    move: str, seed: int = 1, fps: float = 60.0, stance: str = "orthodox", stick: str | None = None
) -> Performance:
    """Perform one move alone, out of the guard and back, facing heading 0.

    Args:
        move: A word of ``MOVES``, or one of the blows of the stick.
        seed: The same seed gives the same bytes.
        fps: Frames a second.
        stance: "orthodox" or "southpaw".
        stick: How a stick is held, see ``perform``.

    Raises:
        ValueError: The move, the stance or the grip is unknown.
    """
    grip = GRIPS.get(stick or "")
    moves = MOVES if grip is None else (*grip.blows, *MOVES[len(PUNCHES) :])
    if move not in moves:
        raise ValueError(f"unknown move {move!r}; expected one of {', '.join(moves)}{nearest(move, moves)}")
    write = partial(_write_move, move=move, amid=False)
    return _perform(move, write, np.random.SeedSequence(seed), fps, stance, facing=0.0, stick=stick)


def _perform(
    name: str,
    write: Callable[[Choreographer], Score],
    seeds: np.random.SeedSequence,
    fps: float,
    stance: str,
    facing: float | None = None,
    stick: str | None = None,
) -> Performance:
    if stance not in STANCES:
        raise ValueError(f"unknown stance {stance!r}; expected one of {', '.join(STANCES)}")
    plan, idle = (np.random.default_rng(child) for child in seeds.spawn(2))
    if stick is not None and stick not in GRIPS:
        raise ValueError(f"unknown grip {stick!r}; expected one of {', '.join(GRIPS)}")
    grip = None if stick is None else GRIPS[stick]
    score, skeleton = write(Choreographer(plan, facing, grip)), build_skeleton()
    times = np.arange(round(score.seconds * fps)) / fps
    played = play_score(score, skeleton, times, idle)
    clip = Clip(name, skeleton, fps, played.root_positions, played.rotations)
    truth = find_truth(score, played, times)
    if stance == "southpaw":
        return Performance(mirror_performed(clip), mirror_truth(truth))
    return Performance(clip, truth)


def mirror_performed(clip: Clip) -> Clip:
    """Return the boxer's mirror image in the plane x = 0: an orthodox one becomes a southpaw."""
    order = mirror_joints()
    return replace(
        clip,
        root_positions=clip.root_positions * np.array([-1.0, 1.0, 1.0]),
        rotations=clip.rotations[:, order] * np.array([1.0, 1.0, -1.0, -1.0]),
    )


def write_performance(
    folder: str | Path,
    seconds: float,
    seed: int,
    fps: float = 60.0,
    stance: str = "orthodox",
    progress: Progress | None = None,
    falls: int = 0,
    rests: int = 0,
) -> list[Path]:
    """Perform a session and write its clips to ``performer_00.bvh`` and so on; return the files.

    Falls, staggers and rests go to ``performer_fall_forward_00.bvh`` and so on. The folder is made when it is missing.
    Ground truth is not written.
    """
    from crowdsim.bvh.io import write_bvh

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for performance in perform(seconds, seed, fps, stance, progress, falls, rests):
        path = folder / f"{performance.clip.name}.bvh"
        write_bvh(path, performance.clip)
        paths.append(path)
    return paths
