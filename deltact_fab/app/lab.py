"""Files of a lab: a starter folder, and new files with every key explained."""

from __future__ import annotations

import json
import os
import textwrap
import tomllib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deltact_fab.common import (
    InputError,
    did_you_mean,
    disk_errors,
    read_toml,
    toml_literal,
    toml_text,
    validate,
    write_new_file,
)
from deltact_fab.paths import asset, shipped_folder

from .schema import (
    BY_NAME,
    FILE_KINDS,
    MANY_TABLES,
    ONE_TABLE,
    PATH_MARKS,
    FileKind,
    KeyRow,
    describe,
    json_schema,
    rows,
)

if TYPE_CHECKING:
    from deltact_fab.bench import HostDevice
    from deltact_fab.fabricate import Design

SHIPPED_FOLDERS = ("cad", "patterns", "protocols")
SCHEMA_FOLDER = "schemas"


def init(folder: Path) -> list[Path]:
    """Write a working folder: shipped files, editor schemas and a first tour; return its files.

    Raises InputError for a folder that contains anything but hidden files, RunFailed if the disk
    fails.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; must be a new or empty folder")
    if folder.is_dir() and any(not path.name.startswith(".") for path in folder.iterdir()):
        raise InputError(f"{folder}: must be a new or empty folder")
    texts = _texts()
    for name, text in texts.items():
        with disk_errors(folder / name):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in texts]


def _texts() -> dict[str, str]:
    """Return the text of each file, by its path in the folder."""
    texts = {"README.md": asset("tour.md").read_text(encoding="utf-8")}
    texts["sensors/README.md"] = "A file per sensor: `deltact-fab rig sensors --new A1`.\n"
    catalogues = {kind.catalogue for kind in FILE_KINDS.values()}
    for kind in FILE_KINDS.values():
        text = json.dumps(json_schema(kind), indent=1, ensure_ascii=False, allow_nan=False)
        texts[f"{SCHEMA_FOLDER}/{kind.name}.json"] = text + "\n"
    for top in SHIPPED_FOLDERS:
        shipped = shipped_folder(top)
        for file in sorted(shipped.rglob("*")):
            if file.suffix not in (".toml", ".py"):
                continue
            name = Path(top) / file.relative_to(shipped)
            text, folder = file.read_text(encoding="utf-8"), name.parent.as_posix()
            if file.suffix == ".toml" and folder in catalogues:  # a camera file has no schema
                text = schema_line(kind_of(folder, read_toml(file)), name.parent) + text
            texts[name.as_posix()] = text
    return texts


_LIST_KINDS = {
    "indenter": "indenters", "shape": "indenters", "module": "cameras", "bought": "parts"
}  # fmt: skip
"""Top-level keys that distinguish lists from designs in the folder cad, with their kinds."""


def kind_of(folder: str, data: dict[str, Any]) -> str:
    """Return the name in `FILE_KINDS` of a file in a folder of the catalogue."""
    if folder == "cad":
        return next((kind for key, kind in _LIST_KINDS.items() if key in data), "design")
    if folder == "protocols/rigs":
        return f"{data['kind']}-rig"
    return next(kind.name for kind in FILE_KINDS.values() if kind.catalogue == folder)


def schema_line(kind_name: str, folder: Path) -> str:
    """Return the line with which an editor (taplo, Even Better TOML) finds a file's schema."""
    schema = os.path.relpath(Path(SCHEMA_FOLDER, f"{kind_name}.json"), folder)
    return f"#:schema {Path(schema).as_posix()}\n"


ABOUT_RIG = (
    "A real bench: a GRBL 1.1 or grblHAL stage, with a force sensor, a camera and indenters.",
    "`deltact-fab rig new bench` writes such a file with the detected devices,",
    "`deltact-fab rig check bench.toml` tests them without moving anything.",
    "Software does not replace an emergency stop: install a switch that cuts the motors' power.",
    "",
    "Machine coordinates are mm, 0 at the homed end of each axis and negative below it. The sensor",
    "frame is mm from the centre of the gel's resting face: x along its width, y along its length,",
    "z out of it. Paths are relative to this file. Measure the values marked with MEASURE.",
    "",
)


