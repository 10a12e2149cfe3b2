"""Figures of the report, drawn by matplotlib as SVG text that needs no other file."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from itertools import cycle, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MissingLibrary

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..analysis.tracking_error import Verdict

# Okabe and Ito's palette: told apart by people who see colours differently.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#000000")
PAPER_COLOUR = "#666666"
NAME_WIDTH_PT, NAME_HEIGHT_PT = 130, 10  # of a method's name beside its mark
FRONT_COLOUR = "#d9e2ec"
ARROW_BGR = (90, 235, 255)


def blank(width: float, height: float, panels: int = 1, share_y: bool = True, rows: int = 1) -> Any:
    """A figure and its axes side by side, row by row, drawn without a display."""
    try:
        import matplotlib
    except ImportError as why:
        raise MissingLibrary("figures need matplotlib: pip install 'deltact-fab[report]'") from why
    matplotlib.rcParams.update(
        {
            "svg.hashsalt": "deltact-fab",  # same figure, same bytes
            "svg.fonttype": "none",
            "font.family": "sans-serif",
            "font.size": 9.5,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.grid": True,
            "grid.color": "#dddddd",
            "grid.linewidth": 0.6,
            "axes.axisbelow": True,
            "legend.frameon": False,
        }
    )
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, panels, sharey=share_y, squeeze=False)
    return figure, list(axes.flat)


def to_svg(figure: Figure) -> str:
    """The figure as an <svg> element, without the prologue and without a date."""
    out = io.StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    text = out.getvalue()
    svg = text[text.index("<svg") :]
    # Several figures share one page: an id must not meet its namesake in another figure.
    salt = f"f{abs(hash_text(svg)):x}"
    svg = re.sub(r'\bid="', f'id="{salt}-', svg)
    svg = re.sub(r"url\(#", f"url(#{salt}-", svg)
    return re.sub(r'href="#', f'href="#{salt}-', svg)


def hash_text(text: str) -> int:
    """A hash that does not change between processes."""
    import zlib

    return zlib.crc32(text.encode())


def _label(name: str) -> str:
    method, _, reference = name.partition("/")
    words = {"farneback": "Farneback", "dis-medium": "DIS medium", "dis-fast": "DIS fast",
             "paper": "as the paper has it"}  # fmt: skip
    shown = words.get(method, method)
    notes = {
        "static": "static reference",
        "summed-every": "summed, every frame",
        "composed-every": "composed, every frame",
    }
    return f"{shown}, {notes.get(reference, reference)}" if reference else shown


def by_step(
    frames: pd.DataFrame, methods: Sequence[str], column: str, words: str, log: bool = True
) -> Figure:
    """A column of the table of frames against the frame, a panel an indenter."""
    indenters = list(dict.fromkeys(frames["indenter"]))
    figure, axes = blank(9.6, 3.6, len(indenters))
    for axis, indenter in zip(axes, indenters, strict=True):
        part = frames[frames["indenter"] == indenter]
        for colour, name in zip(cycle(COLOURS), methods, strict=False):
            rows = part[part["method"] == name].sort_values("seq")
            index = np.arange(1, len(rows) + 1)
            axis.plot(index, rows[column].astype(float), color=colour, lw=1.4, label=_label(name),
                      ls="-" if "/" not in name else "--")  # fmt: skip
        mark_legs(axis, part[part["method"] == methods[0]].sort_values("seq"))
        axis.set_xlabel("frame")
        axis.set_title(indenter, loc="left", fontweight="bold")
    axes[0].set_ylabel(words)
    if log:
        log_ticks(axes[0], "y")
    # Room for the names of the legs.
    low, high = axes[0].get_ylim()
    axes[0].set_ylim(low, high * (high / low) ** 0.15 if log else high + 0.15 * (high - low))
    legend_below(figure, axes[-1])
    return figure


def legend_below(figure: Figure, axis: Axes) -> None:
    """What the marks of an axis mean, under all of them."""
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=3,
                  fontsize=8.5)  # fmt: skip


def log_ticks(axis: Axes, which: str) -> None:
    """Logarithmic axes that are labelled 0.01, 0.02, 0.05 and not by powers."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    for letter in which:
        (axis.set_xscale if letter == "x" else axis.set_yscale)("log")
        side = axis.xaxis if letter == "x" else axis.yaxis
        side.set_major_locator(LogLocator(base=10, subs=(1.0, 2.0, 5.0)))
        side.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
        side.set_minor_locator(LogLocator(base=10, subs=()))


