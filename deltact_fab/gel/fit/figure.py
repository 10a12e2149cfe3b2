"""The figure of `gel fit --plot`: data and model, and the residuals below them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..figure_file import require_place, save
from .fit import GelFit

LABELS = ("normal", "side force x", "side force y")
COLOURS = ("#0072B2", "#D55E00", "#009E73")


def save_figure(fit: GelFit, path: Path, title: str) -> None:
    """Draw to a file; raises what `figure_file.save` raises."""
    require_place(path)
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 5.6), layout="constrained")
    side = bool((fit.channel > 0).any())
    # Over depth a drag would stand on one spot.
    order = np.arange(len(fit.channel))
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1))
    for c in np.unique(fit.channel):
        here = fit.channel == c
        x = np.arange(int(here.sum())) + _first(fit, c) if side else fit.depth_mm[here]
        _draw(top, bottom, fit, order[here], x, int(c))
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
        axes.grid(color="#dddddd", linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    save(figure, path)


def _first(fit: GelFit, channel: int) -> int:
    """Number of the first row with a side force: those rows are the last of the file."""
    return int((fit.channel == 0).sum() - (fit.channel == channel).sum())


def _draw(top: Any, bottom: Any, fit: GelFit, rows: Any, x: Any, channel: int) -> None:
    colour, used = COLOURS[channel], fit.used[rows]
    measured, model = fit.measured_n[rows], fit.model_n[rows]
    along = np.argsort(x, kind="stable")
    name = LABELS[channel]
    top.plot(x[used], measured[used], ".", color=colour, ms=4, alpha=0.6, label=f"{name}, measured")
    top.plot(x[along], model[along], "-", color=colour, lw=1.4, label=f"{name}, model")
    bottom.plot(x[used], (measured - model)[used], ".", color=colour, ms=3)
    if not used.all():
        top.plot(x[~used], measured[~used], "x", color="#000000", ms=5, label="left out")
