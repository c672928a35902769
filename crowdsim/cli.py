"""The command line, put together; beside ``crowdsim.commands`` the only place that prints, catches and exits."""

from __future__ import annotations

import atexit
import gc
import re
import signal
import sys
import traceback
from typing import Annotated, Any

import typer
from typer.core import TyperArgument, TyperCommand

from crowdsim import __version__
from crowdsim.commands.batching import batch
from crowdsim.commands.checking import schema, status, validate, verify
from crowdsim.commands.common import talk, with_talk
from crowdsim.commands.inspecting import inspect
from crowdsim.commands.motion import perform
from crowdsim.commands.packing import pack
from crowdsim.commands.profiling import profile
from crowdsim.commands.rendering import render
from crowdsim.commands.running import export, run
from crowdsim.commands.training import train
from crowdsim.errors import CrowdsimError

EXIT_CODES = "Exit codes: 0 done, 1 a run failed, 2 invalid input, 130 interrupted, 143 terminated."


class Verb(TyperCommand):
    """A command whose help shows arguments by their names alone, without Python's types and braces."""

    def __init__(self, *values: Any, **named: Any) -> None:
        super().__init__(*values, **named)
        for argument in self.params:
            if isinstance(argument, TyperArgument):
                # What newer versions of typer put after the name.
                vars(argument)["display_type_rich"] = lambda ctx: None

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the parts of the usage line."""
        return [re.sub(r"[{}]", "", piece) for piece in super().collect_usage_pieces(ctx)]


app = typer.Typer(
    name="crowdsim",
    help="Data-driven fight crowds: motion capture in, a trained crowd out.",
    epilog=EXIT_CODES,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
)
for _command in (perform, inspect, train, run, batch, export, render, profile, validate, schema, verify, status, pack):
    app.command(cls=Verb, epilog=EXIT_CODES)(with_talk(_command))


def main() -> None:
    """Run the command line and leave with its exit code: 0 done, 1 failed, 2 invalid input, 130 or 143 interrupted."""
    signal.signal(signal.SIGTERM, _terminate)
    # Imports create many objects and almost no garbage: collecting it after every 700th costs 0.1 s.
    gc.set_threshold(300_000, 10, 10)
    # At the end nothing need be looked through for garbage, which takes half a second.
    atexit.unregister(gc.freeze)
    atexit.register(gc.freeze)
    talk.quiet = talk.verbose = False
    try:
        _run_command()
    except CrowdsimError as error:
        if talk.verbose:
            traceback.print_exc()
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:
        # The reader of standard output has closed it, which is no failure of this program.
        sys.stderr.close()
        sys.exit(0)
    except OSError as error:
        # Errors of the system that no check foresees, such as a disk that fills up between two checks.
        print(f"{error.filename or 'crowdsim'}: {error.strerror or error}", file=sys.stderr)
        sys.exit(1)


def _run_command() -> None:
    try:
        app(standalone_mode=True)
    except RuntimeError as error:
        # Up to Python 3.11 this wraps what a signal raises while a class is made, as in imports.
        if isinstance(error.__cause__, (SystemExit, KeyboardInterrupt)):
            raise error.__cause__ from None
        raise


def _terminate(number: int, frame: Any) -> None:
    print("terminated", file=sys.stderr)
    sys.exit(128 + number)


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"crowdsim {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    pass


if __name__ == "__main__":
    main()