MOST_LEGS = 20


def mark_legs(axis: Axes, rows: pd.DataFrame) -> None:
    """Name the legs of the path above the curve, where they begin."""
    legs = [step.rsplit("/", 1)[-1] for step in rows["step_id"]]
    if sum(a != b for a, b in pairwise(legs)) > MOST_LEGS:
        return  # no one could read them
    for i, leg in enumerate(legs):
        if i == 0 or leg != legs[i - 1]:
            axis.axvline(i + 0.5, color="#bbbbbb", lw=0.7)
            axis.text(i + 0.8, 1.0, leg.replace("shear-", ""), transform=axis.get_xaxis_transform(),
                      fontsize=7.5, color="#666666", va="top", rotation=90)  # fmt: skip


def error_by_time(
    methods: Sequence[dict[str, Any]], verdict: Verdict, paper_mm: float, simulated: bool
) -> Figure | None:
    """Error against CPU time a frame, one mark a method, and the front of those to be believed.

    None without any error.
    """
    error = verdict.error
    if error is None:
        return None
    rows = [row for row in methods if row[error] is not None]
    figure, (axis,) = blank(9.6, 4.2)
    at_front = {row["name"]: row for row in rows if row["name"] in verdict.front}
    front = [at_front[name] for name in verdict.front]
    times = [row["cpu_ms"]["p50"] for row in rows]
    left_ms, right_ms = min(times) / 1.6, max(times) * 2.2
    if front:
        # Down and to the right in steps: what each time buys.
        x = [row["cpu_ms"]["p50"] for row in front]
        y = [row[error] for row in front]
        axis.step([*x, right_ms], [*y, y[-1]], where="post", color=FRONT_COLOUR, lw=5, zorder=0,
                  label="the front: no other one beats it in both")  # fmt: skip
    names = []
    for colour, row in zip(cycle(COLOURS), methods, strict=False):
        if row not in rows:
            continue
        x_ms, y_mm = row["cpu_ms"]["p50"], row[error]
        believed = not verdict.doubts[row["name"]]
        axis.plot(x_ms, y_mm, "o" if believed else "x", color=colour, ms=8, mew=1.8)
        at_dots = row["mean_at_dots_mm"]
        if at_dots is not None and error != "mean_at_dots_mm":
            axis.plot(x_ms, at_dots, "s", color=colour, mfc="none", ms=6, mew=1.2)
        names.append((x_ms, y_mm, row["name"], colour))
    axis.axhline(paper_mm, color=PAPER_COLOUR, lw=1.2, ls=":",
                 label=f"paper, at the dots, real sensor: {paper_mm} mm")  # fmt: skip
    log_ticks(axis, "xy")
    axis.set_xlim(left_ms, right_ms)
    axis.set_xlabel("CPU milliseconds a frame, median, one thread")
    axis.set_ylabel("mean error, mm" + (", simulated" if simulated else ""))
    for marker, face, words in (
        ("o", "#444444", f"{verdict.error_words}, can be believed"),
        ("x", "#444444", "cannot be believed"),
        ("s", "none", "at the dots"),
    ):
        axis.plot([], [], marker, color="#444444", mfc=face, label=words)
    legend_below(figure, axis)
    _write_names(figure, axis, names, verdict.take)
    return figure


