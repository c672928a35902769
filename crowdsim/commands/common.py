"""What several commands share: options and printing.

Results go to standard output; progress, notes and findings go to standard error.
"""

from __future__ import annotations

import functools
import inspect
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from crowdsim.commands.process import check_process

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document and nothing else.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, notes or summary; findings and errors alone.")]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Say more of what is done and found, and where an error comes from.")
]
Threads = Annotated[
    int, typer.Option("--threads", metavar="N", min=1, max=1024, help="Threads; results never depend on them.")
]
Frames = Annotated[
    str | None,
    typer.Option(metavar="A:B", help="Output frames, half-open, or seconds as in 2s:5s; all by default."),
]


def _read_fps(value: str | float) -> float:
    from crowdsim.scenario.rates import parse_rate

    return parse_rate(value)


def fps_option(about: str) -> Any:
    """Return an option that takes frames a second, as a number or as a fraction."""
    return typer.Option(metavar="FPS", parser=_read_fps, help=f"{about}; fractions such as 24000/1001 are exact.")


Port = Annotated[int | None, typer.Option(metavar="N", min=1, max=65535, help="Port; a free one by default.")]
Host = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Address to listen at; 127.0.0.1, this machine, by default.")
]
NoOpen = Annotated[bool, typer.Option("--no-open", help="Do not open the browser.")]
Force = Annotated[bool, typer.Option("--force", help="Do it again although it is done.")]
Device = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="Where control runs: cpu, cuda, or auto for a GPU where a crowd is large; results never depend on it.",
    ),
]
Search = Annotated[
    str | None,
    typer.Option(
        metavar="NAME", help="How nearest opponents are found: auto, kd_tree or scipy; results never depend on it."
    ),
]
Mocap = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="Folder of motion capture, for recipes that train from it; the recipe's, else that of CROWDSIM_MOCAP.",
    ),
]


@dataclass
class Talk:
    """How much the command that runs has to say.

    Attributes:
        quiet: No progress, notes or summary.
        verbose: Details, too.
    """

    quiet: bool = False
    verbose: bool = False


talk = Talk()


def with_talk(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that also has the options ``--quiet`` and ``--verbose``."""

    @functools.wraps(command)
    def run(*values: Any, quiet: bool, verbose: bool, **named: Any) -> None:
        talk.quiet, talk.verbose = quiet, verbose
        check_process()
        command(*values, **named)

    return add_options(run, command, {"quiet": (Quiet, False), "verbose": (Verbose, False)})


def add_options(
    run: Callable[..., None],
    command: Callable[..., None],
    options: Mapping[str, tuple[Any, Any]],
    at: int | None = None,
) -> Callable[..., None]:
    """Give a wrapper of a command its options and more, each with annotation and default; return it.

    Args:
        run: The wrapper, which is called with all options by name.
        command: The command.
        options: The others, by name.
        at: How many of its own come before these; all when None.
    """
    own = [
        one.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        for one in inspect.signature(command, eval_str=True).parameters.values()
        if one.kind is not inspect.Parameter.VAR_KEYWORD
    ]
    at = len(own) if at is None else at
    more = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
        for name, (annotation, default) in options.items()
    ]
    parameters = [*own[:at], *more, *own[at:]]
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {one.name: one.annotation for one in parameters}
    return run


def say(text: str) -> None:
    """Print a line of a summary."""
    if not talk.quiet:
        print(text)


def note(text: str) -> None:
    """Print what a user should know on standard error."""
    if not talk.quiet:
        print(text, file=sys.stderr, flush=True)


def detail(text: str) -> None:
    """Print on standard error what only ``--verbose`` asks for."""
    if talk.verbose:
        print(text, file=sys.stderr, flush=True)


def complete_scenario(incomplete: str) -> list[str]:
    """Return the names of scenarios that begin like this, for shells."""
    from crowdsim.assets import scenario_names

    return [name for name in scenario_names() if name.startswith(incomplete)]


def complete_recipe(incomplete: str) -> list[str]:
    """Return the names of recipes that begin like this, for shells."""
    from crowdsim.assets import recipe_names

    return [name for name in recipe_names() if name.startswith(incomplete)]


def complete_either(incomplete: str) -> list[str]:
    """Return the names of scenarios and recipes that begin like this, for shells."""
    return [*complete_scenario(incomplete), *complete_recipe(incomplete)]


def print_json(document: Any) -> None:
    """Print plain data as one JSON document."""
    print(json.dumps(document, indent=2, allow_nan=False))


def size_text(count: float) -> str:
    """Return a number of bytes in the unit that suits it."""
    for unit in ("bytes", "kB", "MB"):
        if count < 1000:
            return f"{count:.0f} {unit}" if unit == "bytes" else f"{count:.1f} {unit}"
        count /= 1000
    return f"{count:.1f} GB"
