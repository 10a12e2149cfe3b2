"""What a pattern search found: candidates by their error in the search, the best few confirmed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...catalog import as_toml
from ...errors import RunFailed
from ...protocols.plan import Protocol, expand
from ...report.result import Headline, LeftOut, ReportFigure, ReportTable, StudyResult
from ..intervals import Interval, headline, mean, ratio
from ..request import StudyRequest
from .candidates import MAX_PX, MIN_DOTS, MIN_PX, Candidate, Size
from .confirm import SHOWN_MM
from .imager import PatternImager

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DEFAULT, FARNEBACK = "fused", "paper"
"""Trackers: ours, and the paper's own, as `measure.flow.named_tracker` calls them."""
GOAL = 1 / 3
"""Of the paper's pattern's mean error, at most."""
MIN_COVERAGE = 0.9
"""Share of the moving pixels that a pattern's tracker must be sure of, to be recommended."""
MIN_BRIDGED_MM = 0.39
"""Twice the step between frames that the protocols have: a press may be quicker than planned."""
RECIPE_FILE, RECIPE_SEED = "best-pattern.toml", 7
UM = 1000.0
LEFT_OUT = (
    LeftOut(
        "grey patterns",
        "a printer makes them of one ink, which the model of three does not hold; and the "
        "tracker's second witness is colour",
    ),
    LeftOut("marker dots", "they are features themselves and would flatter the error"),
    LeftOut("the lens", "the view is a pinhole's: the search is for a scale in mm a pixel"),
    LeftOut("the search's own gel", "its drag is a known motion: nothing is solved for it"),
)


def ranked(
    found: Mapping[str, Sequence[dict[str, Any]]], among: Sequence[Candidate]
) -> pd.DataFrame:
    """A row a candidate, the least error first; means over seeds, of `bridged_mm` the least.

    found: what `drag.probe` returned by candidate's name, a value a seed. `refused`: why it has no
    error. Raises RunFailed where none could be tracked.
    """
    rows = []
    for c in among:
        values, keys = found.get(c.name, ()), dict(c.keys)
        why = next((v["refused"] for v in values if "refused" in v), "")
        row: dict[str, Any] = {
            "pattern": c.name, "kind": f"{c.family} {keys['patch_mm']:g}",
            "error_mm": None, "coverage": None, "bridged_mm": None,
            "refused": why if values else "no result",
        }  # fmt: skip
        if not row["refused"]:
            row |= {k: float(np.mean([v[k] for v in values])) for k in ("error_mm", "coverage")}
            row["bridged_mm"] = min(v["bridged_mm"] for v in values)
        rows.append(row)
    frame = pd.DataFrame(rows)
    if frame["error_mm"].isna().all():
        raise RunFailed("pattern-search: no candidate could be tracked")
    return frame.sort_values("error_mm", na_position="last", ignore_index=True)


def finalists(frame: pd.DataFrame, count: int) -> list[str]:
    """The best of different kinds that can be recommended; fewer where there are no more."""
    sure = (frame["coverage"] >= MIN_COVERAGE) & (frame["bridged_mm"] >= MIN_BRIDGED_MM)
    return list(frame[frame["error_mm"].notna() & sure].drop_duplicates("kind")["pattern"])[:count]


@dataclass(frozen=True)
class ConfirmedPattern:
    """A pattern on the finite-strain gel: means over presses, errors_mm by seed."""

    pattern: str
    method: str
    errors_mm: tuple[float, ...]
    coverage: float

    @property
    def error(self) -> Interval:
        """Mean over seeds, mm."""
        return mean(self.errors_mm, range(len(self.errors_mm)), "seed", "positive")


def confirmed(
    results: Sequence[Sequence[Mapping[str, Any]]], names: Sequence[str], method: str
) -> tuple[list[ConfirmedPattern], dict[str, str]]:
    """Patterns that a method tracked with every seed, best first; why not, of the others.

    results: by seed, what `confirm` returned of each press. A press counts as much as another.
    """
    found, refused = [], {}
    for name in names:
        each = [[press["figures"].get(name, {}) for press in presses] for presses in results]
        flat = [figures for presses in each for figures in presses]
        if why := next((f["why"] for f in flat if "why" in f), ""):
            refused[name] = why
        elif flat and all(method in f for f in flat):
            errors = [np.mean([f[method]["mean_off_dots_mm"] for f in one]) for one in each]
            cover = float(np.mean([f[method]["coverage"] or 0.0 for f in flat]))
            found.append(ConfirmedPattern(name, method, tuple(map(float, errors)), cover))
    return sorted(found, key=lambda c: c.error.value), refused


