"""The command `deltact-fab`: one file a noun, loaded only when it is called."""

from __future__ import annotations

import errno
import sys
from types import MappingProxyType

import click

from ..errors import INTERRUPTED, DeltactFabError, MissingLibrary, one_line
from ..version import VERSION
from .group import CommandGroup, command_at

PROGRAM = "deltact-fab"

# title: {name: line of help}; a noun stands in the module of its name, which is imported only when
# it is used, so that `--help` stays fast whatever the nouns need.
SECTIONS = {
    "Begin": {
        "init": "Make a working folder with files of your own.",
        "demo": "The whole chain on the virtual rig, up to its report.",
        "doctor": "What is installed, what is missing, how to get it.",
        "schema": "Every key of every kind of file, explained.",
        "completion": "Completion of commands and names in a shell.",
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

    moved = MappingProxyType({"calibrate-depth": "calibrate depth"})

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        return command_at(cmd_name, ctx) if cmd_name in COMMANDS else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        widest = max(map(len, COMMANDS))
        for title, commands in SECTIONS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(widest), text) for name, text in commands.items()])


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="`deltact-fab COMMAND --help` explains a command. Exit codes: 0 done, 1 ran and failed, "
    "2 bad input, 130 interrupted.",
)
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
@click.version_option(VERSION, prog_name=PROGRAM)
def main(debug: bool) -> None:
    """Make DelTact tactile sensors, and design and run the experiments that qualify them."""


def entry() -> None:
    """Console entry: one line on stderr for an error; exit 1 failed, 2 bad input, 130 stopped."""
    try:
        status = main(prog_name=PROGRAM, standalone_mode=False)
    except click.exceptions.Exit as done:
        status = done.exit_code
    except click.ClickException as why:
        click.echo(one_line(f"{PROGRAM}: {why.format_message()}"), err=True)
        status = 2
    except (click.Abort, KeyboardInterrupt):
        click.echo(f"{PROGRAM}: stopped", err=True)
        status = INTERRUPTED
    except DeltactFabError as why:
        if "--debug" in sys.argv:
            raise
        stopped = isinstance(why, MissingLibrary) and _by_ctrl_c(why)
        click.echo(one_line(f"{PROGRAM}: {'stopped' if stopped else why}"), err=True)
        status = INTERRUPTED if stopped else why.exit_code
    except OSError as why:
        if why.errno != errno.ENAMETOOLONG or "--debug" in sys.argv:
            raise
        click.echo(one_line(f"{PROGRAM}: {why.filename}: too long for a file's name"), err=True)
        status = 2
    sys.exit(status if isinstance(status, int) else 0)


def _by_ctrl_c(why: BaseException) -> bool:
    """Whether an error goes back to Ctrl-C: a compiled library turns it into a failed import."""
    before = why.__cause__ or why.__context__
    return isinstance(why, KeyboardInterrupt) or (before is not None and _by_ctrl_c(before))


if __name__ == "__main__":
    entry()
