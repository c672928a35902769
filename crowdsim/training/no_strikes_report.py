"""The error of motion without strikes, in the figures of ``crowdsim inspect``, with what to do about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from crowdsim.capture.loading import Capture
from crowdsim.errors import MotionError
from crowdsim.motion.strikes import HANDS, describe_strikes_needed
from crowdsim.training.recipe import BehaviourSpec, Recipe

_SHOWN = 3


@dataclass(frozen=True)
class Fists:
    """How fast the fists of a file are, as ``crowdsim inspect`` measures them.

    Attributes:
        name: What the file is called.
        seconds: Its length, lead-in included [s].
        speed: The highest speed of a fist relative to the pelvis [m/s].
        unit: Metres in a file unit.
        height: Standing height of the body [m].
    """

    name: str
    seconds: float
    speed: float
    unit: float
    height: float


def require_no_strikes(recipe: Recipe, captures: Sequence[Capture]) -> None:
    """Raise a ``MotionError`` if behaviours need strikes, of motion that has none: how fast fists are, and what to do.

    ``captures`` are the files of the motion; none of the embedded boxer's.
    """
    needy = {name: spec for name, spec in recipe.behaviours.items() if spec.strikes or spec.measured_by_strikes}
    if not needy:
        return
    names = f"{_join(list(needy))} need{'s' * (len(needy) == 1)} strikes"
    performer = recipe.motion.performer
    if performer is not None:
        raise MotionError(
            f"{names}, and there are none in {performer.seconds:g} s of the embedded boxer; expected more seconds"
        )
    fists = [measure_fists(Path(capture.bvh.path).name, capture) for capture in captures]
    raise MotionError(
        f"{names}, and {describe_fists(fists)}{_kicks_left_out(captures)}; or train without strikes: {_advice(needy)}"
    )


def _kicks_left_out(captures: Sequence[Capture]) -> str:
    """Return in words what to do about kicks of captures; nothing without any."""
    found = [capture.analysis.strikes.limbs for capture in captures if capture.analysis is not None]
    count = sum(int(np.sum(~np.isin(limbs, HANDS))) for limbs in found)
    return f"; or list feet in strikes.limbs, since there are {count} kicks" if count else ""


def measure_fists(name: str, capture: Capture) -> Fists:
    """Return how fast the fists of a capture are; a ``MotionError`` if it has no motion of a body of known size."""
    if capture.analysis is None or capture.unit_scale is None or capture.body is None:
        raise MotionError("no motion of a body")
    seconds, speed = capture.bvh.frame_count / capture.bvh.fps, capture.analysis.strikes.highest_speed
    return Fists(name, seconds, speed, capture.unit_scale, capture.body.height)


def describe_fists(files: Sequence[Fists]) -> str:
    """Return in words that files hold no strikes, how fast their fists are, what a strike is, and what to do first."""
    by_speed = sorted(files, key=lambda one: -one.speed)
    fastest = by_speed[0]
    some = ", ".join(f"{one.speed:.1f} m/s in {one.name} ({one.seconds:.2f} s)" for one in by_speed[:_SHOWN])
    count = "1 file" if len(files) == 1 else f"{len(files)} files"
    return (
        f"there are none in {count} of {sum(one.seconds for one in files):.2f} s\n"
        f"  fastest fists: {some}; {describe_strikes_needed(fastest.height)}\n"
        f"  what to do: check the unit (found to be {fastest.unit:g} m, which makes the body {fastest.height:.2f} m "
        "tall); add clips with strikes"
    )


def _advice(needy: dict[str, BehaviourSpec]) -> str:
    """Return in words which behaviours to leave out, and which to give a distance."""
    strike = [name for name, spec in needy.items() if spec.strikes]
    parts = [f"leave {_join(strike)} out of the recipe"] if strike else []
    for name, spec in needy.items():
        if name not in strike:
            parts.append(f"give {name} {_join(spec.measured_by_strikes)}")
    return "; ".join(parts)


def _join(names: list[str]) -> str:
    return " and ".join(part for part in (", ".join(names[:-1]), names[-1]) if part)