def protocol(
    name: str, source: str = "smoke", out: Path | None = None, design: str | None = None
) -> tuple[Path, list[str]]:
    """Write a protocol that starts from another one; return its file, and changes for a design.

    Raises InputError as `catalog.write_new`, and for an invalid name, source or design.
    """
    from deltact_fab.bench import load_protocol

    declared, path = load_protocol(source, by_hand=True)
    purpose = f"Based on {source}; state the purpose of the experiment here."
    settings = {**read_toml(path), "name": name, "description": purpose}
    if settings.pop("presses", None) is not None:  # relative to the other file
        settings["press"] = [entry.model_dump(exclude_unset=True) for entry in declared.press]
    changes: list[str] = []
    if design is not None:
        from deltact_fab.fabricate import load_design

        from .fit import fit_settings

        old = load_design(declared.specimen.design)
        settings, changes = fit_settings(settings, old, load_design(design))
        settings["specimen"] = {**settings.get("specimen", {}), "design": design}
    about = (
        f"An indentation experiment, based on {source!r}. Positions are from the centre of the",
        "resting face: x along its width, y along its length, z out of it. Next:",
        f"    deltact-fab protocol check {name}",
        f"    deltact-fab protocol show {name}",
        f"    deltact-fab run {name} --rig virtual --out {name}-run",
    )
    fitted = (f"Fitted to design {design!r}: {line}." for line in changes)
    # A promise is of one plan.
    text = commented_toml(FILE_KINDS["protocol"], settings, (*about, *fitted), None, ("promise",))
    return _write("protocol", name, out, text), changes


def design(
    name: str, base: str = "deltact", out: Path | None = None, solution: Design | None = None,
    head: Iterable[str] = (),
) -> Path:  # fmt: skip
    """Write a design with its base and the changes of a solution, and return its file.

    head: comments at its head. Raises InputError as `catalog.write_new`, and for an invalid name or
    base.
    """
    from deltact_fab.fabricate import load_design

    settings: dict[str, Any] = {"base": base}
    inherited = asdict(load_design(base))
    for section, values in asdict(solution).items() if solution else ():
        changed = {k: v for k, v in values.items() if v != inherited[section][k]}
        settings |= {section: changed} if changed else {}
    about = (
        *(line for text in head for line in textwrap.wrap(text, 96, break_on_hyphens=False)),
        f"A design with the values of {base!r} for all keys not set here. Next:",
        f"    deltact-fab cad check --design {name}",
        f"    deltact-fab cad export --design {name} --out parts",
        "Measure the values marked as assumed, then list them under `measured`.",
    )
    text = commented_toml(FILE_KINDS["design"], settings, about, inherited)
    return _write("design", name, out, text)


def pattern(name: str, law: str = "algorithm1", out: Path | None = None) -> Path:
    """Write a recipe with the keys of its law, and return its file.

    Raises InputError as `catalog.write_new`, and for an invalid name or law.
    """
    from deltact_fab.fabricate import DEFAULT_SEED, PATTERN_LAWS

    if law not in PATTERN_LAWS:
        raise InputError(f"--law: no law {law!r}; {did_you_mean(law, PATTERN_LAWS)}")
    keys = describe(FILE_KINDS["pattern"])["properties"]
    settings: dict[str, Any] = {"law": law, "seed": DEFAULT_SEED}
    for key in PATTERN_LAWS[law].needs:
        # White dots need a white layer behind, which clear film has not.
        black = {"colour": "#000000"}
        settings[key] = black if key == "dots" else keys[key]["examples"][0]
    about = (
        f"A sticker of law {law}: {PATTERN_LAWS[law].about}. Next:",
        f"    deltact-fab pattern quality {name}",
        f"    deltact-fab pattern make {name} -o {name}.png",
        f"    deltact-fab pattern sheet {name} -o {name}.pdf",
    )
    foreign = set(PATTERN_LAWS[law].foreign_keys)
    text = commented_toml(FILE_KINDS["pattern"], settings, about, leave_out=foreign)
    return _write("pattern", name, out, text)


def rig(name: str, out: Path | None = None) -> tuple[Path, dict[str, list[HostDevice]]]:
    """Write a rig file for the devices of this computer; return the file, ports and cameras.

    Raises InputError as `catalog.write_new`, and for an invalid name.
    """
    from deltact_fab.bench import list_devices

    devices = list_devices()
    return _write("grbl-rig", name, out, rig_text(**devices)), devices


def rig_text(ports: Sequence[HostDevice] = (), cameras: Sequence[HostDevice] = ()) -> str:
    """Return the text of a rig file for a real bench; without devices, that of `grbl-bench`.

    The first port and camera are set, the others are listed in comments.
    """
    settings: dict[str, Any] = {"kind": "grbl"}
    texts = {}
    for table, key, devices in (("stage", "port", ports), ("camera", "source", cameras)):
        values = [f"{toml_literal(d.name)}  # {d.text}".rstrip(" #") for d in devices]
        if devices:
            settings[table] = {key: devices[0].name}
            texts[f"{table}.{key}"] = f"\n#or {key} = ".join(values)
    if not ports:
        settings["stage"] = {"port": "/dev/ttyACM0"}
        texts["stage.port"] = '"/dev/ttyACM0"  # example: none found'
    return commented_toml(FILE_KINDS["grbl-rig"], settings, ABOUT_RIG, texts=texts)


