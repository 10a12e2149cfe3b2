"""Maps of the face: the paper's gallery of shapes, depth against truth, and force distribution."""

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


COLUMNS = 4
RELIEF_MM = 0.5  # between the lines of a surface
PART_MM = 4.0  # of an object, above its tip
EXTREME = 99.5  # percentile of a map that is full scale: single points do not fade the rest


def plot_gallery(pictures: Sequence[ShapeMaps], note: str) -> Figure:
    """Plot a column a press: object, image with flow, density, surface.

    As the paper's figure of four shapes has it, of the first COLUMNS.
    """
    shown = list(pictures)[:COLUMNS]
    rows = {_object: 0.75, _flow: 1.1, _density: 1.35, _surface: 0.9}
    figure, axes = figures.create_figure(
        2.5 * len(shown) + 0.1, 2.0 * sum(rows.values()) + 0.4, len(shown), share_y=False,
        rows=len(rows),
    )  # fmt: skip
    axes[0].get_gridspec().set_height_ratios(list(rows.values()))
    left = "" if len(shown) == len(pictures) else f"; {len(shown)} of {len(pictures)} presses"
    figure.suptitle(
        f"{note}{left}\narrows: flow; dotted: as far as the density is reliable", fontsize="small"
    )
    for k, axis in enumerate(axes):
        row, column = divmod(k, len(shown))
        list(rows)[row](figure, axis, shown[column], column == 0)
    return figure


def plot_depth_against_truth(pictures: Sequence[ShapeMaps], note: str) -> Figure:
    """Plot a column a press: a section through the tip, and the map of the error.

    Of those with truth, COLUMNS of them; there must be one.
    """
    shown = [picture for picture in pictures if picture.true_depth_mm is not None][:COLUMNS]
    figure, axes = figures.create_figure(
        2.5 * len(shown) + 0.1, 5.2, len(shown), share_y=False, rows=2
    )
    figure.suptitle(note, fontsize="small")
    for column, picture in enumerate(shown):
        _section(axes[column], picture, column == 0)
        _error(axes[len(shown) + column], picture, column == 0)
    figures.draw_legend(figure, axes[0])
    return figure


def _object(figure: Figure, place: Axes, picture: ShapeMaps, first: bool) -> None:
    """The indenter, its tip upwards."""
    from matplotlib.colors import LightSource

    if picture.indenter == Run.UNKNOWN:
        place.set_axis_off()
        place.set_title("indenter unknown", fontsize="medium")
        return
    indenter = picture.indenter_shape
    half = 1.02 * _reach_mm(indenter)
    # Around the axis, so that the walls of what is turned come out smooth.
    radius, angle = np.meshgrid(np.linspace(0, half, 91), np.linspace(0, 2 * np.pi, 73))
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    z = PART_MM - np.minimum(indenter.height_mm(x, y), PART_MM)
    axis = solid(figure, place)
    axis.plot_surface(
        x, y, z, color="#a9b8c8", lightsource=LightSource(azdeg=300, altdeg=40), rstride=1,
        cstride=1, linewidth=0, antialiased=False, rasterized=True,
    )  # fmt: skip
    axis.set(xlim=(-half, half), ylim=(-half, half), zlim=(0, PART_MM))
    axis.set_box_aspect((2 * half, 2 * half, PART_MM), zoom=1.5)
    axis.set_axis_off()
    axis.set_title(f"{picture.indenter}, {picture.tip_depth_mm:.2f} mm", fontweight="bold",
                   fontsize="medium")  # fmt: skip


def _reach_mm(indenter: Indenter) -> float:
    """Largest distance from the axis of what is drawn of it."""
    half = max(indenter.footprint_half_mm)
    x, y = np.meshgrid(*(2 * [np.linspace(-half, half, 201)]))
    return float(np.hypot(x, y)[indenter.height_mm(x, y) < PART_MM].max())


def _flow(figure: Figure, axis: Axes, picture: ShapeMaps, first: bool) -> None:
    flow(axis, picture)
    frame(axis, window_mm(picture), first, last=False)


