"""New files of a lab, with every key that they can have, explained."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import catalog
from ..errors import InputError, did_you_mean
from ..schema import KINDS, Kind, commented
from ..schema.document import described
from .folder import SCHEMAS, schema_line

if TYPE_CHECKING:
    from ..rig.new import RigFileContents


def protocol(name: str, source: str = "smoke", out: Path | None = None) -> Path:
    """Write a protocol that begins as another one does, and return its file.

    Raises InputError as `catalog.write_new`, and for a name or a source that is none.
    """
    from ..protocols import plan

    _, path = plan.load(source)
    text = f"As {source}; say here what the experiment is for."
    given = {**catalog.read(path), "name": name, "description": text}
    about = (
        f"An indentation experiment, begun from {source!r}. Places count from the centre of the",
        "resting face: x along its width, y along its length, z out of it. Afterwards:",
        f"    deltact-fab protocol check {name}",
        f"    deltact-fab protocol show {name}",
        f"    deltact-fab run {name} --rig virtual --out {name}-run",
    )
    return _write("protocol", plan.Protocol, name, out, given, about)


def design(name: str, base: str = "deltact", out: Path | None = None) -> Path:
    """Write a design that states nothing but its base, and return its file.

    Raises InputError as `catalog.write_new`, and for a name or a base that is none.
    """
    from ..cad.design import load_design
    from ..cad.dimensions import Design

    about = (
        f"A design that takes from {base!r} all that it does not set itself. Afterwards:",
        f"    deltact-fab cad check --design {name}",
        f"    deltact-fab cad export --design {name} --out parts",
        "What is assumed and not measured is to be measured, and then listed under `measured`.",
    )
    inherited = asdict(load_design(base))
    return _write("design", Design, name, out, {"base": base}, about, inherited)


def pattern(name: str, law: str = "algorithm1", out: Path | None = None) -> Path:
    """Write a recipe with the keys that its law takes, and return its file.

    Raises InputError as `catalog.write_new`, and for a name or a law that is none.
    """
    from ..patterns.laws import LAWS
    from ..patterns.laws.law import KEYS
    from ..patterns.recipe import DEFAULT_SEED, PatternRecipe

    if law not in LAWS:
        raise InputError(f"--law {law!r}: no such law; {did_you_mean(law, LAWS)}")
    taken = LAWS[law].needs + LAWS[law].may
    keys = described(KINDS["pattern"])["properties"]
    given: dict[str, Any] = {"law": law, "seed": DEFAULT_SEED}
    for key in LAWS[law].needs:
        # White dots show the white layer behind: on clear film there is none.
        black = {"colour": "#000000"}
        given[key] = black if key == "dots" else keys[key]["examples"][0]
    about = (
        f"A sticker of law {law}: {LAWS[law].about}. Afterwards:",
        f"    deltact-fab pattern quality {name}",
        f"    deltact-fab pattern make {name} -o {name}.png",
        f"    deltact-fab pattern sheet {name} -o {name}.pdf",
    )
    out_of_place = set(KEYS) - set(taken)
    return _write("pattern", PatternRecipe, name, out, given, about, leave_out=out_of_place)


def rig(name: str, out: Path | None = None) -> RigFileContents:
    """Write a rig file for the devices of this computer, and return what was found.

    Raises InputError and RunFailed as `rig.new.new`, and InputError for a name that is none.
    """
    from ..rig.new import new

    return new(_file(KINDS["grbl-rig"], name, out))


def _file(kind: Kind, name: str, out: Path | None) -> Path:
    """Where a new file of a kind goes. Raises InputError for a path in place of a name."""
    if not name or Path(name).name != name or name.endswith(".toml") or not name.isprintable():
        raise InputError(f"{name!r}: expected a name, as in mine; -o FILE.toml says where it goes")
    folder = Path(kind.catalogue)
    return out or (folder if folder.is_dir() else Path()) / f"{name}.toml"


def _write(
    kind_name: str,
    model: type,
    name: str,
    out: Path | None,
    given: Mapping[str, Any],
    about: Sequence[str],
    inherited: Mapping[str, Any] | None = None,
    leave_out: Collection[str] = (),
) -> Path:
    kind = KINDS[kind_name]
    file = _file(kind, name, out)
    text = commented(kind, given, about, inherited, leave_out)
    data = tomllib.loads(text)
    data.pop("base", None)
    catalog.validate(model, data, name)
    if Path(SCHEMAS, f"{kind.name}.json").is_file():
        text = schema_line(kind.name, Path(SCHEMAS), file.parent) + text
    catalog.write_new(file, text)
    return file
