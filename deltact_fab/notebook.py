"""How values show themselves in a notebook: a title, a small table, a picture. HTML alone.

Text takes the notebook's own colour and plots are drawn in it, so that a dark theme reads as well;
a picture stands on white.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

WIDTH_PX, HEIGHT_PX, MARGIN_PX = 300, 170, 34


def card(title: str, rows: Mapping[str, object], picture: str = "", note: str = "") -> str:
    """The whole of a `_repr_html_`. rows: what to what is shown; None and "" are left out.

    picture: HTML, from `plot`, `image` or `drawing`.
    """
    cell = 'style="text-align:left;padding:1px 12px 1px 0;vertical-align:top;background:none"'
    table = "".join(
        f"<tr style='background:none'><td {cell}><span style='opacity:.65'>{escape(name)}</span>"
        f"</td><td {cell}>{escape(str(value))}</td></tr>"
        for name, value in rows.items()
        if value not in (None, "")
    )
    below = f"<div style='opacity:.65;margin-top:4px'>{escape(note)}</div>" if note else ""
    return (
        "<div style='display:flex;gap:20px;flex-wrap:wrap;align-items:flex-start;"
        "font:13px/1.4 system-ui,sans-serif;margin:4px 0'>"
        f"<div style='max-width:460px'><b>{escape(title)}</b>"
        "<table style='border:0;border-collapse:collapse;color:inherit;font:inherit'>"
        f"{table}</table>{below}</div>{picture}</div>"
    )


def drawing(svg: str, height_px: int = 260) -> str:
    """An SVG drawing made for paper, on white."""
    at = svg.index("<svg")
    return _on_white("image/svg+xml", svg[at:].encode(), height_px)


def image(png: bytes, height_px: int = 200) -> str:
    """A PNG."""
    return _on_white("image/png", png, height_px)


def _on_white(kind: str, data: bytes, height_px: int) -> str:
    text = base64.b64encode(data).decode()
    return (
        f"<img style='height:{height_px}px;max-width:100%;background:#fff;padding:4px;"
        f"border-radius:4px' alt='' src='data:{kind};base64,{text}'/>"
    )


def plot(x: Sequence[float], y: Sequence[float], x_label: str, y_label: str) -> str:
    """A line over axes that are labelled at their ends; values that are not finite are left out."""
    points = np.column_stack((x, y)).astype(float)
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 2:
        return ""
    (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
    share = (points - (x0, y0)) / ((x1 - x0) or 1, (y1 - y0) or 1)
    size_px = WIDTH_PX - 2 * MARGIN_PX, HEIGHT_PX - 2 * MARGIN_PX
    place = share * (1, -1) * size_px + (MARGIN_PX, HEIGHT_PX - MARGIN_PX)
    line = " ".join(f"{a:.1f},{b:.1f}" for a, b in place)
    bottom, right = HEIGHT_PX - MARGIN_PX, WIDTH_PX - MARGIN_PX

    def word(at_x: float, at_y: float, text: str, anchor: str) -> str:
        return f"<text x='{at_x}' y='{at_y}' text-anchor='{anchor}'>{escape(text)}</text>"

    words = (
        word(MARGIN_PX, bottom + 14, f"{x0 + 0.0:.3g}", "middle")
        + word(right, bottom + 14, f"{x1:.3g}", "middle")
        + word((MARGIN_PX + right) / 2, bottom + 28, x_label, "middle")
        + word(MARGIN_PX - 4, bottom, f"{y0 + 0.0:.3g}", "end")
        + word(MARGIN_PX - 4, MARGIN_PX + 4, f"{y1:.3g}", "end")
        + word(MARGIN_PX, MARGIN_PX - 12, y_label, "start")
    )
    return (
        f"<svg width='{WIDTH_PX}' height='{HEIGHT_PX}' role='img' "
        f"aria-label='{escape(y_label)} over {escape(x_label)}'>"
        "<g fill='currentColor' font-size='11' font-family='system-ui,sans-serif'>"
        f"{words}</g><path fill='none' stroke='currentColor' stroke-opacity='.4' "
        f"d='M{MARGIN_PX},{MARGIN_PX}V{bottom}H{right}'/>"
        f"<polyline fill='none' stroke='#2f7fd6' stroke-width='1.6' points='{line}'/></svg>"
    )