def _density(figure: Figure, axis: Axes, picture: ShapeMaps, first: bool) -> None:
    near = _near(picture)
    limit = max(float(np.percentile(np.abs(picture.relative[near]), EXTREME)), 0.02)
    shown(axis, picture.flow.x_mm, picture.flow.y_mm, picture.relative, "RdBu_r", -limit, limit,
               "minus density, from rest", "bottom")  # fmt: skip
    if not (known := picture.density.reliable)[near].all():
        axis.contour(picture.flow.x_mm, picture.flow.y_mm, known.astype(float), [0.5],
                     colors="#555555", linewidths=0.6, linestyles=":")  # fmt: skip
    frame(axis, window_mm(picture), first)


def _surface(figure: Figure, place: Axes, picture: ShapeMaps, first: bool) -> None:
    """The depth as a relief: what presses stands up, as in the paper."""
    from matplotlib.ticker import MultipleLocator

    axis = solid(figure, place)
    every = max(1, round(RELIEF_MM / picture.flow.cell_mm))
    rows, columns = (index.ravel()[::every] for index in _near(picture))
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
    axis.set_title(f"measured, to {float(part.max()):.2f} mm", fontsize=HEADS, y=1.03)


def _section(axis: Axes, picture: ShapeMaps, first: bool) -> None:
    """Depth along x through the tip: measured, true, and the object itself where it was put."""
    assert picture.true_depth_mm is not None, "of those with truth"
    row = int(np.argmin(np.abs(picture.flow.y_mm - picture.tip_mm[1])))
    x = picture.flow.x_mm
    beside = np.linspace(x[0], x[-1], 801)
    height = picture.indenter_shape.height_mm(beside - picture.tip_mm[0], np.zeros_like(beside))
    height[height > PART_MM] = np.nan
    axis.plot(beside, picture.tip_mm[2] + height, color=figures.SOFT, lw=1, label="the object")
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
    axis.tick_params(labelsize=TICKS)
    axis.set_xlabel(f"x, mm, at y = {picture.tip_mm[1]:.1f} mm", fontsize=LABELS)
    if first:
        axis.set_ylabel("height of the face, mm", fontsize=LABELS)


def _error(axis: Axes, picture: ShapeMaps, first: bool) -> None:
    error = picture.depth.depth_mm - picture.true_depth_mm
    limit = max(float(np.percentile(np.abs(error[_near(picture)]), EXTREME)), 0.02)
    shown(axis, picture.flow.x_mm, picture.flow.y_mm, error, "PuOr", -limit, limit,
               "measured - true depth, mm", "bottom")  # fmt: skip
    outlines(axis, picture.contacts, "black")
    true_contact(axis, picture, SERIES_COLOURS[4])
    axis.plot([], [], color=figures.INK_COLOUR, lw=1.3, label="contact found")
    axis.plot([], [], color=SERIES_COLOURS[4], lw=1.3, ls="--", label="true contact")
    frame(axis, window_mm(picture), first)


def _deepest(picture: ShapeMaps) -> float:
    true = picture.true_depth_mm
    parts = [picture.depth.depth_mm] + ([] if true is None else [true])
    return max(0.1, *(float(part.max()) for part in parts))


def _near(picture: ShapeMaps) -> tuple[Array, ...]:
    """What is shown of a map, as its index."""
    sides = zip((picture.flow.x_mm, picture.flow.y_mm), window_mm(picture), strict=True)
    columns, rows = (np.flatnonzero((at >= low) & (at <= high)) for at, (low, high) in sides)
    return np.ix_(rows, columns)


KPA = 1e3  # of an MPa
MIN_KPA = 2.0  # full scale at the least
FORCE_EXTREME = 98  # percentile that is full scale
DARK = "magma"


