"""A pattern search in words and plain data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...protocols.plan import expand
from ...report.result import Headline, LeftOut, StudyResult
from ..intervals import Interval
from .candidates import MAX_PX, MIN_DOTS, MIN_PX
from .findings import GOAL, RECIPE_SEED, UM, Findings, ratio, recipe_text
from .presentation import drawn, tables
from .search import MIN_BRIDGED_MM, MIN_COVERAGE

if TYPE_CHECKING:
    import pandas as pd

RECIPE_FILE = "best-pattern.toml"


def result(found: Findings) -> StudyResult:
    """The study's result. Raises RunFailed where no finalist was tracked on the gel."""
    return StudyResult(
        study="pattern-search",
        title="The best pattern for a printer and a camera",
        verdict=_verdict(found),
        data=_data(found),
        simulated=True,
        seed=found.seed,
        scale=found.scale,
        headlines=_headlines(found),
        tables=tables(found),
        figures=drawn(found),
        settings=_settings(found),
        notes=_notes(found),
        left_out=_left_out(),
        missing=found.missing,
        files={RECIPE_FILE: recipe_text(found)},
    )


def _um(value: Interval) -> str:
    if value.low is None or value.high is None:
        return f"{UM * value.value:.2f} µm"
    return f"{UM * value.value:.2f} µm ({UM * value.low:.2f} to {UM * value.high:.2f})"


def _interval(value: Interval) -> str:
    if value.low is None or value.high is None:
        return f"{value.value:.2f}"
    return f"{value.value:.2f} ({value.low:.2f} to {value.high:.2f})"


def _verdict(found: Findings) -> tuple[str, ...]:
    best, paper = found.best, found.of(found.ours, found.paper)
    d_mm = found.row(best.pattern)["patch_mm"]
    px, dots = d_mm / found.bench.mm_per_px, d_mm / found.bench.printer.mm_per_dot
    lines = [
        f"Print {best.pattern}, patches of {px:.1f} camera pixels and {dots:.1f} printer dots: its "
        f"mean error is {_um(best.error)}, over {best.error.over}."
    ]
    if found.gain is not None and paper is not None:
        met = "met" if found.gain.value <= GOAL else "missed"
        lines.append(
            f"That is {_interval(found.gain)} of the {_um(paper.error)} of the paper's d 0.075, "
            f"r 0.6; the goal of a third is {met}."
        )
    else:
        lines.append("The paper's d 0.075, r 0.6 could not be tracked here at all.")
    far = [found.of(found.farneback, name) for name in (found.finalists[0], found.paper)]
    if far[0] is not None and far[1] is not None:
        lines.append(
            f"The paper's own tracker (Farneback, summed): {far[0].pattern} "
            f"{_um(far[0].error)}, the paper's pattern {_um(far[1].error)}."
        )
    lines.append(_of_predictors(found))
    lines.append(_of_leaps(found))
    return tuple(lines)


def _of_predictors(found: Findings) -> str:
    """What orders patterns, and of two things that make the error, what orders each."""
    whole, sure, lost = (
        _best_order(order) for order in (found.order, found.sure_order, found.lost_order)
    )
    image = _best_order(found.sure_order[~found.sure_order["needs_tracker"]])
    first = found.order.iloc[0]
    certain = first["low"] is not None and first["low"] > 0
    lead = (
        f"What orders patterns by their mean error best is {whole}"
        if certain
        else f"No figure orders patterns by their mean error for certain; the best is {whole}"
    )
    return (
        f"{lead}. Two things make it: how exactly pixels are followed, best ordered by {sure}, of "
        f"one image alone by {image}; and how many are not followed, by {lost}."
    )


def _best_order(order: pd.DataFrame) -> str:
    """The first predictor of an order with its rank correlation and interval."""
    row = order.iloc[0]
    rho = Interval(row["rho"], row["low"], row["high"], row["over"])
    return f"{row['predictor']}, {_interval(rho)}"


def _of_leaps(found: Findings) -> str:
    """Of motions in one step, where another pattern is the better one."""
    best = found.row(found.best.pattern)
    known = found.frame[found.frame["leap_error_mm"].notna()]
    bold = known.sort_values(["bridged_mm", "leap_error_mm"], ascending=[False, True]).iloc[0]
    line = f"It is followed in steps of up to {best['bridged_mm']:.1f} mm a frame"
    if bold["bridged_mm"] <= best["bridged_mm"]:
        return f"{line}, and no candidate in longer ones."
    return (
        f"{line}; where frames are further apart, {bold['pattern']} bridges "
        f"{bold['bridged_mm']:.1f} mm at {bold['error_mm'] / best['error_mm']:.1f} times the error "
        "of the search."
    )


