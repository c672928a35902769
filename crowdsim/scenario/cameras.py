"""The kinds of cameras, a file each in ``crowdsim.render.cameras``, cameras by name, and shots of an edited video."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from importlib import import_module
from operator import or_
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, create_model, model_validator

from crowdsim.config.files import Faults, Finding, StrictModel, load_model
from crowdsim.errors import CrowdsimError, TakeError, nearest
from crowdsim.scenario.camera import Camera, avatar_number, parse_camera
from crowdsim.scenario.frame_ranges import FrameRange, parse_frames
from crowdsim.scenario.parts import Name

_FIRST = ("auto", "fight", "orbit", "follow", "eye", "top", "side", "front", "fixed", "path")
"""Kinds that come first, in this order, in messages and documents; the others follow by name."""
_TIME = r"\s*\d+(\.\d+)?\s*s\s*"
_MOST = 10_000
"""How many cameras and shots there may be."""


def _find_kinds() -> dict[str, type[Camera]]:
    """Return the kinds of cameras by name. They lie above this package, which knows nothing else of them."""
    package = import_module("crowdsim.render.cameras")
    names = [module.name for module in iter_modules(package.__path__)]
    names.sort(key=lambda name: (_FIRST.index(name) if name in _FIRST else len(_FIRST), name))
    return {name: import_module(f"{package.__name__}.{name}").CAMERA for name in names}


KINDS = _find_kinds()
"""The registry: every kind of camera by its name."""

if TYPE_CHECKING:
    AnyCamera = Camera
else:
    AnyCamera = Annotated[reduce(or_, KINDS.values()), Field(discriminator="kind")]
Cameras = dict[Name, AnyCamera]
Chosen = str | AnyCamera
"""A camera: its keys, or text, see ``chosen_cameras``."""
Time = Annotated[int, Field(ge=0, le=10**12)] | Annotated[str, Field(pattern=f"^{_TIME}$", examples=["4s"])]


class _Shot(StrictModel):
    """A part of an edited video: what one camera sees from one time to another."""

    if TYPE_CHECKING:

        def __init__(self, **keys: Any) -> None: ...

    camera: Chosen = Field(description="The name of a camera or of a kind, or the keys of a camera.")

    @property
    def span(self) -> FrameRange:
        """The frames of the take that it shows."""
        start, stop = getattr(self, "from"), self.to
        return parse_frames(f"{start}:{'' if stop is None else stop}")

    to: Time | None = Field(
        default=None, description="End: an output frame, or a time such as `8s`; the run's if not given."
    )


if TYPE_CHECKING:

    class Shot(_Shot):
        """See ``_Shot``."""

else:
    # A word of Python cannot be written as a field.
    Shot = create_model(
        "Shot",
        __base__=_Shot,
        __module__=__name__,
        __doc__=_Shot.__doc__,
        **{"from": (Time, Field(default=0, description="Begin: an output frame, or a time such as `4s`."))},
    )
Shots = Annotated[tuple[Shot, ...], Field(max_length=_MOST)]


class CameraFile(StrictModel):
    """A file of cameras, and of shots that they take."""

    cameras: Cameras = Field(default_factory=dict, max_length=_MOST, description="Cameras by name.")
    shots: Shots = Field(default=(), description="Shots of an edited video, in their order.")

    @model_validator(mode="after")
    def _check(self) -> CameraFile:
        findings = [
            Finding(("shots", i, *finding.loc), finding.message)
            for i, shot in enumerate(self.shots)
            for finding in _shot_findings(shot, self.cameras, None)
        ]
        if findings:
            raise Faults(findings)
        return self


def chosen_cameras(chosen: Chosen, cameras: Mapping[str, Camera] | None = None) -> tuple[Camera, ...]:
    """Return the cameras that are chosen; of several, joined by '+', the pictures are drawn side by side.

    Args:
        chosen: A camera; or a kind such as 'orbit', with an avatar as in 'follow:3' and 'eye:red_007'; or the name of
            a camera.
        cameras: Cameras that have a name.

    Raises:
        CrowdsimError: There is no such camera.
    """
    return parse_camera(chosen, KINDS, cameras) if isinstance(chosen, str) else (chosen,)


def check_avatars(camera: Camera, names: Sequence[str]) -> Iterator[Finding]:
    """Yield a finding for each avatar that a camera names and that there is not."""
    for loc, avatar in camera.avatars_named():
        try:
            avatar_number(avatar, names)
        except CrowdsimError as error:
            yield Finding(loc, str(error))


def choice_findings(chosen: Chosen, cameras: Mapping[str, Camera], names: Sequence[str] | None) -> Iterator[Finding]:
    """Yield what is wrong with a choice of a camera.

    Args:
        chosen: The choice.
        cameras: Cameras by name.
        names: Names of the avatars; None where they are not known yet.
    """
    try:
        found = chosen_cameras(chosen, cameras)
    except CrowdsimError as error:
        yield Finding((), str(error))
        return
    for camera in found if names is not None else ():
        for finding in check_avatars(camera, names or ()):
            if isinstance(chosen, str):
                yield Finding((), f"camera {chosen!r}: {finding.message}")
            else:
                yield finding


def load_cameras(path: Path) -> CameraFile:
    """Return the cameras and shots of a file, which may be a scenario.

    Raises:
        CrowdsimError: The file cannot be read or is invalid.
    """
    text = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    if re.search(r"^groups\s*:", text, re.MULTILINE):
        from crowdsim.scenario.scenario import load_scenario

        scenario = load_scenario(path)
        render = scenario.outputs.render
        return CameraFile(cameras=scenario.cameras, shots=() if render is None else render.shots)
    return load_model(path, CameraFile, CrowdsimError)


def read_shots(path: Path) -> tuple[Any, ...]:
    """Return the shots of a file, which may be a scenario, with the keys of their cameras.

    Raises:
        CrowdsimError: The file cannot be read, is invalid, or has no shots.
    """
    file = load_cameras(path)
    if not file.shots:
        raise CrowdsimError(f"{path}: has no shots, expected a list 'shots' of mappings with camera, from and to")
    return tuple(
        shot.model_copy(update={"camera": file.cameras.get(shot.camera, shot.camera)})
        if isinstance(shot.camera, str)
        else shot
        for shot in file.shots
    )


def camera_in_file(text: str) -> Camera | None:
    """Return the camera that ``FILE.yaml#name`` means; None where the text is no such thing.

    Raises:
        CrowdsimError: The file is invalid, or has no such camera.
    """
    match = re.fullmatch(r"(.+\.ya?ml)(?:#(.*))?", text, re.IGNORECASE)
    if match is None:
        return None
    cameras = load_cameras(Path(match[1])).cameras
    name = match[2] if match[2] else next(iter(cameras), "") if len(cameras) == 1 else ""
    if name not in cameras:
        known = f"expected {match[1]}#NAME with one of {', '.join(cameras)}" if cameras else "the file has no cameras"
        raise CrowdsimError(f"camera {text!r} is unknown, {known}{nearest(name, cameras)}")
    return cameras[name]


def shot_findings(shots: Sequence[Any], cameras: Mapping[str, Camera], names: Sequence[str]) -> Iterator[Finding]:
    """Yield what is wrong with shots in a scenario with these cameras and names of avatars."""
    for i, shot in enumerate(shots):
        for finding in _shot_findings(shot, cameras, names):
            yield replace(finding, loc=(i, *finding.loc))


def _shot_findings(shot: Any, cameras: Mapping[str, Camera], names: Sequence[str] | None) -> Iterator[Finding]:
    for finding in choice_findings(shot.camera, cameras, names):
        yield replace(finding, loc=("camera", *finding.loc))
    if isinstance(shot.camera, str) and "+" in shot.camera:
        yield Finding(("camera",), f"is {shot.camera!r}, expected one camera")
    try:
        shot.span  # noqa: B018
    except TakeError as error:
        yield Finding((), str(error))
