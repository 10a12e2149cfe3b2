"""Maps of the face: the paper's gallery of shapes, depth errors, force distribution."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from deltact_fab.bench import Run
from deltact_fab.common import Array
from deltact_fab.sensor import Indenter

from . import figures
from .figures import SERIES_COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

    from deltact_fab.estimate import ContactRegion, ShapeMaps


GALLERY_COLUMNS = 4  # paper: its figure has four shapes
RELIEF_LINE_MM = 0.5  # by hand: spacing of surface lines; less is black
OBJECT_TOP_MM = 4.0  # by hand: drawn height of an object above its tip
MAP_PERCENTILE = 99.5  # by hand: full scale of a map; single points do not fade the rest


def plot_gallery(pictures: Sequence[ShapeMaps], note: str) -> Figure:
    """Plot a column per press: object, image with flow, density, surface.

    Like the paper's figure of four shapes; the first GALLERY_COLUMNS presses.
    """
    maps = list(pictures)[:GALLERY_COLUMNS]
    rows = {_object: 0.75, _flow: 1.1, _density: 1.35, _surface: 0.9}
    figure, axes = figures.create_figure(
        2.5 * len(maps) + 0.1, 2.0 * sum(rows.values()) + 0.4, len(maps), share_y=False,
        rows=len(rows),
    )  # fmt: skip
    axes[0].get_gridspec().set_height_ratios(list(rows.values()))
    suffix = "" if len(maps) == len(pictures) else f"; {len(maps)} of {len(pictures)} presses"
    figure.suptitle(
        f"{note}{suffix}\narrows: flow; dotted: limit of the reliable density", fontsize="small"
    )
    for k, axis in enumerate(axes):
        row, column = divmod(k, len(maps))
        list(rows)[row](figure, axis, maps[column], column == 0)
    return figure


def plot_depth_against_truth(pictures: Sequence[ShapeMaps], note: str) -> Figure:
    """Plot a column per press: a section through the tip, and the error map.

    The first GALLERY_COLUMNS presses with truth, at least one.
    """
    compared = [p for p in pictures if p.true_depth_mm is not None][:GALLERY_COLUMNS]
    figure, axes = figures.create_figure(
        2.5 * len(compared) + 0.1, 5.2, len(compared), share_y=False, rows=2
    )
    figure.suptitle(note, fontsize="small")
    for column, picture in enumerate(compared):
        _section(axes[column], picture, column == 0)
        _error(axes[len(compared) + column], picture, column == 0)
    figures.draw_legend(figure, axes[0])
    return figure


def _object(figure: Figure, place: Axes, picture: ShapeMaps, first: bool) -> None:
    """Plot the indenter, tip upwards."""
    from matplotlib.colors import LightSource

    if picture.indenter == Run.UNKNOWN:
        place.set_axis_off()
        place.set_title("indenter unknown", fontsize="medium")
        return
    indenter = picture.indenter_shape
    half = 1.02 * _reach_mm(indenter)
    # Polar grid: smooth walls of solids of revolution.
    radius, angle = np.meshgrid(np.linspace(0, half, 91), np.linspace(0, 2 * np.pi, 73))
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    z = OBJECT_TOP_MM - np.minimum(indenter.height_mm(x, y), OBJECT_TOP_MM)
    axis = space_axes(figure, place)
    axis.plot_surface(
        x, y, z, color="#a9b8c8", lightsource=LightSource(azdeg=300, altdeg=40), rstride=1,
        cstride=1, linewidth=0, antialiased=False, rasterized=True,
    )  # fmt: skip
    axis.set(xlim=(-half, half), ylim=(-half, half), zlim=(0, OBJECT_TOP_MM))
    axis.set_box_aspect((2 * half, 2 * half, OBJECT_TOP_MM), zoom=1.5)
    axis.set_axis_off()
    axis.set_title(f"{picture.indenter}, {picture.tip_depth_mm:.2f} mm", fontweight="bold",
                   fontsize="medium")  # fmt: skip


def _reach_mm(indenter: Indenter) -> float:
    """Largest radius of the drawn part of the indenter, mm."""
    half = max(indenter.footprint_half_mm)
    x, y = np.meshgrid(*(2 * [np.linspace(-half, half, 201)]))
    return float(np.hypot(x, y)[indenter.height_mm(x, y) < OBJECT_TOP_MM].max())


def _flow(figure: Figure, axis: Axes, picture: ShapeMaps, first: bool) -> None:
    draw_flow(axis, picture)
    format_map(axis, window_mm(picture), first, last=False)


def _density(figure: Figure, axis: Axes, picture: ShapeMaps, first: bool) -> None:
    near = _window_index(picture)
    limit = max(float(np.percentile(np.abs(picture.relative[near]), MAP_PERCENTILE)), 0.02)
    draw_map(axis, picture.flow.x_mm, picture.flow.y_mm, picture.relative, "RdBu_r", -limit, limit,
               "minus density, from rest", "bottom")  # fmt: skip
    if not (reliable := picture.density.reliable)[near].all():
        axis.contour(picture.flow.x_mm, picture.flow.y_mm, reliable.astype(float), [0.5],
                     colors="#555555", linewidths=0.6, linestyles=":")  # fmt: skip
    format_map(axis, window_mm(picture), first)


def _surface(figure: Figure, place: Axes, picture: ShapeMaps, first: bool) -> None:
    """Plot the depth as a surface, deepest upwards, as in the paper."""
    from matplotlib.ticker import MultipleLocator

    axis = space_axes(figure, place)
    stride = max(1, round(RELIEF_LINE_MM / picture.flow.cell_mm))
    rows, columns = (index.ravel()[::stride] for index in _window_index(picture))
    part = picture.depth.depth_mm[np.ix_(rows, columns)]
    x, y = np.meshgrid(picture.flow.x_mm[columns], picture.flow.y_mm[rows])
    top = _deepest(picture)
    axis.plot_surface(x, y, part, cmap="viridis", vmin=0, vmax=top, rstride=1, cstride=1,
                      linewidth=0.15, edgecolor="#33333366", rasterized=True)  # fmt: skip
    axis.set_box_aspect((np.ptp(x), np.ptp(y), 6), zoom=1.3)
    axis.set_zlim(min(0.0, float(part.min())), top)
    axis.set_zticks([0, round(top, 1)])
    for side in (axis.xaxis, axis.yaxis):
        side.set_major_locator(MultipleLocator(5))
    axis.set_title(f"measured, to {float(part.max()):.2f} mm", fontsize=TITLE_SIZE, y=1.03)


def _section(axis: Axes, picture: ShapeMaps, first: bool) -> None:
    """Plot depth along x through the tip: measured, true, and the object."""
    assert picture.true_depth_mm is not None, "a press with truth"
    row = int(np.argmin(np.abs(picture.flow.y_mm - picture.tip_mm[1])))
    x = picture.flow.x_mm
    line_x = np.linspace(x[0], x[-1], 801)
    height = picture.indenter_shape.height_mm(line_x - picture.tip_mm[0], np.zeros_like(line_x))
    height[height > OBJECT_TOP_MM] = np.nan
    axis.plot(line_x, picture.tip_mm[2] + height, color=figures.SOFT_COLOUR, lw=1, label="object")
    axis.plot(
        x, -picture.true_depth_mm[row], color=SERIES_COLOURS[4], ls="--", lw=1.5, label="true face"
    )
    axis.plot(
        x, -picture.depth.depth_mm[row], color=SERIES_COLOURS[0], lw=1.5, label="measured face"
    )
    axis.set_xlim(*window_mm(picture)[0])
    axis.set_ylim(-1.2 * _deepest(picture), 0.35 * _deepest(picture))
    axis.set_title(f"{picture.indenter}, {picture.tip_depth_mm:.2f} mm", fontweight="bold",
                   fontsize="medium")  # fmt: skip
    axis.tick_params(labelsize=TICK_SIZE)
    axis.set_xlabel(f"x, mm, at y = {picture.tip_mm[1]:.1f} mm", fontsize=LABEL_SIZE)
    if first:
        axis.set_ylabel("height of the face, mm", fontsize=LABEL_SIZE)


def _error(axis: Axes, picture: ShapeMaps, first: bool) -> None:
    error = picture.depth.depth_mm - picture.true_depth_mm
    limit = max(float(np.percentile(np.abs(error[_window_index(picture)]), MAP_PERCENTILE)), 0.02)
    draw_map(axis, picture.flow.x_mm, picture.flow.y_mm, error, "PuOr", -limit, limit,
               "measured - true depth, mm", "bottom")  # fmt: skip
    draw_outlines(axis, picture.contacts, "black")
    draw_true_contact(axis, picture, SERIES_COLOURS[4])
    axis.plot([], [], color=figures.INK_COLOUR, lw=1.3, label="measured contact")
    axis.plot([], [], color=SERIES_COLOURS[4], lw=1.3, ls="--", label="true contact")
    format_map(axis, window_mm(picture), first)


def _deepest(picture: ShapeMaps) -> float:
    true = picture.true_depth_mm
    parts = [picture.depth.depth_mm] + ([] if true is None else [true])
    return max(0.1, *(float(part.max()) for part in parts))


def _window_index(picture: ShapeMaps) -> tuple[Array, ...]:
    """Index of the shown part of a map."""
    sides = zip((picture.flow.x_mm, picture.flow.y_mm), window_mm(picture), strict=True)
    columns, rows = (np.flatnonzero((v >= low) & (v <= high)) for v, (low, high) in sides)
    return np.ix_(rows, columns)


KPA_PER_MPA = 1e3  # exact
MIN_KPA = 2.0  # by hand: smallest full scale; less shows noise
FORCE_PERCENTILE = 98  # by hand: full scale; single nodes at an edge do not darken the rest
FORCE_MAP = "magma"


def plot_distribution(picture: ShapeMaps, note: str) -> Figure:
    """Plot measured forces above, true ones below if known, on one scale; needs tractions."""
    fields = [
        (words, x_mm, y_mm, -KPA_PER_MPA * mpa[..., 2], KPA_PER_MPA * mpa[..., :2])
        for words, (x_mm, y_mm, mpa) in picture.tractions
    ]
    figure, axes = figures.create_figure(
        9.8, 3.05 * len(fields) + 0.8, 3, share_y=False, rows=len(fields)
    )
    figure.suptitle(f"{note}\n{_force_words(picture)}", fontsize="small")
    pressure = max(MIN_KPA, *(_full_scale(field[3]) for field in fields))
    shear = max(MIN_KPA, *(_full_scale(np.hypot(*np.moveaxis(f[4], -1, 0))) for f in fields))
    for k, (words, x_mm, y_mm, normal_kpa, shear_kpa) in enumerate(fields):
        flow_axis, normal_axis, shear_axis = axes[3 * k : 3 * k + 3]
        last = k == len(fields) - 1
        (_depth if k else draw_flow)(flow_axis, picture)
        format_map(flow_axis, window_mm(picture), last=last)
        draw_map(normal_axis, x_mm, y_mm, normal_kpa, FORCE_MAP, 0, pressure, "pressure, kPa")
        normal_axis.set_title(f"normal force, {words}", fontsize=TITLE_SIZE)
        size = np.hypot(shear_kpa[..., 0], shear_kpa[..., 1])
        draw_map(shear_axis, x_mm, y_mm, size, FORCE_MAP, 0, shear, "shear, kPa")
        draw_arrows(shear_axis, x_mm, y_mm, shear_kpa, picture.tip_mm, shear)
        shear_axis.set_title(f"shear force, {words}", fontsize=TITLE_SIZE)
        for axis in (normal_axis, shear_axis):
            axis.set_facecolor("black")  # outside of the estimate
            if words == "true":
                draw_true_contact(axis, picture, "white", "-")
            else:
                draw_outlines(axis, picture.contacts)
            format_map(axis, window_mm(picture), False, last)
    return figure


def _full_scale(values: Array) -> float:
    """Full scale of the loaded values."""
    loaded = values[values > 0.02 * values.max(initial=0)]
    return float(np.percentile(loaded, FORCE_PERCENTILE)) if loaded.size else 0.0


def _depth(axis: Axes, picture: ShapeMaps) -> None:
    top = max(float(picture.depth.depth_mm.max()), MIN_ARROW_MM)
    draw_map(
        axis,
        picture.flow.x_mm,
        picture.flow.y_mm,
        picture.depth.depth_mm,
        "viridis",
        0,
        top,
        "depth, mm",
    )
    draw_outlines(axis, picture.contacts)
    draw_true_contact(axis, picture, SERIES_COLOURS[1])
    axis.set_title("depth (true contact dashed)", fontsize=TITLE_SIZE)


def _force_words(picture: ShapeMaps) -> str:
    """Total forces in words: estimated and measured."""
    parts, wrench = [], picture.wrench
    totals = [] if wrench is None else [("estimated", wrench.force_n, float(wrench.torque_nmm[2]))]
    for words, force, torque in (*totals, ("force sensor", picture.force_n, picture.torque_z_nmm)):
        if force is not None:
            x, y, z = (float(v) + 0.0 for v in np.round(force, 2))
            about = "" if torque is None else f", torque about z {round(torque, 1) + 0.0:.1f} N mm"
            parts.append(f"{words}: normal {-z:.2f} N, shear ({x:.2f}, {y:.2f}) N{about}")
    title = f"{picture.indenter} at ({picture.tip_mm[0]:.1f}, {picture.tip_mm[1]:.1f}) mm, "
    return "\n".join([title + f"{picture.tip_depth_mm:.2f} mm deep", *parts])


# -- parts of these figures: around a press, in the camera's orientation ---------------------------

HALF_MM = 8.0
"""By hand: half width of the shown face around the tip; clipped to the view."""
ARROW_STEP_MM = 1.5
"""By hand: arrow spacing, sparse as in the paper's force distribution."""
MIN_ARROW_MM = 0.02  # by hand: smallest full scale; less shows noise
ARROW_COLOUR = "#7fe0ff"
TICK_SIZE, LABEL_SIZE, TITLE_SIZE = "x-small", "small", "small"
"""Font sizes, relative to that of page or paper."""

