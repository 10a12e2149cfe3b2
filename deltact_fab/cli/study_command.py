"""The command of a study, made from what the registry declares."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import InputError
from .options import RIG_NAME, SEED, Finite

if TYPE_CHECKING:
    from ..study.registry import Option, Study

OUT = "study-out"


class _Command(click.Command):
    """Says of an option of other studies that this one does not take it."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as why:
            common = [flag for own in _common(None).values() for one in own for flag in one.opts]
            if why.option_name not in common:
                raise
            raise InputError(
                f"{why.option_name}: the study {self.name} has no such option"
            ) from why


def _common(scale: float | None) -> dict[str, list[click.Option]]:
    """The options that studies share, by what `Study.takes` calls them."""
    return {
        "scale": [
            click.Option(
                ["--scale"], type=Finite(0, 1, min_open=True), default=scale,
                show_default=scale is not None, metavar="SHARE",
                help="Share of the paper's points or frames, up to 1.",
            )
        ],
        "seed": [
            click.Option(
                ["--seed"], type=SEED, default=0, show_default=True, metavar="N",
                help="Seed of everything random.",
            )
        ],
        "rig": [
            click.Option(
                ["--rig"], type=RIG_NAME, metavar="RIG", show_default="the study's own",
                help="Virtual rig: a name of `rig list` or a path.",
            )
        ],
        "from": [
            click.Option(
                ["--from"], multiple=True, type=click.Path(path_type=Path), metavar="RUN",
                help="Use this recorded run instead of simulating; repeatable.",
            )
        ],
        "grid": [
            click.Option(
                ["--jobs"], type=click.IntRange(1, 256), metavar="N",
                show_default="one per processor", help="Processes at a time.",
            ),
            click.Option(
                ["--on"], default="local", show_default=True, metavar="WHERE",
                help="Where jobs run: local, or a Dask scheduler as dask:tcp://HOST:PORT.",
            ),
        ],
    }  # fmt: skip


def command(name: str, one: Study) -> click.Command:
    """`study run NAME`, with the options that this study takes."""
    options: list[click.Parameter] = [
        option for what, own in _common(one.scale).items() if what in one.takes for option in own
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
    kind = one.kind if one.default is None else type(one.default)
    given: dict[str, Any] = {"help": one.help}
    if kind is tuple:
        given["multiple"] = True
    else:
        given["type"] = Finite() if kind is float else kind
    if one.default not in (None, ()):
        given |= {"default": one.default, "show_default": True}
    return click.Option([f"--{one.name}"], **given)
