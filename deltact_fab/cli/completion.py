"""`deltact-fab completion`: what a shell needs to complete commands, options and names."""

from __future__ import annotations

import click


@click.command(epilog='Example: eval "$(deltact-fab completion bash)"')
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the completion script of a shell.

    Commands, options and their choices are completed, and the names of designs, parts, patterns,
    protocols, rigs and kinds of files. Put the line below into ~/.bashrc or ~/.zshrc; for fish save
    the output as ~/.config/fish/completions/deltact-fab.fish.
    """
    from click.shell_completion import get_completion_class

    from .main import PROGRAM, main

    kind = get_completion_class(shell)
    assert kind is not None
    variable = f"_{PROGRAM}_COMPLETE".replace("-", "_").upper()
    click.echo(kind(main, {}, PROGRAM, variable).source())