Window = Sequence[Sequence[float] | Array]
"""Shown limits (low, high) in x and in y."""


def window_mm(picture: ShapeMaps) -> Window:
    """Shown part of the face around a press."""
    assert picture.edges_mm is not None, "a press with an image"
    x0, x1, y0, y1 = picture.edges_mm
    limits = zip(picture.tip_mm[:2], (x0, y0), (x1, y1), strict=True)
    return [np.clip([mid - HALF_MM, mid + HALF_MM], low, high) for mid, low, high in limits]


def format_map(axis: Axes, window: Window, first: bool = True, last: bool = True) -> None:
    """Set limits and labels of a map; first in its row, last in its column."""
    from matplotlib.ticker import MultipleLocator

    axis.grid(visible=False)
    axis.tick_params(labelsize=TICK_SIZE)
    for side in (axis.xaxis, axis.yaxis):
        side.set_major_locator(MultipleLocator(5))
    axis.set(xlim=window[0], ylim=window[1][::-1], aspect="equal")
    if last:
        axis.set_xlabel("x, mm", fontsize=LABEL_SIZE)
    if first:
        axis.set_ylabel("y, mm", fontsize=LABEL_SIZE)


def draw_map(
    axis: Axes, x_mm: Array, y_mm: Array, values: Array, colours: str, low: float, high: float,
    words: str, side: str = "right",
) -> None:  # fmt: skip
    """Draw values at points as cells, with a colour bar at a side; NaN is blank."""
    mesh = axis.pcolormesh(
        x_mm, y_mm, values, cmap=colours, vmin=low, vmax=high, shading="nearest", rasterized=True
    )
    bar = axis.figure.colorbar(mesh, ax=axis, location=side, shrink=0.8, aspect=16, pad=0.02)
    bar.ax.tick_params(labelsize=TICK_SIZE)
    bar.set_label(words, fontsize=LABEL_SIZE)
    assert bar.solids is not None, "of a map"
    bar.solids.set_edgecolor("face")  # no seams
    bar.solids.set_rasterized(False)  # as an image it would have the id of any other panel's


