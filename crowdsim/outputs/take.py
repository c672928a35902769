"""The take, see ``take.store``."""

from __future__ import annotations

from pydantic import Field

from crowdsim.scenario.output import Output

_CHUNK = (
    "Control frames in a chunk of the take, at most as many as are 4 million avatar-frames; without it as many as are "
    "about 1 MiB of each variable."
)


class TakeOutput(Output):
    """The take, which every run writes."""

    name = "take"
    about = "The take, which every run writes."
    always = True
    from_take = False

    chunk: int | None = Field(default=None, ge=1, le=65536, description=_CHUNK)


OUTPUT = TakeOutput
