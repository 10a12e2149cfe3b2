"""The command `deltact-fab`: one file a noun, loaded only when it is called."""

from __future__ import annotations

import errno
import os
import sys
from contextlib import suppress
from itertools import pairwise

import click

from deltact_fab.common import DeltactFabError, MissingLibrary, RunFailed, Stopped, fault_line
from deltact_fab.version import PACKAGE_VERSION

from .group import CommandGroup, loaded

PROGRAM = "deltact-fab"

# title: {name: line of help}; a noun stands in the module of its name, which is imported only when
# it is used, so that `--help` stays fast whatever the nouns need.
SECTIONS = {
    "Begin": {
        "init": "Make a working folder with files of your own.",
        "demo": "The whole chain on the virtual rig, up to its report.",
        "doctor": "What is installed, what is missing, how to get it.",
        "schema": "Every key of every kind of file, explained.",
    },
    "Make a sensor": {
        "cad": "Parts: design, check, export, order, assemble.",
        "pattern": "Pattern stickers: design, inspect, print.",
    },
    "Run experiments": {
        "protocol": "Indentation experiments: write, check, look at.",
        "rig": "Benches: describe, check, drive by hand.",
        "run": "Carry out a protocol on a rig and record it.",
        "record": "Recorded runs: verify, look at, annotate, export.",
    },
    "Calibrate and measure": {
        "calibrate": "Calibrate lens, depth and force, one file each.",
        "measure": "Shape, force and contact, live.",
    },
    "Analyse": {
        "analyze": "Tracking error and shape of recorded runs.",
        "report": "Write one offline page about a run.",
        "study": "The paper's experiments, and better ones.",
    },
    "Simulate": {
        "gel": "Gel mechanics: press, fit, solve ahead of a run.",
        "numerics": "Accuracy, speed and hard cases of the solvers.",
    },
}
COMMANDS = {name: text for section in SECTIONS.values() for name, text in section.items()}


class LazyGroup(CommandGroup):
    """A group that knows its commands' names and one-line helps without importing them."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """An empty word is no path and no name: a shell makes one of a variable that is unset."""
        for before, word in pairwise(["", *args]):
            if (not word or word[:2] + word[-1] == "--=") and not ctx.resilient_parsing:
                named = word[:-1] or (before if before.startswith("-") else "an argument")
                raise click.UsageError(f"{named}: empty; give a value, or leave it out", ctx)
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        return loaded(cmd_name) if cmd_name in COMMANDS else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        widest = max(map(len, COMMANDS))
        for title, commands in SECTIONS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(widest), text) for name, text in commands.items()])


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
    epilog="`deltact-fab COMMAND --help` explains a command. Exit codes: 0 done, 1 ran and failed, "
    "2 bad input, 130 interrupted.",
)
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
@click.version_option(PACKAGE_VERSION, prog_name=PROGRAM)
def main(debug: bool) -> None:
    """Make DelTact tactile sensors, and design and run the experiments that qualify them."""


def entry() -> None:
    """Console entry: one line on stderr for an error; exit 1 failed, 2 bad input, 130 stopped."""
    try:
        status = _status()
        sys.stdout.flush()
    except OSError as why:
        known = isinstance(why, BrokenPipeError) or why.errno in (
            *RunFailed.DISK,
            errno.ENAMETOOLONG,
        )
        if not known or "--debug" in sys.argv:
            raise
        # What is still in the buffer goes nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = _of_the_system(why)
    sys.exit(status)


def _status() -> int:
    """The exit code. Raises OSError where the system refuses."""
    try:
        status = main(prog_name=PROGRAM, standalone_mode=False)
    except click.exceptions.Exit as done:
        return done.exit_code
    except click.ClickException as why:
        click.echo(fault_line(f"{PROGRAM}: {why.format_message()}"), err=True)
        return 2
    except (click.Abort, KeyboardInterrupt):
        click.echo(f"{PROGRAM}: stopped", err=True)
        return Stopped.exit_code
    except DeltactFabError as why:
        if "--debug" in sys.argv:
            raise
        stopped = isinstance(why, MissingLibrary) and _caused_by(why, KeyboardInterrupt)
        first, *others = ("stopped",) if stopped else why.faults
        click.echo(fault_line(f"{PROGRAM}: {first}", *others, untold=why.untold), err=True)
        refused = _caused_by(why, OSError)
        if isinstance(refused, OSError) and refused.errno in RunFailed.DISK:
            return 1
        return Stopped.exit_code if stopped else why.exit_code
    return status if isinstance(status, int) else 0


def _of_the_system(why: OSError) -> int:
    """Says what the system refused, but for a reader that has enough; the exit code."""
    if isinstance(why, BrokenPipeError):  # most are click's, which ends with 1 as well
        return 1
    with suppress(OSError):
        told = f"{PROGRAM}: {why.filename or 'output'}: cannot be written: {why.strerror}"
        click.echo(fault_line(told), err=True)
    return 2 if why.errno == errno.ENAMETOOLONG else 1


def _caused_by(why: BaseException | None, kind: type[BaseException]) -> BaseException | None:
    """What an error goes back to: a compiled library turns Ctrl-C into a failed import."""
    while why is not None and not isinstance(why, kind):
        why = why.__cause__ or why.__context__
    return why


if __name__ == "__main__":
    entry()
