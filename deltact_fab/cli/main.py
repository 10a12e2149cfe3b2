"""The command `deltact-fab`: one file a noun, loaded only when it is called."""

from __future__ import annotations

import errno
import importlib
import sys

import click

from .. import __version__
from ..errors import INTERRUPTED, DeltactFabError, one_line

# name: (module, attribute, line of help); a noun's module is imported only when it is used, so
# that `--help` stays fast whatever the nouns need.
COMMANDS = {
    "init": ("init", "init", "A working folder with files of your own to begin with."),
    "cad": ("cad", "cad", "Parametric parts: new, check, export, bill of materials, guide."),
    "pattern": ("pattern", "pattern", "Pattern stickers: new, make, inspect, print."),
    "protocol": ("protocol", "protocol", "Indentation experiments: new, check, show, list."),
    "rig": ("rig", "rig", "Benches: new, check, list, show, register, drive by hand."),
    "calibrate": ("calibrate", "calibrate", "The lens, from images of boards."),
    "calibrate-depth": (
        "calibrate_depth",
        "calibrate_depth",
        "The depth, from one press of a ball.",
    ),
    "gel": ("gel", "gel", "Gel mechanics: press, fit, path."),
    "analyze": ("analyze", "analyze", "Analyses of recorded runs."),
    "measure": ("measure", "measure", "Shape, force and contact, live."),
    "report": ("report", "report", "One offline page of a run."),
    "record": ("record", "record", "Recorded runs: check, show, note, export."),
    "run": ("run", "run", "Carry out a protocol on a rig."),
    "study": ("study", "study", "The paper's experiments: list, run, index."),
    "numerics": ("numerics", "numerics", "Error against run time, and stability, of the engines."),
    "schema": ("schema", "schema", "Every key of a kind of file: type, unit, limits, meaning."),
    "doctor": ("doctor", "doctor", "What is installed, what is not, and how to get it."),
    "demo": ("demo", "demo", "The whole chain on the virtual rig, to a report."),
}


class LazyGroup(click.Group):
    """A group that knows its commands' names and one-line helps without importing them."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module, attribute, _ = COMMANDS[cmd_name]
        command = getattr(importlib.import_module(f"deltact_fab.cli.{module}"), attribute)
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry[2]) for name, entry in COMMANDS.items()])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
@click.version_option(__version__, prog_name="deltact-fab")
def main(debug: bool) -> None:
    """Make DelTact tactile sensors, and design and run the experiments that qualify them."""


def entry() -> None:
    """Console entry: one line on stderr for an error; exit 1 failed, 2 bad input, 130 stopped."""
    try:
        status = main(standalone_mode=False)
    except click.exceptions.Exit as done:
        status = done.exit_code
    except click.ClickException as why:
        click.echo(one_line(f"deltact-fab: {why.format_message()}"), err=True)
        status = 2
    except (click.Abort, KeyboardInterrupt):
        click.echo("deltact-fab: stopped", err=True)
        status = INTERRUPTED
    except DeltactFabError as why:
        if "--debug" in sys.argv:
            raise
        click.echo(one_line(f"deltact-fab: {why}"), err=True)
        status = why.exit_code
    except OSError as why:
        if why.errno != errno.ENAMETOOLONG or "--debug" in sys.argv:
            raise
        click.echo(one_line(f"deltact-fab: {why.filename}: too long for a file's name"), err=True)
        status = 2
    sys.exit(status if isinstance(status, int) else 0)


if __name__ == "__main__":
    entry()
