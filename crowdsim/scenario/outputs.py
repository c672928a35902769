"""The key ``outputs`` of a scenario, with a key for each file in ``crowdsim.outputs``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any

from pydantic import Field, create_model

from crowdsim.config.files import Finding, StrictModel
from crowdsim.scenario.camera import Camera
from crowdsim.scenario.output import Output

_FIRST = ("take", "bvh", "ply", "pcd", "render", "profile")
"""Outputs that come first, in this order, in files, messages and documents; the others follow by name."""


def _find_outputs() -> dict[str, type[Output]]:
    """Return the outputs that there are, by name. They lie above this package, which knows nothing else of them."""
    package = import_module("crowdsim.outputs")
    names = [module.name for module in iter_modules(package.__path__)]
    names.sort(key=lambda name: (_FIRST.index(name) if name in _FIRST else len(_FIRST), name))
    found: list[type[Output]] = [import_module(f"{package.__name__}.{name}").OUTPUT for name in names]
    return {output.name: output for output in found}


REGISTRY = _find_outputs()
"""The registry: every output by its name."""


class _Outputs(StrictModel):
    """What a run writes; an output that is not named is not written, but the take always is."""

    if TYPE_CHECKING:

        def __init__(self, **outputs: Output | None) -> None: ...

        def __getattr__(self, name: str) -> Any: ...

    def wanted(self) -> list[Output]:
        """Return those that are to be written."""
        return [output for name in REGISTRY if (output := getattr(self, name)) is not None]

    def only(self, from_take: bool) -> Outputs:
        """Return these without those that are, or are not, written from a finished take."""
        return Outputs(**{one.name: one for one in self.wanted() if one.from_take == from_take})

    def resolved(self, fps: float) -> Outputs:
        """Return these with all that they leave to a scenario, which has ``fps`` frames a second."""
        update = {output.name: output.resolved(fps) for output in self.wanted()}
        return self.model_copy(update=update)  # type: ignore[return-value]

    def named(self, members: Callable[[str], Sequence[int] | None], cameras: Mapping[str, Camera]) -> Outputs:
        """Return these with what names in them stand for, see ``Output.named``."""
        update = {output.name: output.named(members, cameras) for output in self.wanted()}
        return self.model_copy(update=update)  # type: ignore[return-value]

    def findings(self, avatars: int) -> Iterator[Finding]:
        """Yield what is wrong with them for a number of avatars, as keys of the scenario."""
        for output in self.wanted():
            for finding in output.findings(avatars):
                yield output.place(finding)


if TYPE_CHECKING:

    class Outputs(_Outputs):
        """See ``_Outputs``."""

else:
    Outputs = create_model(
        "Outputs",
        __base__=_Outputs,
        __module__=__name__,
        **{
            name: (
                (output, Field(default_factory=output, description=output.about))
                if output.always
                else (output | None, Field(default=None, description=output.about))
            )
            for name, output in REGISTRY.items()
        },
    )
    Outputs.__doc__ = _Outputs.__doc__
