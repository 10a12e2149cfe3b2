"""The figure of `gel fit --plot`; the file's place is checked before anything is solved."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..extras import require
from ..files import write_together

if TYPE_CHECKING:
    from .fit.fit import GelFit

KINDS = ("png", "svg", "pdf")
DPI = 150
BLUE = "#0072B2"


def require_place(path: Path) -> None:
    """Raises MissingLibrary without matplotlib, InputError for a file that could not be written."""
    require("report", "--plot", "matplotlib")
    if _kind(path) not in KINDS:
        raise InputError(f"--plot {path}: {', '.join('.' + k for k in KINDS)} is needed")
    if path.is_dir():
        raise InputError(f"--plot {path}: a folder; a file's name is needed")
    if not path.absolute().parent.is_dir():
        raise InputError(f"--plot {path}: there is no folder {path.parent}")


def _kind(path: Path) -> str:
    return path.suffix.lower().lstrip(".")


def save_fit(fit: GelFit, path: Path, title: str) -> None:
    """Data and model, and the residuals below. Raises InputError where the place refuses."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 5.6), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1))
    used, x = fit.used, fit.depth_mm
    order = np.argsort(x, kind="stable")
    top.plot(x[used], fit.measured_n[used], ".", color=BLUE, ms=4, alpha=0.6, label="measured")
    top.plot(x[order], fit.model_n[order], "-", color=BLUE, lw=1.4, label="model")
    bottom.plot(x[used], (fit.measured_n - fit.model_n)[used], ".", color=BLUE, ms=3)
    if not used.all():
        top.plot(x[~used], fit.measured_n[~used], "x", color="#000000", ms=5, label="left out")
    bottom.set_xlabel("depth below first touch / mm")
    top.set_ylabel("normal force / N")
    bottom.set_ylabel("data - model / N")
    bottom.axhline(0, color="#666666", linewidth=0.8)
    e = fit.modulus_mpa
    text = f"E = {e.value:.4g} MPa (95 %: {e.low:.4g} to {e.high:.4g})"
    top.set_title(f"{title}\n{text}", fontsize=9.5, loc="left")
    top.legend(frameon=False, fontsize=9)
    for axes in (top, bottom):
        axes.grid(color="#dddddd", linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    # Without the date, so that the same fit is the same file.
    dates: dict[str, Any] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    kind, drawn = _kind(path), io.BytesIO()
    figure.savefig(drawn, format=kind, dpi=DPI, metadata=dates.get(kind))
    write_together({path: drawn.getvalue()})