def gain(found: Sequence[ConfirmedPattern], among: Sequence[str], paper: str) -> Interval | None:
    """Error of the finalist to print over the paper's pattern's, by the seeds, with its interval.

    For each seed the finalist is the best of the *other* seeds, so that having chosen it among
    several flatters nothing. None where the paper's pattern was not tracked.
    """
    by_name = {one.pattern: np.array(one.errors_mm) for one in found}
    if paper not in by_name:
        return None
    chosen = chosen_by_others(np.array([by_name[name] for name in among if name in by_name]))
    return ratio(chosen, by_name[paper], range(len(chosen)), "seed")


def chosen_by_others(errors: NDArray[np.float64]) -> NDArray[np.float64]:
    """For each seed the error of the pattern that the other seeds call best.

    errors: (patterns, seeds). With one seed, the best one.
    """
    n = errors.shape[1]
    if n == 1:
        return np.asarray(errors.min(axis=0))
    rest = errors.sum(axis=1, keepdims=True) - errors
    return np.asarray(errors[rest.argmin(axis=0), np.arange(n)])


@dataclass(frozen=True)
class Findings:
    """All that the two grids gave.

    frame: of candidates. ours, farneback: what was confirmed by the default and by the paper's own
    tracker, best first; refused: why not, of the others. seen: what `confirm` gave of a first
    press.
    """

    asked: StudyRequest
    rig: str
    bench: PatternImager
    size: Size
    protocol: Protocol
    among: list[Candidate]
    frame: pd.DataFrame
    finalists: list[str]
    paper: str
    ours: list[ConfirmedPattern]
    farneback: list[ConfirmedPattern]
    refused: dict[str, str]
    seen: Mapping[str, Any]


def result(found: Findings) -> StudyResult:
    """The study's result. Raises RunFailed where no finalist was tracked on the gel."""
    best = next((one for one in found.ours if one.pattern in found.finalists), None)
    if best is None:
        raise RunFailed("pattern-search: no finalist could be tracked on the gel")
    recipe = next(c for c in found.among if c.name == best.pattern).plain(RECIPE_SEED)
    px, dots = (recipe["patch_mm"] / pitch for pitch in
                (found.bench.mm_per_px, found.bench.printer.mm_per_dot))  # fmt: skip
    share = gain(found.ours, found.finalists, found.paper)
    heads = [
        headline(
            "mean error of the pattern to print", "µm", best.error, UM, told=True,
            remark="moving pixels, default tracker, no dots, finite-strain gel",
        )
    ]  # fmt: skip
    if share is not None:
        heads.append(
            headline(
                "its share of the paper's pattern's error", "", share, goal=GOAL, told=True,
                remark="for each seed the finalist that the other seeds call best",
            )
        )  # fmt: skip
    pair = [one for name in (*found.finalists[:1], found.paper) for one in found.farneback
            if one.pattern == name]  # fmt: skip
    if len(pair) == 2:
        ours, theirs = (one.errors_mm for one in pair)
        heads.append(
            headline(
                f"the same share with the paper's tracker, {pair[0].pattern}", "",
                ratio(ours, theirs, range(len(ours)), "seed"),
                remark="Farneback, summed",
            )
        )  # fmt: skip
    return StudyResult(
        study="pattern-search",
        title="The best pattern for a printer and a camera",
        simulated=True,
        seed=found.asked.seed,
        scale=found.asked.scale,
        answer=(
            f"Print {best.pattern}: patches of {px:.1f} camera pixels and {dots:.1f} printer "
            "dots.",
        ),
        headlines=tuple(heads),
        tables=_tables(found),
        figures=_drawn(found, best),
        settings=_settings(found),
        notes=(
            "Printer and camera are models with assumed parameters, not measured ones: print the "
            "best few on one sheet and run `study run pattern-selection` on your bench before you "
            "commit.",
            *(f"{name} could not be tracked on the gel: {why}"
              for name, why in found.refused.items()),
        ),
        left_out=LEFT_OUT,
        files={RECIPE_FILE: _recipe_text(found, recipe, heads)},
        more={"best": {"pattern": best.pattern, "recipe": recipe}},
    )  # fmt: skip


def _tables(found: Findings) -> tuple[ReportTable, ...]:
    rows = [
        {"pattern": c.pattern, "tracker": c.method, "mean_error_mm": c.error.value,
         "low_mm": c.error.low, "high_mm": c.error.high, "coverage": c.coverage}
        for c in (*found.ours, *found.farneback)
    ]  # fmt: skip
    return (
        ReportTable(
            "confirmed",
            f"Confirmed on the finite-strain gel. Means over {found.size.held_out} seeds that the "
            "search has not seen.",
            pd.DataFrame(rows),
        ),
        ReportTable(
            "candidates",
            f"The candidates. Means over {found.size.seeds} seeds, best first; of the longest "
            "step between frames that is bridged the least.",
            found.frame.drop(columns="kind"),
        ),
    )


