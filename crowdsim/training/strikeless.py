"""What is said of motion without strikes, in the figures of ``crowdsim inspect``, and what to do about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from crowdsim.capture.loading import load_capture
from crowdsim.capture.report import describe_capture, study_capture
from crowdsim.errors import MotionError
from crowdsim.motion.strikes import describe_strikes_needed
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


def require_no_strikes(recipe: Recipe, files: Sequence[Path]) -> None:
    """Refuse to train on motion without strikes where behaviours need them.

    Args:
        recipe: What is trained.
        files: The BVH files of its motion; none of the embedded boxer's.

    Raises:
        MotionError: A behaviour needs strikes: how fast the fists are, and what can be done.
    """
    needy = {name: spec for name, spec in recipe.behaviours.items() if spec.strikes or spec.measured_by_strikes}
    if not needy:
        return
    names = f"{_join(list(needy))} need{'s' * (len(needy) == 1)} strikes"
    performer, capture = recipe.motion.performer, recipe.motion.capture
    if performer is not None:
        raise MotionError(
            f"{names}, and there are none in {performer.seconds:g} s of the embedded boxer; expected more seconds"
        )
    assert capture is not None
    fists = [measure_fists(path, capture.unit, capture.up_axis) for path in files]
    raise MotionError(f"{names}, and {describe_fists(fists)}; or train without strikes: {_advice(needy)}")


def measure_fists(path: Path, unit: str | float | None = None, up_axis: str | None = None) -> Fists:
    """Return how fast the fists of a file that can be trained on are."""
    capture = load_capture(path, unit, up_axis)
    figures = describe_capture(capture, study_capture(capture))
    return Fists(
        path.name, figures["seconds"], figures["highest_fist_speed"], figures["unit_scale"], figures["height_m"]
    )


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
