"""A recipe for a folder of capture in any layout: the shipped one for capture, fitted to how much motion there is."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from crowdsim import assets
from crowdsim.config.files import dump_yaml
from crowdsim.config.tree import scalar
from crowdsim.errors import MotionError, OutputError, RecipeError
from crowdsim.motion.strikers import FEET, HANDS_AND_FEET, LIMBS
from crowdsim.training.no_strikes_report import describe_fists
from crowdsim.training.survey import Survey

TEMPLATE = "boxer_cmu"
"""The shipped recipe whose behaviours are taken."""

BEHAVIOURS = ("approach", "punch", "fight")
WITHOUT_STRIKES = ("approach",)
"""Behaviours that can be learned without strikes; where their targets are wanted is then ``STILL_DISTANCE``."""
STILL_DISTANCE = (0.7, 1.0)
"""Where a target is wanted that no strike is to reach [m]."""

SCARCE, KICKERS = 60.0, 0.8
"""Less motion than this [s], and motion of whose strikes a greater share are kicks, has few ways to strikes."""
EAGER_WEIGHTS = ("80", "7", "0.6", "5", "4")
"""Weights of the rewards of ``fight`` then, in their order. Such ways take long, lead away from where a target is
wanted, or turn the body aside, so that by the weights of the template keeping still would be worth more.
"""

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,63}")


@dataclass(frozen=True)
class Fit:
    """Settings for an amount of motion.

    Attributes:
        seconds: Up to how much motion [s].
        spacing: Least time between decisions [s].
        threshold: Highest cost of a transition [m]; None: the default.
        counts: Points of each axis by behaviour; those of the template where there is none.
    """

    seconds: float
    spacing: float
    threshold: float | None
    counts: dict[str, dict[str, int]]


FITS = (
    Fit(120.0, 0.33, 0.3, {}),
    Fit(300.0, 0.33, None, {}),
    Fit(900.0, 0.55, None, {"punch": {"distance": 36, "bearing": 72, "height": 4}, "fight": {"height": 4}}),
    Fit(
        float("inf"),
        0.66,
        None,
        {"punch": {"distance": 24, "bearing": 36, "height": 3}, "fight": {"distance": 40, "bearing": 36, "height": 3}},
    ),
)
"""Training time and memory grow with decisions and grid points: more motion has fewer of them a second. Little motion
has few transitions, so that dearer ones are allowed.
"""
MIRRORED = 3600.0
"""More motion than this [s] has variety enough without mirror images, if both sides strike."""


def check_name(name: str) -> None:
    """Raise a ``RecipeError`` if a name is none for a recipe, or taken by a recipe or a policy."""
    if not _NAME.fullmatch(name) or not isinstance(scalar(name), str):
        raise RecipeError(
            f"--name {name}: expected at most 64 letters, digits, _ and -, a letter first; not null or true"
        )
    bundle = Path("policies") / name
    if bundle.exists() and name not in assets.policy_names():
        raise RecipeError(f"--name {name}: {bundle} is there already and is no policy; choose another name")
    if name in assets.policy_names():
        try:
            found = assets.find_recipe(name)
        except RecipeError:
            found = assets.find_bundle(name)
        raise RecipeError(
            f"--name {name}: {found} is there already and is not overwritten; "
            f"train it as it is with: crowdsim train {name}; or choose another name"
        )


def write_recipe(name: str, survey: Survey, behaviours: Sequence[str] = BEHAVIOURS) -> Path:
    """Write a recipe for a folder of capture to ``policies/`` in the working folder, and return its path.

    Args:
        name: What the recipe and its policy are called.
        survey: What is in the folder.
        behaviours: Those of ``BEHAVIOURS`` that are to be learned.

    Raises:
        RecipeError: The name is taken, or a behaviour is unknown.
        MotionError: The capture has no strikes, and a behaviour needs them.
        OutputError: The recipe cannot be written.
    """
    check_name(name)
    text = recipe_text(survey, behaviours, Path.cwd() / "policies")
    path = Path("policies") / f"{name}.yaml"
    part = path.with_name(f".{name}.yaml.part")
    try:
        path.parent.mkdir(exist_ok=True)
        try:
            part.write_text(text, encoding="utf-8")
            os.replace(part, path)
        except OSError:
            part.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path


def recipe_text(survey: Survey, behaviours: Sequence[str], place: Path) -> str:
    """Return the text of a recipe for a folder of capture.

    Args:
        survey: What is in the folder.
        behaviours: Those of ``BEHAVIOURS`` that are to be learned.
        place: Folder that the recipe will lie in.
    """
    for behaviour in behaviours:
        if behaviour not in BEHAVIOURS:
            raise RecipeError(f"behaviour {behaviour!r} is unknown, expected some of {', '.join(BEHAVIOURS)}")
    chosen = [behaviour for behaviour in BEHAVIOURS if behaviour in behaviours]
    struck = sum(survey.strikes) > 0
    if not struck and set(chosen) - set(WITHOUT_STRIKES):
        fists = [file.fists for file in survey.used if file.fists is not None]
        raise MotionError(
            f"{survey.folder}: {', '.join(chosen)} need strikes, and {describe_fists(fists)}; "
            f"or train without strikes, by: --behaviours {','.join(WITHOUT_STRIKES)}"
        )
    fit = next(one for one in FITS if survey.seconds <= one.seconds)
    sides = [sum(survey.strikes[side::2]) for side in range(2)]
    mirror = survey.mirrors and (survey.seconds <= MIRRORED or min(sides) < 0.2 * sum(sides))
    settings, blocks = _template()
    settings = re.sub(r"(?<=\n  spacing: )\S+", f"{fit.spacing:g}", settings)
    if fit.threshold is not None:
        settings = settings.replace("graph:\n", f"graph:\n  threshold: {fit.threshold:g}\n", 1)
    if "fight" not in chosen:
        settings = re.sub(r"\nweights:\n  fight: 1", "", settings)
    kicks = sum(survey.strikes[limb] for limb in FEET)
    if "fight" in chosen and (survey.seconds < SCARCE or kicks > KICKERS * sum(survey.strikes)):
        settings, blocks["fight"] = _eager(settings, blocks["fight"])
    learned = [_fitted(blocks[name], fit.counts.get(name, {}), struck) for name in chosen]
    return _head(survey, mirror, place) + settings + "behaviours:\n" + "".join(learned)


def _head(survey: Survey, mirror: bool, place: Path) -> str:
    """Return the first part of a recipe: what it was made from, and the motion."""
    count, struck = len(survey.used), survey.strikes
    names = [limb.replace("_", " ") for limb in LIMBS[: len(HANDS_AND_FEET)]]
    by_limb = ", ".join(f"{amount} {name}" for amount, name in zip(struck, names, strict=True) if amount)
    lines = [
        f"# Written by crowdsim train --mocap from {count} BVH file{'s' * (count > 1)}, {survey.seconds:.0f} s with "
        f"{sum(struck)} strikes{': ' * bool(by_limb)}{by_limb}.",
        "# Change what you like, and train it again with: crowdsim train FILE. docs/recipes.md names every key.",
        "version: 1",
        f"description: Capture of {_scalar(survey.folder.resolve().name)}",
        "motion:",
        "  capture:",
        f"    folder: {_scalar(_seen_from(survey.folder, place))} # --mocap DIR takes precedence",
        "    clips:",
    ]
    for file in survey.used:
        own = sum(file.strikes)
        what = f"{file.seconds:.1f} s, {own} strike{'s' * (own != 1)}" + "; another skeleton" * bool(file.change)
        lines.append(f"      - {_scalar(file.name)} # {what}")
    lines += [f"      # left out: {_comment(f'{file.name}: {file.reason}')}" for file in survey.left_out]
    note = "add the mirror image of every clip" if survey.mirrors else "the skeleton's rest pose cannot be mirrored"
    lines.append(f"  mirror: {str(mirror).lower()} # {note}")
    if sum(struck[limb] for limb in FEET):
        lines += ["strikes:", "  limbs: [hands, feet]"]
    return "\n".join(lines) + "\n"


def _template() -> tuple[str, dict[str, str]]:
    """Return the shipped recipe from its graph on, up to its behaviours, and these by name; comments included."""
    text = assets.shipped("policies", f"{TEMPLATE}.yaml").read_text(encoding="utf-8")
    settings, _, behaviours = text[text.index("graph:\n") :].partition("behaviours:\n")
    parts = re.split(r"(?m)^(?=  #)", behaviours)
    blocks = {match[1]: part for part in parts if (match := re.search(r"(?m)^  (\w+):$", part))}
    return settings, blocks


def _fitted(block: str, counts: dict[str, int], struck: bool) -> str:
    """Return a behaviour with other numbers of grid points, and without strikes with a distance of its own."""
    for axis, count in counts.items():
        block = re.sub(rf"(\n      {axis}:\n(?:        (?!count).*\n)*        count: )\d+", rf"\g<1>{count}", block)
    if not struck:
        near, far = STILL_DISTANCE
        lines = f"      - kind: proximity\\1\n        distance:\n          - {near:g}\n          - {far:g}\n"
        block = re.sub(r"      - kind: proximity(.*)\n", lines, block)
    return block


def _eager(settings: str, fight: str) -> tuple[str, str]:
    """Return the template's settings and its behaviour ``fight`` for motion in which few ways lead to strikes.

    Decisions follow transitions sooner and values are finer, so that strikes can be aimed; a reward counts for longer.
    """
    weights = iter(EAGER_WEIGHTS)
    settings = re.sub(r"(\n  transitions: )\S+", r"\g<1>16\n  landing: 0.07", settings)
    fight = re.sub(r"(?<=\n        weight: )\S+", lambda _: next(weights), fight)
    fight = re.sub(r"(?<=\n        each: )\S+", "1.2", fight)
    fight = fight.replace("\n    finer: 1", "\n    finer: 2")
    return settings, fight.replace("\n    rewards:", "\n    discount: 0.98\n    rewards:")


def _scalar(text: str) -> str:
    """Return a text as a YAML scalar."""
    return dump_yaml([text])[2:].rstrip("\n")


def _comment(text: str) -> str:
    """Return a text on one line, as a comment can hold it."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())


def _seen_from(folder: Path, place: Path) -> str:
    """Return a folder as seen from another where both are in the same project, else its full path."""
    folder, project = folder.resolve(), place.resolve().parent
    if folder.is_relative_to(project):
        return Path(os.path.relpath(folder, place.resolve())).as_posix()
    return str(folder)