def plot_distribution(picture: ShapeMaps, note: str) -> Figure:
    """Plot the measured forces above, and the true ones below where they are known, on one scale.

    Of a picture with tractions.
    """
    fields = [
        (words, x_mm, y_mm, -KPA * mpa[..., 2], KPA * mpa[..., :2])
        for words, (x_mm, y_mm, mpa) in picture.tractions
    ]
    figure, axes = figures.create_figure(
        9.8, 3.05 * len(fields) + 0.8, 3, share_y=False, rows=len(fields)
    )
    figure.suptitle(f"{note}\n{_forces(picture)}", fontsize="small")
    pressure = max(MIN_KPA, *(_full(field[3]) for field in fields))
    shear = max(MIN_KPA, *(_full(np.hypot(*np.moveaxis(field[4], -1, 0))) for field in fields))
    for k, (words, x_mm, y_mm, normal_kpa, shear_kpa) in enumerate(fields):
        beside, normal, across = axes[3 * k : 3 * k + 3]
        last = k == len(fields) - 1
        (_depth if k else flow)(beside, picture)
        frame(beside, window_mm(picture), last=last)
        shown(normal, x_mm, y_mm, normal_kpa, DARK, 0, pressure, "pressure, kPa")
        normal.set_title(f"normal force, {words}", fontsize=HEADS)
        size = np.hypot(shear_kpa[..., 0], shear_kpa[..., 1])
        shown(across, x_mm, y_mm, size, DARK, 0, shear, "shear, kPa")
        arrows(across, x_mm, y_mm, shear_kpa, picture.tip_mm, shear)
        across.set_title(f"shear force, {words}", fontsize=HEADS)
        for axis in (normal, across):
            axis.set_facecolor("black")  # where nothing was looked for, nothing presses
            if words == "true":
                true_contact(axis, picture, "white", "-")
            else:
                outlines(axis, picture.contacts)
            frame(axis, window_mm(picture), False, last)
    return figure


def _full(values: Array) -> float:
    """Full scale of what is not 0: single nodes at an edge do not darken the rest."""
    some = values[values > 0.02 * values.max(initial=0)]
    return float(np.percentile(some, FORCE_EXTREME)) if some.size else 0.0


def _depth(axis: Axes, picture: ShapeMaps) -> None:
    top = max(float(picture.depth.depth_mm.max()), MIN_MM)
    shown(
        axis,
        picture.flow.x_mm,
        picture.flow.y_mm,
        picture.depth.depth_mm,
        "viridis",
        0,
        top,
        "depth, mm",
    )
    outlines(axis, picture.contacts)
    true_contact(axis, picture, SERIES_COLOURS[1])
    axis.set_title("depth (true contact dashed)", fontsize=HEADS)


def _forces(picture: ShapeMaps) -> str:
    """The two totals, in words."""
    parts, found = [], picture.wrench
    totals = [] if found is None else [("found", found.force_n, float(found.torque_nmm[2]))]
    for words, force, torque in (*totals, ("force sensor", picture.force_n, picture.torque_z_nmm)):
        if force is not None:
            x, y, z = (float(v) + 0.0 for v in np.round(force, 2))
            about = "" if torque is None else f", torque about z {round(torque, 1) + 0.0:.1f} N mm"
            parts.append(f"{words}: normal {-z:.2f} N, shear ({x:.2f}, {y:.2f}) N{about}")
    where = f"{picture.indenter} at ({picture.tip_mm[0]:.1f}, {picture.tip_mm[1]:.1f}) mm, "
    return "\n".join([where + f"{picture.tip_depth_mm:.2f} mm deep", *parts])


# -- parts of these figures: around a press, seen as the camera sees it ----------------------------

HALF_MM = 8.0
"""Shown of the face to each side of the tip, as far as the view goes."""
ARROW_MM = 1.5
"""Between arrows: sparse, as the paper's figure of the force distribution has them."""
MIN_MM = 0.02
ARROW_COLOUR = "#7fe0ff"
TICKS, LABELS, HEADS = "x-small", "small", "small"
"""Sizes of letters, of those that the page or the paper has."""

Window = Sequence[Sequence[float] | Array]
"""Limits (low, high) of what is shown in x and in y."""


def window_mm(picture: ShapeMaps) -> Window:
    """What is shown around a press."""
    assert picture.edges_mm is not None, "of those that are drawn"
    left, right, top, bottom = picture.edges_mm
    limits = zip(picture.tip_mm[:2], (left, top), (right, bottom), strict=True)
    return [np.clip([at - HALF_MM, at + HALF_MM], low, high) for at, low, high in limits]


def frame(axis: Axes, window: Window, first: bool = True, last: bool = True) -> None:
    """Limits and labels of a map; first in its row, last in its column."""
    from matplotlib.ticker import MultipleLocator

    axis.grid(visible=False)
    axis.tick_params(labelsize=TICKS)
    for side in (axis.xaxis, axis.yaxis):
        side.set_major_locator(MultipleLocator(5))
    axis.set(xlim=window[0], ylim=window[1][::-1], aspect="equal")
    if last:
        axis.set_xlabel("x, mm", fontsize=LABELS)
    if first:
        axis.set_ylabel("y, mm", fontsize=LABELS)


