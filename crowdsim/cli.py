"""The command line, put together; beside ``crowdsim.commands`` the only place that prints, catches and exits."""

from __future__ import annotations

import gc
import signal
import sys
from typing import Annotated, Any

import typer

from crowdsim import __version__
from crowdsim.commands.checking import schema, status, validate, verify
from crowdsim.commands.inspecting import inspect
from crowdsim.commands.motion import perform, train
from crowdsim.commands.profiling import profile
from crowdsim.commands.rendering import render
from crowdsim.commands.running import export, run
from crowdsim.errors import CrowdsimError

app = typer.Typer(
    name="crowdsim",
    help="Data-driven fight crowds: motion capture in, a trained crowd out.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
)
for _command in (perform, inspect, train, run, export, render, profile, validate, schema, verify, status):
    app.command()(_command)


def main() -> None:
    """Run the command line and leave with its exit code: 0 done, 1 failed, 2 invalid input, 130 or 143 interrupted."""
    signal.signal(signal.SIGTERM, _terminate)
    # Loading makes a great many objects and next to no rubbish: looking for it at every 700th costs 0.1 s.
    gc.set_threshold(300_000, 10, 10)
    try:
        app(standalone_mode=True)
    except CrowdsimError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:
        # Whoever read standard output has gone; that is no failure of ours.
        sys.stderr.close()
        sys.exit(0)
    except OSError as error:
        # What the system says without a place of its own in our messages: a disk that fills up between two checks.
        print(f"{error.filename or 'crowdsim'}: {error.strerror or error}", file=sys.stderr)
        sys.exit(1)


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
