"""What the pattern selection says: which pattern is best, and whether the paper's is."""

from __future__ import annotations

from ..report.result import Headline
from .intervals import Interval
from .pattern_errors import Measure, PatternErrors, PrintedPattern
from .pattern_tables import MEASURES, TRACKERS, rounds

PAPER_BEST = ((0.1, 0.5), (0.075, 0.6))
"""(d in mm, r) of the least error in each of the paper's rounds."""
TOO_SMALL_MM, SMALL_MM = 0.05, 0.075


def verdict(errors: PatternErrors, covers: str, bench: str = "") -> tuple[str, ...]:
    """Sentences, the answer first. bench: of a simulated one in figures, empty for a real one."""
    if not any(errors.best(m, "at_dots") for m in errors.methods):
        return ("No pattern has an error under every indenter: nothing can be compared.",)
    lines = [_optimum(errors), *(_of(errors, m) for m in errors.methods)]
    lines += [_small(errors), _renewals(errors), bench]
    lines.append(f"{'Simulated: ' if bench else ''}{covers}.")
    return tuple(line for line in lines if line)


def _renewals(errors: PatternErrors) -> str:
    """How often the summed flow took on the error of a frame for good, which no pattern helps."""
    if "paper" not in errors.methods:
        return ""
    counts = [errors.tally(p.name, "paper").switches for p in errors.printed]
    presses = len({cell.press for cell in errors.cells})
    if not any(counts):
        return (
            "The paper's tracker never renewed its reference, so nothing here is a floor of summed "
            "flow."
        )
    return (
        f"The paper's tracker renewed its reference {min(counts)} to {max(counts)} times a pattern "
        f"in {presses} presses; from then on it carries that frame's error, whatever the pattern."
    )


def _optimum(errors: PatternErrors) -> str:
    """Whether the paper's best of each round is the best here, by its own tracker and error."""
    method = "paper" if "paper" in errors.methods else errors.methods[0]
    said = []
    for (_, part), (d_mm, r) in zip(rounds(errors.printed), PAPER_BEST, strict=False):
        theirs = next((p for p in part if (p.d_mm, p.r) == (d_mm, r)), None)
        best = errors.best(method, "at_dots", part)
        if theirs is None or best is None or len(part) < 2:
            continue
        here = errors.over_indenters(theirs.name, method, "at_dots")
        least = errors.over_indenters(best.name, method, "at_dots")
        if here is None or least is None:
            continue
        if best == theirs:
            said.append(f"{theirs.words} is the best of its round ({_mm(here)})")
            continue
        apart = errors.difference(theirs.name, best.name, method, "at_dots")
        told = "" if apart and apart.low is not None and apart.low > 0 else (
            ", which the indenters do not tell apart"
        )  # fmt: skip
        said.append(
            f"{best.words} ({_mm(least)}) comes before {theirs.words} ({_mm(here)}) in its "
            f"round{told}"
        )
    if not said:
        return ""
    appears = "appears" if all("is the best of" in line for line in said) else "does not appear"
    return f"The paper's optimum {appears} by its own tracker and error: {'; '.join(said)}."


def _of(errors: PatternErrors, method: str) -> str:
    parts = []
    for measure, words in MEASURES.items():
        best = errors.best(method, measure)
        if best is None:
            continue
        known = errors.over_indenters(best.name, method, measure)
        assert known is not None, "the best one has an error"
        beside = errors.beside(best, method, measure)
        more = f", not told from {len(beside)} others" if beside else ""
        parts.append(f"{words}, best with {best.words}: {_mm(known)}{more}")
        if measure == "off":
            cover = errors.tally(best.name, method).figures()["coverage"]
            parts[-1] += "" if cover is None else f", confident of {cover:.0%}"
    name = TRACKERS.get(method, method)
    return f"{name[0].upper()}{name[1:]}: {'; '.join(parts)}." if parts else ""


def _small(errors: PatternErrors) -> str:
    """Whether the error rises where patches get too small for the printer."""
    sizes = [_mean_of(errors, d_mm, "paper") for d_mm in (TOO_SMALL_MM, SMALL_MM)]
    if any(v is None for v in sizes):
        return ""
    tiny, small = (v for v in sizes if v is not None)
    moves = "rises" if tiny > small else "does not rise"
    return (
        f"At d = {TOO_SMALL_MM:g} mm, where the paper's error rises to around 0.5 mm, it {moves} "
        f"here: {tiny:.3g} mm against {small:.3g} at {SMALL_MM:g} mm (means of r .4 to .6)."
    )


def _mean_of(errors: PatternErrors, d_mm: float, method: str) -> float | None:
    """Mean error at the dots over the second round's patterns of a patch size."""
    values = [
        errors.over_indenters(p.name, method, "at_dots")
        for p in errors.printed
        if p.d_mm == d_mm and 2 in p.rounds
    ]
    known = [v.value for v in values if v is not None]
    return sum(known) / len(known) if known and len(known) == len(values) else None


def headlines(errors: PatternErrors) -> tuple[Headline, ...]:
    """The paper's figures beside those found, by its tracker; then ours."""
    found: list[Headline] = []
    for method in errors.methods:
        for p in errors.printed:
            if p.paper_mm is not None and not p.paper_about:
                found += _headline(errors, p, method, "at_dots", p.paper_mm)
        for measure in MEASURES:
            best = errors.best(method, measure)
            if best is not None:
                found += _headline(errors, best, method, measure, None, "best: ")
    return tuple(dict.fromkeys(found))


def _headline(
    errors: PatternErrors,
    printed: PrintedPattern,
    method: str,
    measure: Measure,
    paper_mm: float | None,
    head: str = "",
) -> list[Headline]:
    known = errors.over_indenters(printed.name, method, measure)
    if known is None:
        return []
    what = f"{head}{printed.words}, {TRACKERS.get(method, method)}, {MEASURES[measure]}"
    cover = errors.tally(printed.name, method).figures()["coverage"]
    remark = "" if cover is None else f"confident of {cover:.0%} of the moving pixels"
    return [
        Headline(what, known.value, "mm", known.low, known.high, known.over, paper_mm,
                 remark=remark)
    ]  # fmt: skip


def _mm(known: Interval) -> str:
    if known.low is None or known.high is None:
        return f"{known.value:.3g} mm"
    return f"{known.value:.3g} mm, 95 % {known.low:.2g} to {known.high:.2g}"