def new_file(kind_name: str, name: str, out: Path | None) -> Path:
    """Return the file to write of a kind. Raises InputError for a path instead of a name."""
    if not name or Path(name).name != name or name.endswith(".toml") or not name.isprintable():
        raise InputError(f"{name!r}: must be a name such as mine; give a path with -o FILE.toml")
    folder = Path(FILE_KINDS[kind_name].catalogue)
    return out or (folder if folder.is_dir() else Path()) / f"{name}.toml"


def _write(kind_name: str, name: str, out: Path | None, text: str) -> Path:
    """Write a file of a kind under a name, with the line of its schema if the folder has one.

    Raises InputError for a path instead of a name, and as `catalog.validate` and `write_new`.
    """
    kind, file = FILE_KINDS[kind_name], new_file(kind_name, name, out)
    data = tomllib.loads(text)
    data.pop("base", None)
    validate(kind.model(), data, name)
    if Path(SCHEMA_FOLDER, f"{kind_name}.json").is_file():
        text = schema_line(kind_name, file.parent) + text
    write_new_file(file, text)
    return file


KEY_HINT = (
    "`#key = value` (no space) is an optional key at its default, or an example if it has none.",
    "Uncomment to set it.",
)
ALTERNATIVE_HINT = "`#or` marks an alternative; set one of the two."


def commented_toml(
    kind: FileKind,
    settings: Mapping[str, Any],
    about: Sequence[str] = (),
    inherited: Mapping[str, Any] | None = None,
    leave_out: Collection[str] = (),
    texts: Mapping[str, str] | None = None,
) -> str:
    """Return the text of a TOML file with every key explained.

    settings: values to set; inherited: defaults that replace the model's; leave_out: top-level
    keys to omit; texts: literal value of a key, by its path. A required key without a setting gets
    its example.
    """
    key_rows = [row for row in rows(kind) if row.key.partition(".")[0] not in leave_out]
    ways = (ALTERNATIVE_HINT,) if any(row.instead_of for row in key_rows) else ()
    lines = [f"# {line}".rstrip() for line in (*about, *KEY_HINT, *ways)]
    marks = {"": ""}  # comment prefix of each table's lines
    for row in key_rows:
        table, _, name = row.key.rpartition(".")
        value = _value_at(settings, row.key)
        unset = "" if value is not None or row.required else "#or " if row.instead_of else "#"
        lines.append("")
        if row.type in (ONE_TABLE, BY_NAME, MANY_TABLES):
            entries = value if isinstance(value, list) else []
            required = row.type == ONE_TABLE and row.default
            mark = max(marks[table], "" if required or entries else unset, key=len)
            marks[row.key + PATH_MARKS[row.type]] = mark
            lines += _wrap_comment(row.meaning, "## ")
            header = f"{row.key}.{row.example}" if row.type == BY_NAME else row.key
            header = f"[[{header}]]" if row.type == MANY_TABLES else f"[{header}]"
            for entry in entries[:-1]:  # the last one explains the keys
                lines += [header, *toml_text(entry).splitlines(), ""]
            lines.append(f"{mark}{header}")
            continue
        if value is None:
            value = _value_at(inherited or {}, row.key)
        text = (row.default or row.example) if value is None else toml_literal(value)
        text = (texts or {}).get(row.key, text)
        lines += _comment_lines(row)
        lines.append(f"{max(marks[table], unset, key=len)}{name} = {text}")
    return "\n".join(lines) + "\n"


def _value_at(data: Any, key: str) -> Any:
    """Return the value at a dotted path, `[]` for the last entry of a list; None if missing."""
    for name in key.split("."):
        data = data.get(name.removesuffix("[]")) if isinstance(data, Mapping) else None
        data = data[-1] if name.endswith("[]") and data else data
    return data


def _comment_lines(row: KeyRow) -> list[str]:
    """Format the meaning, with type, unit and limits in brackets, as a comment."""
    facts = (row.type if row.type != "number" else "", row.unit, row.limits)
    details = "; ".join(fact for fact in facts if fact)
    return _wrap_comment(f"{row.meaning} [{details}]" if details else row.meaning, "# ")


def _wrap_comment(text: str, mark: str) -> list[str]:
    return [mark + line for line in textwrap.wrap(text, 96, break_on_hyphens=False)]
