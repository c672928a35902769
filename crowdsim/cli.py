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
from crowdsim.commands.exporting import export, with_outputs
from crowdsim.commands.inspecting import inspect
from crowdsim.commands.motion import perform
from crowdsim.commands.packing import pack
from crowdsim.commands.playing import play
from crowdsim.commands.process import describe_failure, leave_in_time, shown
from crowdsim.commands.profiling import profile
from crowdsim.commands.rendering import render
from crowdsim.commands.reporting import report
from crowdsim.commands.running import run
from crowdsim.commands.training import train
from crowdsim.commands.viewing import view
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


class ExportVerb(Verb):
    """The command ``export``, whose options are made when it is called."""

    def make_context(self, *values: Any, **named: Any) -> Any:
        """Return the context of a call."""
        whole = typer.Typer(add_completion=False)
        whole.command(cls=Verb)(with_talk(with_outputs(export)))
        made = typer.main.get_command(whole)
        self.params, self.callback = made.params, made.callback
        return super().make_context(*values, **named)


app = typer.Typer(
    name="crowdsim",
    help="Data-driven fight crowds: motion capture in, a trained crowd out.",
    epilog=EXIT_CODES,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
)
for _command in (
    perform,
    inspect,
    train,
    run,
    batch,
    export,
    render,
    view,
    play,
    report,
    profile,
    validate,
    schema,
    verify,
    status,
    pack,
):
    app.command(cls=ExportVerb if _command is export else Verb, epilog=EXIT_CODES)(with_talk(_command))


def main() -> None:
    """Run the command line and leave with its exit code: 0 done, 1 failed, 2 invalid input, 130 or 143 interrupted."""
    signal.signal(signal.SIGTERM, _stop)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _stop)
    # Imports create many objects and almost no garbage: collecting it after every 700th costs 0.1 s.
    gc.set_threshold(300_000, 10, 10)
    # At the end nothing need be looked through for garbage, which takes half a second.
    atexit.unregister(gc.freeze)
    atexit.register(gc.freeze)
    talk.quiet = talk.verbose = False
    try:
        with shown():
            _run_command(is_program=sys._getframe(1).f_globals.get("__name__") == "__main__")
    except CrowdsimError as error:
        # One of the streams may be closed.
        print(error, file=sys.stderr or sys.stdout)
        sys.exit(error.exit_code)


def _run_command(is_program: bool) -> None:
    try:
        with leave_in_time(is_program):
            _call_app()
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:
        # The reader of standard output has closed it, which is no failure of this program.
        sys.stderr.close()
        sys.exit(0)
    except (CrowdsimError, OSError, RuntimeError) as error:
        failure = error if isinstance(error, CrowdsimError) else describe_failure(error)
        if failure is None:
            raise
        if talk.verbose:
            traceback.print_exc()
        print(failure, file=sys.stderr)
        sys.exit(failure.exit_code)


def _call_app() -> None:
    try:
        app(standalone_mode=True)
    except RuntimeError as error:
        # Up to Python 3.11 this wraps what a signal raises while a class is made, as in imports.
        if isinstance(error.__cause__, (SystemExit, KeyboardInterrupt)):
            raise error.__cause__ from None
        raise


def _stop(number: int, frame: Any) -> None:
    if number == signal.SIGINT:
        print("interrupted", file=sys.stderr)
        raise KeyboardInterrupt
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
