"""The command `deltact-fab`: one file per noun, imported only when called."""

from __future__ import annotations

import errno
import os
import sys
import warnings
from contextlib import suppress
from itertools import pairwise

import click

from deltact_fab.common import DeltactFabError, MissingLibrary, RunFailed, Stopped, fault_line
from deltact_fab.version import PACKAGE_VERSION

from .group import CommandGroup, load_command

PROGRAM_NAME = "deltact-fab"

# title: {name: line of help}; a noun is in the module of its name, imported on first use, so that
# `--help` stays fast.
HELP_SECTIONS = {
    "Begin": {
        "init": "Make a working folder with files of your own.",
        "demo": "Run the whole chain on the virtual rig, up to its report.",
        "doctor": "Check the installation.",
        "schema": "Explain every key of every kind of file.",
    },
    "Make a sensor": {
        "cad": "Parts: design, check, export, order, assemble.",
        "pattern": "Pattern stickers: design, inspect, print.",
    },
    "Run experiments": {
        "protocol": "Indentation experiments: write, check, show.",
        "rig": "Benches: describe, check, move manually.",
        "run": "Carry out a protocol on a rig and record it.",
        "record": "Recorded runs: verify, show, annotate, export.",
    },
    "Calibrate and measure": {
        "calibrate": "Calibrate lens, depth and force, one file each.",
        "measure": "Shape, force and contact, live.",
    },
    "Analyse": {
        "analyze": "Tracking error and shape of recorded runs.",
        "report": "Write an offline page about a run.",
        "study": "The paper's experiments, and better ones.",
    },
    "Simulate": {
        "gel": "Gel mechanics: press, fit, solve ahead of a run.",
        "numerics": "Accuracy, speed and hard cases of the solvers.",
    },
}
COMMAND_HELP = {name: text for section in HELP_SECTIONS.values() for name, text in section.items()}


class LazyGroup(CommandGroup):
    """Group with its commands' names and one-line helps, without importing them."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Refuse empty arguments, which a shell makes of an unset variable."""
        for previous, word in pairwise(["", *args]):
            if (not word or word[:2] + word[-1] == "--=") and not ctx.resilient_parsing:
                label = word[:-1] or (previous if previous.startswith("-") else "an argument")
                raise click.UsageError(f"{label}: empty; give a value, or omit it", ctx)
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMAND_HELP)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        return load_command(cmd_name) if cmd_name in COMMAND_HELP else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        widest = max(map(len, COMMAND_HELP))
        for title, commands in HELP_SECTIONS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(widest), text) for name, text in commands.items()])


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
    epilog="`deltact-fab COMMAND --help` explains a command. Exit codes: 0 done, 1 ran and failed, "
    "2 bad input, 130 interrupted.",
)
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
@click.version_option(PACKAGE_VERSION, prog_name=PROGRAM_NAME)
def main(debug: bool) -> None:
    """Make DelTact tactile sensors, and design and run the experiments that qualify them."""


def entry() -> None:
    """Console entry: one line on stderr for an error; exit 1 failed, 2 bad input, 130 stopped."""
    # The place in the code, the default's first line, is of no use on a command line.
    warnings.showwarning = lambda text, *_, **__: click.echo(f"warning: {text}", err=True)
    try:
        status = _run_main()
        sys.stdout.flush()
    except OSError as error:
        expected = isinstance(error, BrokenPipeError) or error.errno in (
            *RunFailed.DISK,
            errno.ENAMETOOLONG,
        )
        if not expected or "--debug" in sys.argv:
            raise
        # Discard the rest of the buffer.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = _report_os_error(error)
    sys.exit(status)


def _run_main() -> int:
    """Run the command and return the exit code. Raises OSError from the system."""
    try:
        status = main(prog_name=PROGRAM_NAME, standalone_mode=False)
    except click.exceptions.Exit as exit_request:
        return exit_request.exit_code
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        return 2
    except click.ClickException as error:
        click.echo(fault_line(f"{PROGRAM_NAME}: {error.format_message()}"), err=True)
        return 2
    except (click.Abort, KeyboardInterrupt):
        click.echo(f"{PROGRAM_NAME}: stopped", err=True)
        return Stopped.exit_code
    except DeltactFabError as error:
        if "--debug" in sys.argv:
            raise
        stopped = isinstance(error, MissingLibrary) and _find_cause(error, KeyboardInterrupt)
        first, *details = ("stopped",) if stopped else error.faults
        click.echo(fault_line(f"{PROGRAM_NAME}: {first}", *details, untold=error.untold), err=True)
        refused = _find_cause(error, OSError)
        if isinstance(refused, OSError) and refused.errno in RunFailed.DISK:
            return 1
        return Stopped.exit_code if stopped else error.exit_code
    return status if isinstance(status, int) else 0


def _report_os_error(error: OSError) -> int:
    """Report an error of the system, except a closed pipe; return the exit code."""
    if isinstance(error, BrokenPipeError):  # most are click's, which ends with 1 as well
        return 1
    with suppress(OSError):
        message = f"{error.filename or 'output'}: cannot be written: {error.strerror}"
        click.echo(fault_line(f"{PROGRAM_NAME}: {message}"), err=True)
    return 2 if error.errno == errno.ENAMETOOLONG else 1


def _find_cause(error: BaseException | None, kind: type[BaseException]) -> BaseException | None:
    """Find a cause of a kind: a compiled library turns Ctrl-C into a failed import."""
    while error is not None and not isinstance(error, kind):
        error = error.__cause__ or error.__context__
    return error


if __name__ == "__main__":
    entry()