def _headlines(found: Findings) -> tuple[Headline, ...]:
    error = found.best.error
    out = [
        Headline(
            "mean error, the pattern to print",
            UM * error.value,
            "µm",
            None if error.low is None else UM * error.low,
            None if error.high is None else UM * error.high,
            error.over,
            remark="moving pixels, default tracker, no dots, finite-strain gel",
        )
    ]
    if found.gain is not None:
        g = found.gain
        out.append(
            Headline("its share of the paper's pattern's error", g.value, "", g.low, g.high,
                     g.over, goal=GOAL,
                     remark="for each seed the finalist that the other seeds call best")
        )  # fmt: skip
    far = [found.of(found.farneback, name) for name in (found.finalists[0], found.paper)]
    if far[0] is not None and far[1] is not None:
        share = ratio(far[0], far[1])
        out.append(
            Headline(f"the same share with the paper's tracker, {far[0].pattern}", share.value,
                     "", share.low, share.high, share.over,
                     remark="Farneback, summed, reference renewed by a photometric threshold")
        )  # fmt: skip
    if found.pair is not None:
        held = found.pair.held_out
        out.append(
            Headline("rank correlation of the best two predictors, families left out", held.value,
                     "", held.low, held.high, held.over, better="high",
                     remark=f"chosen on all: {' and '.join(found.pair.names)}, "
                     f"{found.pair.rho:.2f}")
        )  # fmt: skip
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
    notes = [
        "Printer and camera are models with assumed parameters, not measured ones: print the best "
        "few on one sheet and run `study run pattern-selection` on your bench before you commit.",
        "The rank correlations hold for these candidates, this tracker, and a drag that nearly "
        "folds the skin.",
    ]
    notes += [
        f"{name} could not be tracked on the gel: {why}" for name, why in found.refused.items()
    ]
    none = found.frame[found.frame["refused"] != ""]
    notes += [f"{row['pattern']}: {row['refused']}" for _, row in none.iterrows()]
    return tuple(notes)


def _left_out() -> tuple[LeftOut, ...]:
    return (
        LeftOut(
            "grey patterns",
            "a printer makes them of one ink, which the model of three does "
            "not hold; and the tracker's second witness is colour",
        ),
        LeftOut("marker dots", "they are features themselves and would flatter the error"),
        LeftOut("the lens", "the view is a pinhole's: the search is for a scale in mm a pixel"),
        LeftOut("the search's own gel", "its drag is a known motion: nothing is solved for it"),
    )


def _data(found: Findings) -> dict[str, Any]:
    def estimate(value: Interval | None) -> dict[str, Any] | None:
        return None if value is None else dict(value._asdict())

    shipped = found.of(found.ours, found.shipped)
    pair = found.pair
    return {
        "printer": found.bench.as_dict()["printer"],
        "camera": found.bench.as_dict()["sensor"] | {"mm_per_px": found.bench.mm_per_px},
        "best": {"pattern": found.best.pattern, **_keys(found)},
        "best_mean_error_mm": estimate(found.best.error),
        "best_over_paper": estimate(found.gain),
        "best_over_shipped": estimate(None if shipped is None else ratio(found.best, shipped)),
        "goal_over_paper": GOAL,
        "goal_met": None if found.gain is None else found.gain.value <= GOAL,
        "confirmed": [c.as_row() for c in found.ours],
        "farneback": [c.as_row() for c in found.farneback],
        "predictors": _records(found.order),
        "predictors_of_the_sure": _records(found.sure_order),
        "predictors_of_the_lost": _records(found.lost_order),
        "combined": None
        if pair is None
        else {
            "picked": list(pair.names),
            "rho": pair.rho,
            "rho_families_left_out": estimate(pair.held_out),
        },
        "candidates": _records(found.frame),
        "search_seeds": found.size.seeds,
        "held_out_seeds": found.size.held_out,
    }


def _keys(found: Findings) -> dict[str, Any]:
    candidate = next(c for c in found.among if c.name == found.best.pattern)
    return {"recipe": candidate.recipe(RECIPE_SEED).model_dump(mode="json", exclude_none=True)}


def _records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows as plain data, None where there is no number."""
    plain = frame.astype(object).where(frame.notna(), None)
    return [{str(k): v for k, v in row.items()} for row in plain.to_dict("records")]