def _write_names(
    figure: Figure,
    axis: Axes,
    names: Sequence[tuple[float, float, str, str]],
    bold: str | None,
) -> None:
    """Names beside their marks (x, y, name, colour), each above those that it would cover."""
    figure.draw_without_rendering()  # the layout says how many points lie between two marks
    written: list[tuple[float, float]] = []
    for x, y, name, colour in sorted(names, key=lambda mark: mark[1]):
        at_x, at_y = axis.transData.transform((x, y)) * 72 / figure.dpi
        up = 4.0
        while any(abs(at_x - a) < NAME_WIDTH_PT and abs(at_y + up - b) < NAME_HEIGHT_PT
                  for a, b in written):  # fmt: skip
            up += 1.0
        written.append((at_x, at_y + up))
        axis.annotate(_label(name), (x, y), xytext=(8, up), textcoords="offset points",
                      fontsize=8.5, color=colour,
                      fontweight="bold" if name == bold else None)  # fmt: skip


def error_by_indenter(
    rows: Sequence[dict[str, Any]], verdict: Verdict, paper_mm: float
) -> Figure | None:
    """Bars a method, grouped by indenter, of the error that was judged; None without any."""
    error = verdict.error
    if error is None:
        return None
    indenters = list(dict.fromkeys(r["indenter"] for r in rows))
    names = list(dict.fromkeys(r["name"] for r in rows))
    found = {(r["name"], r["indenter"]): r[error] for r in rows}
    figure, (axis,) = blank(9.6, 3.6)
    width = 0.8 / len(names)
    for i, (name, colour) in enumerate(zip(names, cycle(COLOURS), strict=False)):
        known = [(k, found[name, n]) for k, n in enumerate(indenters) if found[name, n] is not None]
        at = np.array([k for k, _ in known]) + (i - (len(names) - 1) / 2) * width
        axis.bar(at, [v for _, v in known], width * 0.9, color=colour, label=_label(name))
        for x, (_, value) in zip(at, known, strict=True):
            axis.text(x, value, f"{value:.2g}", ha="center", va="bottom", fontsize=7.5)
    axis.axhline(
        paper_mm, color=PAPER_COLOUR, lw=1.2, ls=":", label=f"paper: {paper_mm} mm, at dots"
    )
    axis.set_xticks(np.arange(len(indenters)), indenters)
    axis.set_ylabel(f"mean error, mm ({verdict.error_words})")
    axis.grid(axis="x", visible=False)
    legend_below(figure, axis)
    return figure


def force_by_frame(frames: pd.DataFrame) -> Figure:
    """Measured force on the sensor against the frame, a panel an indenter."""
    indenters = list(dict.fromkeys(frames["indenter"]))
    figure, axes = blank(9.6, 3.0, len(indenters))
    for axis, indenter in zip(axes, indenters, strict=True):
        part = frames[frames["indenter"] == indenter].reset_index(drop=True)
        index = np.arange(len(part))
        for colour, column, label in zip(
            COLOURS, ("fx_n", "fy_n", "fz_n"), ("$F_x$", "$F_y$", "$F_z$"), strict=False
        ):
            axis.plot(index, part[column], color=colour, lw=1.4, label=label)
        mark_legs(axis, part)
        axis.set_title(indenter, loc="left", fontweight="bold")
        axis.set_xlabel("frame")
    axes[0].set_ylabel("force on the sensor, N")
    axes[-1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def flow_picture(
    image: NDArray[np.uint8], arrows: NDArray[np.float32], step_px: int, gain: float
) -> NDArray[np.uint8]:
    """(h, w, 3) BGR with the flow drawn as arrows, `gain` times as long as the motion."""
    import cv2

    out = (image * 0.5).astype(np.uint8)
    half = step_px // 2
    for i in range(arrows.shape[0]):
        for j in range(arrows.shape[1]):
            u, v = (float(c) for c in arrows[i, j])
            if u * u + v * v < 0.25:
                continue
            x, y = half + j * step_px, half + i * step_px
            tip = (round((x + gain * u) * 8), round((y + gain * v) * 8))
            cv2.arrowedLine(out, (x * 8, y * 8), tip, ARROW_BGR, 2, cv2.LINE_AA, 3, 0.3)
    return out
