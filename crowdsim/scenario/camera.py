"""What all kinds of cameras have in common; each kind is a class in a file of ``crowdsim.render.cameras``."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar

from pydantic import Field, ValidationError, model_validator

from crowdsim.config.files import Fault, StrictModel
from crowdsim.errors import CrowdsimError, nearest
from crowdsim.scenario.parts import Metres, Name

FIELD = 36.0
"""Angle between the upper and lower edge of a picture whose camera names no lens [degrees]."""
AvatarRef = Annotated[int, Field(ge=0)] | Name
"""An avatar by its number or its name."""
_MOST = 40
"""How many cameras a message lists."""
Position = tuple[Metres, Metres, Metres]


class Lens(StrictModel):
    """How wide a camera sees: a field of view, or a focal length on a sensor; and what of it is sharp."""

    field_of_view: float | None = Field(
        default=None, ge=1, le=150, description="Angle between the upper and lower edge of the picture [degrees]."
    )
    focal_length: float | None = Field(default=None, ge=1, le=5000, description="Focal length [mm].")
    sensor: float = Field(
        default=24.0, ge=1, le=200, description="Height of the sensor that the focal length is on [mm]."
    )
    f_number: float | None = Field(
        default=None,
        ge=0.5,
        le=64,
        description="Focal length over the diameter of the aperture: the less it is, the more is blurred that is out "
        "of focus; everything is sharp without it. Beside field_of_view the sensor is 24 mm high.",
    )
    focus: float | None = Field(
        default=None,
        ge=0.1,
        le=10000,
        description="Distance at which the picture is sharp [m]; that of what the camera looks at without it.",
    )

    @model_validator(mode="after")
    def _check(self) -> Lens:
        if (self.field_of_view is None) == (self.focal_length is None):
            raise Fault("expected either field_of_view or focal_length")
        if self.focal_length is None and "sensor" in self.model_fields_set:
            raise Fault("is given beside field_of_view, expected it beside focal_length only", "sensor")
        if self.focus is not None and self.f_number is None:
            raise Fault("is given without f_number: everything is sharp", "focus")
        if not 1.0 <= math.degrees(self.field) <= 150.0:
            raise Fault(f"sees {math.degrees(self.field):.3g} degrees, expected 1 to 150", "focal_length")
        return self

    @property
    def field(self) -> float:
        """Angle between the upper and lower edge of the picture [rad]."""
        if self.field_of_view is not None:
            return math.radians(self.field_of_view)
        assert self.focal_length is not None
        return 2.0 * math.atan(0.5 * self.sensor / self.focal_length)

    @property
    def aperture(self) -> float:
        """Radius of the opening of the lens [m]; 0 where everything is sharp."""
        return 0.0 if self.f_number is None else 0.5e-3 * self.sensor / math.tan(0.5 * self.field) / self.f_number / 2.0


class Camera(StrictModel):
    """A camera of some kind; its fields are the keys that a scenario has for it.

    Attributes:
        follows: The key that ``KIND:AVATAR`` gives, ``avatar`` or ``avatars``, for kinds that have one.
        sees_through: Whether its pictures leave out obstacles that hide avatars, since nobody has placed it by hand.
    """

    follows: ClassVar[str] = ""
    sees_through: ClassVar[bool] = True

    kind: str
    lens: Lens | None = Field(
        default=None, description=f"How wide it sees; {FIELD:g} degrees from the upper to the lower edge without it."
    )

    @property
    def field(self) -> float:
        """Angle between the upper and lower edge of the picture [rad]."""
        return math.radians(FIELD) if self.lens is None else self.lens.field

    @abstractmethod
    def plan(self, footage: Any) -> Callable[[float], Any]:
        """Return the view at each frame, frames between them too.

        Args:
            footage: What is filmed, a ``render.camera.Footage``. The plan is made from all of it, so that any range of
                frames shows what the whole shows.
        """

    def avatars_named(self) -> Iterator[tuple[tuple[str | int, ...], int | str]]:
        """Yield the key of each avatar that the camera names, and its number or name."""
        yield from ()

    def numbered(self, names: Sequence[str]) -> Camera:
        """Return it with numbers of avatars instead of names, so that equal cameras are equal however they are named.

        Raises:
            CrowdsimError: There is no such avatar.
        """
        update: dict[str, Any] = {}
        for (key, *index), avatar in self.avatars_named():
            number = avatar_number(avatar, names)
            update[str(key)] = (*update.get(str(key), ()), number) if index else number
        return self.model_copy(update=update)


def avatar_number(avatar: int | str, names: Sequence[str]) -> int:
    """Return the number of an avatar that is given by number or name; the name of a group of one will do.

    Raises:
        CrowdsimError: There is none; the message names the nearest.
    """
    if isinstance(avatar, str) and avatar in names:
        return list(names).index(avatar)
    if isinstance(avatar, str) and avatar.isdecimal():
        avatar = int(avatar)
    if isinstance(avatar, int) and 0 <= avatar < len(names):
        return avatar
    members = [number for number, name in enumerate(names) if name.rpartition("_")[0] == avatar]
    if len(members) == 1:
        return members[0]
    known = f"expected a number from 0 to {len(names) - 1}" + (
        f" or a name such as {names[0]!r}{nearest(str(avatar), names)}" if names else ""
    )
    raise CrowdsimError(f"no avatar {avatar!r}, {known}")


def parse_camera(
    text: str, kinds: Mapping[str, type[Camera]], cameras: Mapping[str, Camera] | None = None
) -> tuple[Camera, ...]:
    """Return the cameras that a text names; several joined by '+' are drawn side by side.

    Args:
        text: A kind such as 'orbit', with an avatar as in 'follow:3' and 'eye:red_007', or the name of a camera;
            'front+side' is two.
        kinds: Every kind of camera by its name.
        cameras: Cameras that have a name.

    Raises:
        CrowdsimError: There is no such camera.
    """
    named, found = cameras or {}, []
    for part in text.split("+"):
        name, colon, avatar = part.strip().partition(":")
        if not colon and name in named:
            found.append(named[name])
            continue
        kind = kinds.get(name)
        needed = [] if kind is None else required_keys(kind)
        if kind is None or needed or (colon and not (kind.follows and avatar)):
            choices = [*named, *_plain_names(kinds)]
            hint = f" ({name} needs keys: {', '.join(needed)})" if needed else nearest(name, choices)
            raise CrowdsimError(f"camera {part[:100]!r} is unknown, expected one of {', '.join(choices[:_MOST])}{hint}")
        keys: dict[str, Any] = {"kind": name}
        if colon:
            given = tuple(int(one) if one.isdecimal() else one for one in avatar.split(","))
            keys[kind.follows] = given if kind.follows == "avatars" else given[0] if len(given) == 1 else avatar
        try:
            found.append(kind.model_validate(keys))
        except ValidationError as error:
            reason = error.errors()[0]
            raise CrowdsimError(f"camera {part[:100]!r}: {reason['msg'].removeprefix('Value error, ')}") from None
    return tuple(found)


def required_keys(kind: type[Camera]) -> list[str]:
    """Return the keys without which a kind of camera cannot be had."""
    return [name for name, field in kind.model_fields.items() if field.is_required() and name != "kind"]


def _plain_names(kinds: Mapping[str, type[Camera]]) -> list[str]:
    """Return what the kinds of cameras that need no keys are called on the command line."""
    names: list[str] = []
    for name, kind in kinds.items():
        if not required_keys(kind):
            names += [name, *([f"{name}:AVATAR"] if kind.follows else [])]
    return names
