"""The figures of `--plot`: a press, a fit; a file's place is checked before anything is solved."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..extras import require
from ..files import write_together

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .fit.fit import GelFit
    from .press import Pressed

KINDS = ("png", "svg", "pdf")
DPI = 150
ARROWS = 17  # along the longer side of the face
BLUE, GREEN, RED = "#0072B2", "#009E73", "#D55E00"
LABELS = ("normal", "side force x", "side force y")


def require_place(path: Path) -> None:
    """Raises MissingLibrary without matplotlib, InputError for a file that could not be written."""
    require("report", "--plot", "matplotlib")
    if _kind(path) not in KINDS:
        raise InputError(f"--plot {path}: {', '.join('.' + k for k in KINDS)} is needed")
    if path.is_dir():
        raise InputError(f"--plot {path}: a folder; a file's name is needed")
    if not path.absolute().parent.is_dir():
        raise InputError(f"--plot {path}: there is no folder {path.parent}")


def _save(figure: Figure, path: Path) -> None:
    """Write whole or not at all, without the date, where `require_place` has been."""
    kind = _kind(path)
    dates: dict[str, Any] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    drawn = io.BytesIO()
    figure.savefig(drawn, format=kind, dpi=DPI, metadata=dates.get(kind))
    write_together({path: drawn.getvalue()})


def _kind(path: Path) -> str:
    return path.suffix.lower().lstrip(".")


def save_press(pressed: Pressed, path: Path, title: str) -> None:
    """Force along the way, and the face at its end. Raises InputError where the place refuses."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.4, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.2))
    _forces(left, pressed)
    _face(figure, right, pressed)
    figure.suptitle(f"simulated: {title}", fontsize=10, x=0.01, ha="left")
    _save(figure, path)


def _forces(axes: Any, pressed: Pressed) -> None:
    tips, forces = pressed.tips_mm, pressed.forces_n
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(tips, axis=0), axis=1))])
    sheared = bool(np.any(np.ptp(tips[:, :2], axis=0) > 0))
    if sheared:
        axes.plot(way, forces[:, 0], ".-", color=RED, ms=4, label="side force x")
        axes.plot(way, forces[:, 1], ".-", color=GREEN, ms=4, label="side force y")
        down = float(tips[:, 2].max())
        axes.axvline(down, color="#666666", lw=0.8)
        axes.annotate(
            "shear starts", (down, 0), (3, 4), xycoords=("data", "axes fraction"),
            textcoords="offset points", fontsize=8, color="#444444",
        )  # fmt: skip
    axes.plot(way, -forces[:, 2], ".-", color=BLUE, ms=4, label="normal force")
    axes.set_xlabel("way of the tip: depth, then shear / mm" if sheared else "depth / mm")
    axes.set_ylabel("force on the sensor / N")
    axes.legend(frameon=False, fontsize=9)
    _plain(axes)


def _face(figure: Any, axes: Any, pressed: Pressed) -> None:
    x, y, u = pressed.x_mm, pressed.y_mm, pressed.displacement_mm
    size = np.hypot(u[..., 0], u[..., 1])
    image = axes.pcolormesh(x, y, size, cmap="viridis", shading="gouraud", rasterized=True)
    figure.colorbar(image, ax=axes, label="in-plane displacement / mm")
    every = max(1, max(u.shape[:2]) // ARROWS)
    start = every // 2
    some = (slice(start, None, every), slice(start, None, every))
    axes.quiver(
        x[some[1]], y[some[0]], u[..., 0][some], u[..., 1][some],
        color="#ffffff", pivot="tail", width=0.004,
    )  # fmt: skip
    tip = pressed.tips_mm[-1]
    axes.plot(tip[0], tip[1], "+", color=RED, ms=9)
    axes.set_xlabel("x / mm")
    axes.set_ylabel("y / mm")
    axes.set_aspect("equal")
    peak = float(size.max())
    axes.set_title(f"face at depth {tip[2]:g} mm, at most {peak:.3g} mm in plane", fontsize=9)


def save_fit(fit: GelFit, path: Path, title: str) -> None:
    """Data and model, and the residuals below. Raises InputError where the place refuses."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 5.6), layout="constrained")
    side = bool((fit.channel > 0).any())
    # Over depth a drag would stand on one spot.
    order = np.arange(len(fit.channel))
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1))
    for c in np.unique(fit.channel):
        here = fit.channel == c
        x = np.arange(int(here.sum())) + _first(fit, c) if side else fit.depth_mm[here]
        _curve(top, bottom, fit, order[here], x, int(c))
    x_label = "row of the file" if side else "depth below first touch / mm"
    bottom.set_xlabel(x_label)
    top.set_ylabel("force / N")
    bottom.set_ylabel("data - model / N")
    bottom.axhline(0, color="#666666", linewidth=0.8)
    e = fit.modulus_mpa
    text = f"E = {e.value:.4g} MPa (95 %: {e.low:.4g} to {e.high:.4g})"
    if fit.friction:
        f = fit.friction
        text += f", friction = {f.value:.3g} ({f.low:.3g} to {f.high:.3g})"
    top.set_title(f"{title}\n{text}", fontsize=9.5, loc="left")
    top.legend(frameon=False, fontsize=9)
    for axes in (top, bottom):
        _plain(axes)
    _save(figure, path)


def _first(fit: GelFit, channel: int) -> int:
    """Number of the first row with a side force: those rows are the last of the file."""
    return int((fit.channel == 0).sum() - (fit.channel == channel).sum())


def _curve(top: Any, bottom: Any, fit: GelFit, rows: Any, x: Any, channel: int) -> None:
    colour, used = (BLUE, RED, GREEN)[channel], fit.used[rows]
    measured, model = fit.measured_n[rows], fit.model_n[rows]
    along = np.argsort(x, kind="stable")
    name = LABELS[channel]
    top.plot(x[used], measured[used], ".", color=colour, ms=4, alpha=0.6, label=f"{name}, measured")
    top.plot(x[along], model[along], "-", color=colour, lw=1.4, label=f"{name}, model")
    bottom.plot(x[used], (measured - model)[used], ".", color=colour, ms=3)
    if not used.all():
        top.plot(x[~used], measured[~used], "x", color="#000000", ms=5, label="left out")


def _plain(axes: Any) -> None:
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
