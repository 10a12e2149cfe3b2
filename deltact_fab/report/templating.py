"""The one way from a template to a page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from .. import record
from ..errors import InputError
from ..extras import require
from .tidy import tidied


def require_pages() -> None:
    """Raises MissingLibrary without the extra `report`; call it before the work for a page."""
    require("report", "a page", "jinja2", "matplotlib")


def environment(**filters: Callable[..., str]) -> Any:
    """A jinja2 environment over this package's templates, with the filters given.

    A name that a template does not find is an error. Raises MissingLibrary without the extra
    `report`.
    """
    require_pages()
    import jinja2

    made = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters.update(filters, named=named)
    return made


# Of a key or a column: what its last part says of the unit.
_UNITS = {
    "mm": "mm", "mm2": "mm²", "mm3": "mm³", "cm3": "cm³", "um": "µm", "px": "px", "n": "N",
    "s": "s", "nmm": "N mm", "mpa": "MPa", "kpa": "kPa", "ms": "ms", "mb": "MB",
    "percent": "%", "deg": "°",
}  # fmt: skip


def named(key: str) -> str:
    """A key or column as a page writes it: `normal_rmse_n` is "normal rmse, N"."""
    words, _, last = key.rpartition("_")
    if words and last in _UNITS:
        return f"{words.replace('_', ' ')}, {_UNITS[last]}"
    return key.replace("_", " ")


def render(pages: Any, template: str, **values: Any) -> str:
    """The page of a template of `environment`, its tables tidied."""
    return tidied(pages.get_template(template).render(**values))


def save(page: str, out: Path) -> Path:
    """Write a page whole, into a folder that is made where it is missing.

    Raises InputError when the folder cannot be, RunFailed when the disk refuses.
    """
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
    except OSError as why:
        raise InputError(f"{out.parent}: cannot be made: {why.strerror}") from why
    record.write_whole(out, page.encode())
    return out
