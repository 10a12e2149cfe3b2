"""What the paper claims of its sensor's size, area and resolution, against its own figures."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .sensors import (
    CLAIMED_REDUCTION,
    DELTACT,
    GECKO,
    IN_TABLE,
    PREDECESSOR,
    PREDECESSOR_DRAWN,
    SensorRow,
    Size,
)

ROUNDING_MM = 0.5  # sizes are printed in whole millimetres

MEASURES: dict[str, Callable[[Size], float]] = {
    "volume": math.prod,
    "surface of the box": lambda s: 2 * (s[0] * s[1] + s[1] * s[2] + s[0] * s[2]),
    "footprint, first x second side": lambda s: s[0] * s[1],
    "diagonal": lambda s: math.hypot(*s),
    "longest side": max,
    "sum of the sides": sum,
    "first side": lambda s: s[0],
    "second side": lambda s: s[1],
    "third side": lambda s: s[2],
}


@dataclass(frozen=True)
class PaperClaim:
    """A sentence of the paper, whether it holds, and by which figures."""

    claim: str
    where: str
    holds: str
    figures: str


def reduction(theirs: Size, measure: str = "volume") -> float:
    """By which share the paper's sensor is smaller than theirs; negative: larger."""
    of = MEASURES[measure]
    return 1 - of(DELTACT.size_mm) / of(theirs)


def bounds(theirs: Size) -> tuple[float, float]:
    """Least and greatest share by volume that sizes printed in whole millimetres leave open."""
    corners = itertools.product((-ROUNDING_MM, ROUNDING_MM), repeat=2)
    found = [
        1 - math.prod(s + a for s in DELTACT.size_mm) / math.prod(s + b for s in theirs)
        for a, b in corners
    ]
    return min(found), max(found)


def nearest_measure() -> tuple[str, float]:
    """The way to measure by which the figure's size comes nearest to the paper's third."""
    found = {m: reduction(PREDECESSOR_DRAWN.size_mm, m) for m in MEASURES}
    best = min(found, key=lambda m: abs(found[m] - CLAIMED_REDUCTION))
    return best, found[best]


def rank(values: Sequence[float], own: float) -> int:
    """Place of one among several, the smallest first; equal ones share the better place."""
    return 1 + sum(value < own and not math.isclose(value, own) for value in values)


def not_worse(one: SensorRow, other: SensorRow) -> bool:
    """Whether one has no less area in no larger pixels than the other."""
    areas, pixels = (one.area_mm2, other.area_mm2), (one.true_pixel_mm, other.true_pixel_mm)
    if areas[0] is None or areas[1] is None or pixels[0] is None or pixels[1] is None:
        return False
    return areas[0] >= areas[1] and pixels[0] <= pixels[1]


def _count(one: SensorRow) -> int:
    return math.prod(one.pixels or (0,))


def claims() -> dict[str, PaperClaim]:
    """Every claim by a short name, in the order in which a reader wants them."""
    drawn, printed = (reduction(s.size_mm) for s in (PREDECESSOR_DRAWN, PREDECESSOR))
    measure, near = nearest_measure()
    others = [s for s in IN_TABLE if s is not DELTACT]
    by_volume = rank([s.volume_mm3 for s in others], DELTACT.volume_mm3)
    by_area = rank([-(s.area_mm2 or 0) for s in others], -(DELTACT.area_mm2 or 0))
    by_pixel = rank([s.true_pixel_mm or 0 for s in others], DELTACT.true_pixel_mm or 0)
    by_count = rank([-_count(s) for s in others], -_count(DELTACT))
    smaller = [s.name for s in others if s.volume_mm3 < DELTACT.volume_mm3]
    better = [s.name for s in others if not_worse(s, DELTACT)]
    area = 1 - (DELTACT.area_mm2 or 0) / (PREDECESSOR.area_mm2 or 1)
    return {
        "third": PaperClaim(
            "the size is reduced by one-third compared to the FingerVision sensor (du2021high)",
            "Discussion and Conclusion",
            "no",
            f"by volume {100 * drawn:.0f} % smaller than the figure's 51 x 65 x 52 mm, and "
            f"{1 - printed:.1f} times as large as the table's 20 x 20 x 26 mm; a third is nearest "
            f"to the {measure} ({100 * near:.0f} %) of the figure's",
        ),
        "smaller": PaperClaim(
            "the size is significantly reduced compared to the previous sensors",
            "Hardware Design, with the figure",
            "yes, by the figure; no, by the table",
            f"by volume {100 * drawn:.0f} % (FingerVision) and "
            f"{100 * reduction(GECKO.size_mm):.0f} % (Gecko-enhanced) smaller than drawn",
        ),
        "same area": PaperClaim(
            "the sensing area is almost maintained the same",
            "Hardware Design",
            "nearly",
            f"675 for 756 mm², {100 * area:.0f} % less",
        ),
        "large area": PaperClaim(
            "a large sensing area at a higher resolution",
            "Discussion and Conclusion",
            "no" if better else "yes",
            f"place {by_area} of {len(IN_TABLE)} by area, {by_pixel} by pixel size and "
            f"{by_count} by number of pixels; "
            + (
                f"{', '.join(better)} is no worse in both"
                if better
                else "none of the others has as much area in pixels as small"
            ),
        ),
        "compact": PaperClaim(
            "with a compact size",
            "Discussion and Conclusion",
            "hardly",
            f"place {by_volume} of {len(IN_TABLE)} by volume; smaller: {', '.join(smaller)}",
        ),
        "pixel": PaperClaim(
            "a pixel is 0.037 mm wide",
            "Sensor Comparison",
            "cut off, not rounded",
            f"675 mm² in 798 x 586 pixels is {DELTACT.true_pixel_mm:.4f} mm; 0.037 mm would be "
            f"{0.037**2 * 798 * 586:.0f} mm²",
        ),
    }


def contradiction() -> str:
    """What the paper's two sizes of one predecessor say about each other."""
    largest = max(a * b for a, b in itertools.combinations(PREDECESSOR.size_mm, 2))
    return (
        "Table and figure contradict each other on that predecessor: 20 x 20 x 26 mm and "
        "51 x 65 x 52 mm. The table's is TacTip's, digit by digit, and its largest side "
        f"({largest:.0f} mm²) cannot hold the {PREDECESSOR.area_mm2:.0f} mm² that the same row "
        "gives as sensing area; the figure's is the one to believe."
    )
