"""A pattern search in words and plain data."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import pandas as pd

from ...catalog import as_toml
from ...protocols.plan import expand
from ...report.result import Headline, LeftOut, StudyResult, records
from ..intervals import Interval, headline, told
from .candidates import MAX_PX, MIN_DOTS, MIN_PX
from .findings import GOAL, ConfirmedPattern, Findings, ratio
from .presentation import UM, drawn, tables
from .search import MIN_BRIDGED_MM, MIN_COVERAGE

RECIPE_FILE = "best-pattern.toml"
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


def result(found: Findings) -> StudyResult:
    """The study's result. Raises RunFailed where no finalist was tracked on the gel."""
    return StudyResult(
        study="pattern-search",
        title="The best pattern for a printer and a camera",
        verdict=_verdict(found),
        data=_data(found),
        simulated=True,
        seed=found.asked.seed,
        scale=found.asked.scale,
        headlines=_headlines(found),
        tables=tables(found),
        figures=drawn(found),
        settings=_settings(found),
        notes=_notes(found),
        left_out=LEFT_OUT,
        missing=found.missing,
        files={RECIPE_FILE: _recipe_text(found)},
    )


def _um(one: ConfirmedPattern) -> str:
    return told(one.error, "µm", ".2f", UM)


def _by_farneback(found: Findings) -> list[ConfirmedPattern]:
    """The best of the search and the paper's pattern by the paper's tracker, where it has both."""
    pair = [found.of(found.farneback, name) for name in (*found.finalists[:1], found.paper)]
    known = [one for one in pair if one is not None]
    return known if len(known) == 2 else []


def _verdict(found: Findings) -> tuple[str, ...]:
    best, paper, gain = found.best, found.of(found.ours, found.paper), found.gain
    d_mm = found.row(best.pattern)["patch_mm"]
    px, dots = d_mm / found.bench.mm_per_px, d_mm / found.bench.printer.mm_per_dot
    lines = [
        f"Print {best.pattern}, patches of {px:.1f} camera pixels and {dots:.1f} printer dots: its "
        f"mean error is {_um(best)}, over {best.error.over}."
    ]
    if gain is None or paper is None:
        lines.append("The paper's d 0.075, r 0.6 could not be tracked here at all.")
    else:
        lines.append(
            f"That is {told(gain, digits='.2f')} of the {_um(paper)} of the paper's d 0.075, "
            f"r 0.6; the goal of a third is {'met' if gain.value <= GOAL else 'missed'}."
        )
    if far := _by_farneback(found):
        lines.append(
            f"The paper's own tracker (Farneback, summed): {far[0].pattern} {_um(far[0])}, the "
            f"paper's pattern {_um(far[1])}."
        )
    sure = found.orders["sure"]
    whole, of_sure, of_lost, of_image = (
        _first(order)
        for order in (found.orders[""], sure, found.orders["lost"], sure[~sure["needs_tracker"]])
    )
    low = found.orders[""].iloc[0]["low"]
    doubt = "" if low is not None and low > 0 else ", but not for certain"
    row = found.row(best.pattern)
    known = found.frame[found.frame["leap_error_mm"].notna()]
    bold = known.sort_values(["bridged_mm", "leap_error_mm"], ascending=[False, True]).iloc[0]
    return (
        *lines,
        f"What orders patterns by their mean error best is {whole}{doubt}. Two things make it: how "
        f"exactly pixels are followed, best ordered by {of_sure}, of one image alone by "
        f"{of_image}; and how many are not followed, by {of_lost}.",
        f"It is followed in steps of up to {row['bridged_mm']:.1f} mm a frame; the longest that "
        f"any is followed in is {bold['bridged_mm']:.1f} mm, by {bold['pattern']}, at "
        f"{bold['error_mm'] / row['error_mm']:.1f} times the error of the search.",
    )


def _first(order: pd.DataFrame) -> str:
    """The first predictor of an order with its rank correlation and interval."""
    row = order.iloc[0]
    rho = Interval(row["rho"], row["low"], row["high"], row["over"])
    return f"{row['predictor']}, {told(rho, digits='.2f')}"


def _headlines(found: Findings) -> tuple[Headline, ...]:
    out = [
        headline(
            "mean error, the pattern to print", "µm", found.best.error, UM,
            remark="moving pixels, default tracker, no dots, finite-strain gel",
        )
    ]  # fmt: skip
    if found.gain is not None:
        out.append(
            headline(
                "its share of the paper's pattern's error", "", found.gain, goal=GOAL,
                remark="for each seed the finalist that the other seeds call best",
            )
        )  # fmt: skip
    if far := _by_farneback(found):
        out.append(
            headline(
                f"the same share with the paper's tracker, {far[0].pattern}",
                "",
                ratio(far[0].errors_mm, far[1].errors_mm),
                remark="Farneback, summed, reference renewed by a photometric threshold",
            )
        )
    return tuple(out)


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


def _notes(found: Findings) -> tuple[str, ...]:
    none = found.frame[found.frame["refused"] != ""]
    return (
        "Printer and camera are models with assumed parameters, not measured ones: print the best "
        "few on one sheet and run `study run pattern-selection` on your bench before you commit.",
        "The rank correlations hold for these candidates, this tracker, and a drag that nearly "
        "folds the skin.",
        *(f"{name} could not be tracked on the gel: {why}" for name, why in found.refused.items()),
        *(f"{row['pattern']}: {row['refused']}" for _, row in none.iterrows()),
    )


def _data(found: Findings) -> dict[str, Any]:
    def plain(value: Interval | None) -> dict[str, Any] | None:
        return None if value is None else value._asdict()

    best, shipped = found.best, found.of(found.ours, found.shipped)
    bench = asdict(found.bench)
    return {
        "printer": bench["printer"],
        "camera": bench["sensor"] | {"mm_per_px": bench["mm_per_px"]},
        "best": {"pattern": best.pattern, "recipe": found.recipe},
        "best_mean_error_mm": plain(best.error),
        "best_over_paper": plain(found.gain),
        "best_over_shipped": shipped and plain(ratio(best.errors_mm, shipped.errors_mm)),
        "goal_over_paper": GOAL,
        "goal_met": None if found.gain is None else found.gain.value <= GOAL,
        "confirmed": [c.as_row() for c in found.ours],
        "farneback": [c.as_row() for c in found.farneback],
        "predictors": records(found.orders[""]),
        "predictors_of_the_sure": records(found.orders["sure"]),
        "predictors_of_the_lost": records(found.orders["lost"]),
        "candidates": records(found.frame),
        "search_seeds": found.size.seeds,
        "held_out_seeds": found.size.held_out,
    }  # fmt: skip


def _recipe_text(found: Findings) -> str:
    """The winner as a recipe file, with the figures that speak for it."""
    words = found.bench.words()
    share = f", {found.gain.value:.2f} of that of the paper's d 0.075, r 0.6" if found.gain else ""
    about = [
        f"The best of {len(found.among)} patterns for this printer and camera, simulated:",
        f"{words['printer']};",
        f"{words['camera']}.",
        f"Mean error of the moving pixels {UM * found.best.error.value:.2g} µm{share} "
        f"({found.best.error.over}).",
        "Its seed may be any.",
    ]
    return as_toml({k: v for k, v in found.recipe.items() if (k, v) != ("channels", 3)}, about)
