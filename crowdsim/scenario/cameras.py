"""The kinds of cameras, a file each in ``crowdsim.render.cameras``, cameras by name, and shots of an edited video."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from importlib import import_module
from operator import or_
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, create_model

from crowdsim.config.files import Finding, StrictModel
from crowdsim.errors import CrowdsimError, TakeError
from crowdsim.scenario.camera import Camera, avatar_number, parse_camera
from crowdsim.scenario.frame_ranges import FrameRange, parse_frames
from crowdsim.scenario.parts import Name

_FIRST = ("auto", "fight", "orbit", "follow", "eye", "top", "side", "front", "fixed", "path")
"""Kinds that come first, in this order, in messages and documents; the others follow by name."""
_TIME = r"\s*\d+(\.\d+)?\s*s\s*"
MOST = 10_000
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
Shots = Annotated[tuple[Shot, ...], Field(max_length=MOST)]


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


def camera_name(chosen: Chosen) -> str:
    """Return what lists of outputs call a camera: the text by which it was chosen, or its kind."""
    return chosen if isinstance(chosen, str) else chosen.kind


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
    joined = [part.strip() for part in chosen.split("+")] if isinstance(chosen, str) and "+" in chosen else []
    for name in joined:
        if name in cameras:
            what = f"joins {name!r}, a camera of the scenario, expected kinds of cameras on both sides of '+'"
            yield Finding((), what)
    for camera in found if names is not None else ():
        for finding in check_avatars(camera, names or ()):
            if isinstance(chosen, str):
                yield Finding((), f"camera {chosen!r}: {finding.message}")
            else:
                yield finding


def shot_findings(shots: Sequence[Any], cameras: Mapping[str, Camera], names: Sequence[str]) -> Iterator[Finding]:
    """Yield what is wrong with shots in a scenario with these cameras and names of avatars."""
    for i, shot in enumerate(shots):
        for finding in shot_faults(shot, cameras, names):
            yield replace(finding, loc=(i, *finding.loc))


def shot_faults(shot: Any, cameras: Mapping[str, Camera], names: Sequence[str] | None) -> Iterator[Finding]:
    """Yield what is wrong with a shot; arguments as of ``choice_findings``."""
    for finding in choice_findings(shot.camera, cameras, names):
        yield replace(finding, loc=("camera", *finding.loc))
    if isinstance(shot.camera, str) and "+" in shot.camera:
        yield Finding(("camera",), f"is {shot.camera!r}, expected one camera")
    try:
        shot.span  # noqa: B018
    except TakeError as error:
        yield Finding((), str(error))