def draw_flow(axis: Axes, picture: ShapeMaps) -> None:
    """Draw the darkened camera image with flow arrows."""
    assert picture.image is not None, "a press with an image"
    assert picture.edges_mm is not None, "with it"
    rgb = (picture.image[..., ::-1].astype(float) * 0.6).astype(np.uint8)
    x0, x1, y0, y1 = picture.edges_mm
    axis.imshow(rgb, extent=(x0, x1, y1, y0), interpolation="antialiased")
    shift_mm = np.where(picture.flow.known[..., None], picture.flow.shift_mm, np.nan)
    longest_mm = draw_arrows(axis, picture.flow.x_mm, picture.flow.y_mm, shift_mm, picture.tip_mm)
    axis.set_title(f"flow, at most {longest_mm:.2f} mm", fontsize=TITLE_SIZE)


def draw_arrows(
    axis: Axes, x_mm: Array, y_mm: Array, vectors: Array, middle: Array, peak: float | None = None
) -> float:
    """Draw vectors (h, w, 2), NaN if unknown, at points ARROW_STEP_MM apart, one in the middle.

    peak: vector length of two spacings, default the largest. Returns it.
    """
    from scipy.interpolate import RegularGridInterpolator

    if peak is None:
        peak = float(np.nanmax(np.hypot(vectors[..., 0], vectors[..., 1]), initial=MIN_ARROW_MM))
    x, y = (
        np.arange(c - ARROW_STEP_MM * ((c - side[0]) // ARROW_STEP_MM), side[-1], ARROW_STEP_MM)
        for side, c in zip((x_mm, y_mm), middle, strict=False)
    )
    grid_mm = np.stack(np.meshgrid(y, x, indexing="ij"), axis=-1)
    part = RegularGridInterpolator((y_mm, x_mm), vectors.astype(float))(grid_mm)
    part[np.hypot(part[..., 0], part[..., 1]) < 0.02 * peak] = np.nan
    axis.quiver(x, y, part[..., 0], part[..., 1], color=ARROW_COLOUR, angles="xy", units="inches",
                scale_units="xy", scale=peak / (2 * ARROW_STEP_MM), width=0.013)  # fmt: skip
    return peak


def draw_outlines(axis: Axes, contacts: Iterable[ContactRegion], colour: str = "white") -> None:
    for line_mm in (contact.outline_mm for contact in contacts):
        axis.plot(*np.vstack((line_mm, line_mm[:1])).T, color=colour, lw=1.3)


def draw_true_contact(axis: Axes, picture: ShapeMaps, colour: str, style: str = "--") -> None:
    """Draw the outline of the true contact, if known."""
    x_mm, y_mm, true = picture.flow.x_mm, picture.flow.y_mm, picture.true_contact
    if true is not None and true.any():
        axis.contour(x_mm, y_mm, true.astype(float), [0.5], colors=colour,
                     linewidths=1.3, linestyles=style)  # fmt: skip


def space_axes(figure: Figure, place: Axes) -> Axes3D:
    """Create 3D axes in place of flat ones, which keep their letter."""
    place.set_axis_off()
    axis = figure.add_subplot(place.get_subplotspec(), projection="3d")
    axis.view_init(elev=35, azim=-60)
    axis.tick_params(labelsize=TICK_SIZE, pad=-3)
    return axis
