"""The command of a study, made from what the registry declares."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import InputError
from .options import RIG_NAME, SEED, Finite

if TYPE_CHECKING:
    from ..study.registry import Option, Study

# option: (what `Study.takes` calls it, how it is declared)
COMMON: dict[str, tuple[str, Callable[[Study], dict[str, Any]]]] = {
    "--scale": (
        "scale",
        lambda one: {
            "type": Finite(0, 1, min_open=True),
            "default": one.scale,
            "show_default": one.scale is not None,
            "metavar": "SHARE",
            "help": "Share of the paper's points or frames, up to 1.",
        },
    ),
    "--seed": (
        "seed",
        lambda one: {
            "type": SEED,
            "default": 0,
            "show_default": True,
            "metavar": "N",
            "help": "Seed of everything random.",
        },
    ),
    "--rig": (
        "rig",
        lambda one: {
            "type": RIG_NAME,
            "metavar": "RIG",
            "show_default": "the study's own",
            "help": "Virtual rig: a name of `rig list` or a path.",
        },
    ),
    "--from": (
        "from",
        lambda one: {
            "multiple": True,
            "type": click.Path(path_type=Path),
            "metavar": "RUN",
            "help": "Use this recorded run instead of simulating; repeatable.",
        },
    ),
    "--jobs": (
        "grid",
        lambda one: {
            "type": click.IntRange(1, 256),
            "metavar": "N",
            "show_default": "one per processor",
            "help": "Processes at a time.",
        },
    ),
    "--on": (
        "grid",
        lambda one: {
            "default": "local",
            "show_default": True,
            "metavar": "WHERE",
            "help": "Where jobs run: local, or a Dask scheduler as dask:tcp://HOST:PORT.",
        },
    ),
}
OUT = "study-out"


class _Command(click.Command):
    """Says of an option of other studies that this one does not take it."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as why:
            if why.option_name not in COMMON:
                raise
            raise InputError(
                f"{why.option_name}: the study {self.name} has no such option"
            ) from why


def command(name: str, one: Study) -> click.Command:
    """`study run NAME`, with the options that this study takes."""
    options: list[click.Parameter] = [
        click.Option([flag], **declared(one))
        for flag, (what, declared) in COMMON.items()
        if what in one.takes
    ]
    options += [_option(more) for more in one.options]
    options += [
        click.Option(
            ["--out"],
            type=click.Path(path_type=Path, file_okay=False),
            default=Path(OUT) / name,
            show_default=True,
            metavar="DIR",
            help="Folder for the page and the tables.",
        ),
        click.Option(
            ["--figures"],
            type=click.Path(path_type=Path, file_okay=False),
            metavar="DIR",
            help="Also write the figures as SVG and PDF into this folder.",
        ),
        click.Option(["--json", "as_json"], is_flag=True, help="Print JSON."),
    ]
    about = f"{one.line}\n\n{one.about}".strip()

    def run(**given: Any) -> None:
        from .study_run import run

        run(name, one, given)

    return _Command(name, params=options, callback=run, help=about, short_help=one.line)


def _option(one: Option) -> click.Option:
    given: dict[str, Any] = {"help": one.help}
    kind = one.kind if one.default is None else type(one.default)
    flag = f"--{one.name}"
    if kind is bool:
        return click.Option(
            [f"{flag}/--no-{one.name}"], default=one.default, show_default=True, **given
        )
    if one.default not in (None, ()):
        given |= {"default": one.default, "show_default": True}
    if kind is tuple:
        given["multiple"] = True
    elif kind is bool:
        pass  # the flag's form says it
    elif one.choices:
        given["type"] = click.Choice(one.choices)
    elif one.low is None and one.high is None and kind is not float:
        given["type"] = kind
    elif kind is int:
        low, high = (None if limit is None else int(limit) for limit in (one.low, one.high))
        given["type"] = click.IntRange(low, high)
    else:
        given["type"] = Finite(one.low, one.high)
    return click.Option([flag], **given)