def _settings(found: Findings) -> dict[str, str]:
    p = found.protocol
    assert p.shear is not None
    frames = sum(step.frames for step in expand(p))
    return {
        **found.bench.words(),
        "candidates": f"{len(found.among)}, of at least {MIN_DOTS:g} printer dots and "
        f"{MIN_PX:g} to {MAX_PX:g} camera pixels a patch (the paper's in any case)",
        "to be a finalist": f"the tracker is sure of {100 * MIN_COVERAGE:.0f} % of the moving "
        f"pixels and bridges steps of {MIN_BRIDGED_MM:.1f} mm; one of each law and patch size",
        "confirmed on": f"{' and '.join(p.indenters)}, {max(p.depths_mm):g} mm deep, "
        f"{p.shear.at_depth_mm(max(p.depths_mm)):g} mm of drag each way in "
        f"{' and '.join(p.shear.axes)}, {frames} frames, finite-strain gel of the rig "
        f"{found.rig!r}",
        "friction": f"{p.specimen.friction:g}",
        "seeds": f"{found.size.seeds} of the search, {found.size.held_out} held out: pattern, "
        "print and noise are drawn anew with each",
    }


def _recipe_text(found: Findings, recipe: dict[str, Any], heads: Sequence[Headline]) -> str:
    """The winner as a recipe file, with the figures that speak for it."""
    words = found.bench.words()
    about = [
        f"The best of {len(found.among)} patterns for this printer and camera, simulated:",
        f"{words['printer']};",
        f"{words['camera']}.",
        *(one.sentence for one in heads if one.told),
        "Its seed may be any.",
    ]
    return as_toml({k: v for k, v in recipe.items() if (k, v) != ("channels", 3)}, about)


def _drawn(found: Findings, best: ConfirmedPattern) -> tuple[ReportFigure, ...]:
    """Errors of candidates by their size, those confirmed, and what the camera sees."""
    names = dict.fromkeys((best.pattern, *found.finalists[:3], found.paper))
    pictures = {n: found.seen[f"picture/{n}"] for n in names if f"picture/{n}" in found.seen}
    out = [
        ReportFigure(
            "errors",
            "Mean error by the size of a patch: of each candidate on the search's drag (dots, by "
            "law), and of those confirmed on the finite-strain gel with 95 % intervals over the "
            "seeds (squares); simulated.",
            partial(errors_by_size, found.frame, found.ours, found.among, found.paper),
        )
    ]
    if pictures:
        out.append(
            ReportFigure("seen", "Patterns at rest as the camera sees them.",
                         partial(strip, pictures, {found.paper: f"the paper's: {found.paper}"}))
        )  # fmt: skip
    return tuple(out)


def errors_by_size(
    frame: pd.DataFrame, ours: Sequence[ConfirmedPattern], among: Sequence[Candidate], paper: str
) -> Figure:
    """A mark a candidate."""
    from ...report.figures import COLOURS, INK, PAPER_COLOUR, blank, legend_below, log_ticks

    size_mm = {c.name: dict(c.keys)["patch_mm"] for c in among}
    family = {c.name: c.family for c in among}
    figure, (axis,) = blank(7.4, 3.6)
    known = frame[frame["error_mm"].notna()]
    for colour, law in zip(cycle(COLOURS), dict.fromkeys(family.values()), strict=False):
        part = known[known["pattern"].map(family) == law]
        axis.plot(part["pattern"].map(size_mm), UM * part["error_mm"], "o", ms=4, color=colour,
                  label=law)  # fmt: skip
    for one in ours:
        x, y = size_mm[one.pattern], one.error
        colour = PAPER_COLOUR if one.pattern == paper else INK
        if y.low is not None and y.high is not None:
            axis.plot([x, x], [UM * y.low, UM * y.high], color=colour, lw=1)
        axis.plot(x, UM * y.value, "s", ms=6, mfc="none", color=colour)
    log_ticks(axis, "xy")
    axis.set_xlabel("size of a patch, mm")
    axis.set_ylabel("mean error, µm")
    legend_below(figure, axis)
    return figure


def strip(pictures: Mapping[str, NDArray[np.uint8]], words: Mapping[str, str]) -> Figure:
    """Patterns at rest as the camera sees them, a square of the face each."""
    from ...report.figures import blank

    figure, axes = blank(9.6, 2.6, len(pictures), share_y=False)
    for axis, (name, picture) in zip(axes, pictures.items(), strict=True):
        axis.imshow(picture, interpolation="nearest", extent=(0, SHOWN_MM, SHOWN_MM, 0))
        axis.set_title(words.get(name, name), fontsize=8, loc="left")
        axis.grid(visible=False)
        axis.set_xticks([0, SHOWN_MM], ["0", f"{SHOWN_MM:g} mm"], fontsize=8)
        axis.set_yticks([])
    return figure
