"""docs/reference: every key of every kind of file, and every command with its options.

python -m benchmarks.reference    writes the pages, and with them those of `architecture`; tests
                                  hold them against the code.
"""

from __future__ import annotations

import dataclasses
import inspect
import typing
from collections.abc import Iterator
from pathlib import Path

import click
import pydantic

import deltact_fab
from deltact_fab.app.cli.main import main as program
from deltact_fab.app.schema import FILE_KINDS, OUTPUT_KINDS, FileKind, rows
from deltact_fab.common import catalog

from . import architecture, extend_pages

FOLDER = Path(__file__).parents[1] / "docs" / "reference"
MADE = "<!-- written by python -m benchmarks.reference -->"


def pages() -> dict[str, str]:
    """The text of each page, by the name of its file."""
    made = {f"{kind.name}.md": _keys(kind) for kind in (FILE_KINDS | OUTPUT_KINDS).values()}
    made["commands.md"] = _commands()
    made["python.md"] = _python()
    made["README.md"] = _index()
    return {name: text.rstrip("\n") + "\n" for name, text in made.items()}


def write() -> None:
    """Write all pages, and remove those that are none any more."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    made = pages()
    for file in FOLDER.glob("*.md"):
        if file.name not in made:
            file.unlink()
    for name, text in made.items():
        (FOLDER / name).write_text(text)
    architecture.write()
    extend_pages.write()


def _index() -> str:
    lines = [
        "# Reference",
        MADE,
        "",
        "Written from the program itself. `deltact-fab schema KIND` prints the same keys, --json",
        "as a JSON Schema; `deltact-fab init FOLDER` puts the schemas where an editor finds them.",
        "",
        "- [commands](commands.md): every command with its arguments and options",
        "- [Python](python.md): what `import deltact_fab as dt` has",
        *(
            f"- [{kind.name}]({kind.name}.md): {kind.about}"
            for kind in (FILE_KINDS | OUTPUT_KINDS).values()
        ),
        "",
        "## Where a name is looked for",
        "",
        "A file is named by its path, or by its name alone. NAME is then the first of these:",
        "",
        "| kind of file | in the working folder | in the working folder, with one of the keys "
        "| shipped |",
        "|---|---|---|---|",
    ]
    for folder, marks in catalog.KIND_KEYS.items():
        names = ", ".join(f"`{mark}`" for mark in sorted(marks))
        kinds = " or ".join(k.name for k in FILE_KINDS.values() if k.catalogue == folder)
        lines.append(f"| {kinds} | `{folder}/NAME.toml` | `NAME.toml` ({names}) | `NAME` |")
    return "\n".join(lines)


def _keys(kind: FileKind) -> str:
    about = kind.about[:1].upper() + kind.about[1:]
    lines = [
        f"# Keys of a file of kind {kind.name}",
        MADE,
        "",
        f"{about}. `[]` is an entry of a list of tables, `*` any name.",
        "",
        "| key | type | unit | default | limits | meaning |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows(kind):
        default = row.default_text
        if default.startswith("default "):
            default = f"`{row.default}`"
        cells = (f"`{row.key}`", row.type, row.unit, default, row.limits, row.meaning)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines)


def commands(
    group: click.Command = program, context: click.Context | None = None
) -> Iterator[tuple[click.Context, click.Command]]:
    """Every command with its context, groups above what is in them."""
    context = context or click.Context(program, info_name="deltact-fab", **program.context_settings)
    yield context, group
    if isinstance(group, click.Group):
        for name in group.list_commands(context):
            inner = group.get_command(context, name)
            assert inner is not None
            yield from commands(inner, click.Context(inner, context, info_name=name))


def _commands() -> str:
    lines = [
        "# Commands",
        MADE,
        "",
        "Exit codes: 0 done, 1 ran and failed, 2 bad input, 130 interrupted. `--help` stands at "
        "every level.",
    ]
    for context, command in commands():
        usage = " ".join(command.collect_usage_pieces(context))
        lines += ["", f"## {context.command_path}", "", f"`{context.command_path} {usage}`", ""]
        # click's \b keeps lines as they are
        lines += [line.rstrip() for line in _help(command).replace("\b\n", "").splitlines()]
        if command.epilog and command.epilog.startswith("Example: "):
            lines += ["", f"Example: `{command.epilog.removeprefix('Example: ')}`"]
        records = [
            record
            for param in command.get_params(context)
            if isinstance(param, click.Option) and "--help" not in param.opts
            if (record := param.get_help_record(context)) is not None
        ]
        if records:
            lines += ["", "| option | meaning |", "|---|---|"]
        for names, said in records:
            cells = (f"`{names}`", " ".join(said.split()))
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines)


def _python() -> str:
    """Directives alone: sphinx takes the text from the docstrings."""
    named = {name: getattr(deltact_fab, name) for name in deltact_fab.__all__ if name[0] != "_"}
    results: dict[str, typing.Any] = {}
    lines = ["# Python", MADE, "", *_from_docstrings("module", "deltact_fab")]
    for name, one in named.items():
        lines += [f"## dt.{name}", ""]
        if inspect.isclass(one):  # by its own name: sphinx says of another one only that it is one
            lines += _from_docstrings("class", f"{one.__module__}.{one.__qualname__}", one)
        else:
            lines += _from_docstrings("function", f"deltact_fab.{name}")
        _add_results(_returned(getattr(one, "result", one)), results)
    lines += ["## What they return", ""]
    for name, result in results.items():
        lines += _from_docstrings("class", name, result)
    return "\n".join(lines)


def _from_docstrings(kind: str, name: str, documented: type = object) -> list[str]:
    """A directive; of a class with its members, without those of pydantic and of exceptions."""
    members = ["   :members:"] if kind == "class" else []
    if members and not issubclass(documented, pydantic.BaseModel | Exception):
        members.append("   :inherited-members:")
    return ["```{eval-rst}", f".. auto{kind}:: {name}", *members, "```", ""]


def _returned(function: typing.Any) -> typing.Any:
    """The type that a function says it returns; None for a class."""
    function = inspect.unwrap(function)
    return eval(function.__annotations__.get("return", "None"), vars(inspect.getmodule(function)))


def _add_results(hint: typing.Any, found: dict[str, typing.Any]) -> None:
    """The package's classes in a type, and those of a measurement's fields."""
    for part in typing.get_args(hint):
        _add_results(part, found)
    home = getattr(hint, "__module__", "")
    name = f"{home}.{getattr(hint, '__qualname__', '')}"
    if home.startswith("deltact_fab") and name not in found:
        found[name] = hint
        if dataclasses.is_dataclass(hint) and home.split(".")[2] in ("live", "measure"):
            for inner in typing.get_type_hints(hint).values():
                _add_results(inner, found)


def _help(command: click.Command) -> str:
    return inspect.cleandoc(command.help or "").partition("\f")[0]


if __name__ == "__main__":
    write()
