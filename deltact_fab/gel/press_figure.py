"""The figure of `gel press --plot`: force along the way, and the face at its end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .figure_file import require_place, save
from .press import Pressed

ARROWS = 17  # along the longer side of the face
COLOURS = ("#D55E00", "#009E73", "#0072B2")


def save_figure(pressed: Pressed, path: Path, title: str) -> None:
    """Draw to a file; raises what `figure_file.save` raises."""
    require_place(path)
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.4, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.2))
    _forces(left, pressed)
    _face(figure, right, pressed)
    figure.suptitle(f"simulated: {title}", fontsize=10, x=0.01, ha="left")
    save(figure, path)


def _forces(axes: Any, pressed: Pressed) -> None:
    tips, forces = pressed.tips_mm, pressed.forces_n
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(tips, axis=0), axis=1))])
    sheared = bool(np.any(np.ptp(tips[:, :2], axis=0) > 0))
    if sheared:
        axes.plot(way, forces[:, 0], ".-", color=COLOURS[0], ms=4, label="side force x")
        axes.plot(way, forces[:, 1], ".-", color=COLOURS[1], ms=4, label="side force y")
        down = float(tips[:, 2].max())
        axes.axvline(down, color="#666666", lw=0.8)
        axes.annotate(
            "shear starts", (down, 0), (3, 4), xycoords=("data", "axes fraction"),
            textcoords="offset points", fontsize=8, color="#444444",
        )  # fmt: skip
    axes.plot(way, -forces[:, 2], ".-", color=COLOURS[2], ms=4, label="normal force")
    axes.set_xlabel("way of the tip: depth, then shear / mm" if sheared else "depth / mm")
    axes.set_ylabel("force on the sensor / N")
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9)


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
    axes.plot(tip[0], tip[1], "+", color="#D55E00", ms=9)
    axes.set_xlabel("x / mm")
    axes.set_ylabel("y / mm")
    axes.set_aspect("equal")
    peak = float(size.max())
    axes.set_title(f"face at depth {tip[2]:g} mm, at most {peak:.3g} mm in plane", fontsize=9)