def shown(
    axis: Axes, x_mm: Array, y_mm: Array, values: Array, colours: str, low: float, high: float,
    words: str, side: str = "right",
) -> None:  # fmt: skip
    """Values at points, each a cell of its own, with a bar at a side; those of no number blank."""
    drawn = axis.pcolormesh(
        x_mm, y_mm, values, cmap=colours, vmin=low, vmax=high, shading="nearest", rasterized=True
    )
    bar = axis.figure.colorbar(drawn, ax=axis, location=side, shrink=0.8, aspect=16, pad=0.02)
    bar.ax.tick_params(labelsize=TICKS)
    bar.set_label(words, fontsize=LABELS)
    assert bar.solids is not None, "of a map"
    bar.solids.set_edgecolor("face")  # no seams
    bar.solids.set_rasterized(False)  # as an image it would have the id of any other panel's


def flow(axis: Axes, picture: ShapeMaps) -> None:
    """The camera's image, darkened, with the flow as arrows."""
    assert picture.image is not None, "of those that are drawn"
    assert picture.edges_mm is not None, "with it"
    rgb = (picture.image[..., ::-1].astype(float) * 0.6).astype(np.uint8)
    left, right, top, bottom = picture.edges_mm
    axis.imshow(rgb, extent=(left, right, bottom, top), interpolation="antialiased")
    known = np.where(picture.flow.known[..., None], picture.flow.shift_mm, np.nan)
    most = arrows(axis, picture.flow.x_mm, picture.flow.y_mm, known, picture.tip_mm)
    axis.set_title(f"flow, at most {most:.2f} mm", fontsize=HEADS)


def arrows(
    axis: Axes, x_mm: Array, y_mm: Array, vectors: Array, middle: Array, most: float | None = None
) -> float:
    """Vectors (h, w, 2), NaN where not known, at points ARROW_MM apart, one in the middle.

    most: the longest, drawn so that arrows do not hide each other; of all where it is not given.
    """
    from scipy.interpolate import RegularGridInterpolator

    if most is None:
        most = float(np.nanmax(np.hypot(vectors[..., 0], vectors[..., 1]), initial=MIN_MM))
    x, y = (
        np.arange(at - ARROW_MM * ((at - side[0]) // ARROW_MM), side[-1], ARROW_MM)
        for side, at in zip((x_mm, y_mm), middle, strict=False)
    )
    at = np.stack(np.meshgrid(y, x, indexing="ij"), axis=-1)
    part = RegularGridInterpolator((y_mm, x_mm), vectors.astype(float))(at)
    part[np.hypot(part[..., 0], part[..., 1]) < 0.02 * most] = np.nan
    axis.quiver(x, y, part[..., 0], part[..., 1], color=ARROW_COLOUR, angles="xy", units="inches",
                scale_units="xy", scale=most / (2 * ARROW_MM), width=0.013)  # fmt: skip
    return most


def outlines(axis: Axes, contacts: Iterable[ContactRegion], colour: str = "white") -> None:
    for line_mm in (contact.outline_mm for contact in contacts):
        axis.plot(*np.vstack((line_mm, line_mm[:1])).T, color=colour, lw=1.3)


def true_contact(axis: Axes, picture: ShapeMaps, colour: str, style: str = "--") -> None:
    """Outline of the true contact, where it is known."""
    x_mm, y_mm, true = picture.flow.x_mm, picture.flow.y_mm, picture.true_contact
    if true is not None and true.any():
        axis.contour(x_mm, y_mm, true.astype(float), [0.5], colors=colour,
                     linewidths=1.3, linestyles=style)  # fmt: skip


def solid(figure: Figure, place: Axes) -> Axes3D:
    """Axes in space in the place of flat ones, which keep their letter."""
    place.set_axis_off()
    axis = figure.add_subplot(place.get_subplotspec(), projection="3d")
    axis.view_init(elev=35, azim=-60)
    axis.tick_params(labelsize=TICKS, pad=-3)
    return axis
