"""What the paper claims of its sensor's size, area and resolution, against its own figures.

Every figure is the paper's, as printed there ("Sensor Comparison"; `FIGURE`: the caption of the
figure of the three sensors in "Hardware Design"). What the sensors' own papers say was not looked
up: source is the entry of the paper's bibliography.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

Size = tuple[float, float, float]
TABLE, FIGURE = "table", "figure"


@dataclass(frozen=True)
class SensorRow:
    """A row. pixels: (width, height), or (taxels, 1). pixel_mm: as printed, its digits kept.

    size_mm: outer sides in the order in which they are printed. said_in: where in the paper.
    """

    name: str
    cite: str
    source: str
    size_mm: Size
    pixels: tuple[int, int] | None = None
    area_mm2: float | None = None
    pixel_mm: str = ""
    calibrated: bool | None = None
    said_in: str = TABLE

    @property
    def volume_mm3(self) -> float:
        """Of the box: the product of the sides."""
        return math.prod(self.size_mm)

    @property
    def true_pixel_mm(self) -> float | None:
        """Side of a square pixel = sqrt(area / number of pixels)."""
        if self.pixels is None or self.area_mm2 is None:
            return None
        return math.sqrt(self.area_mm2 / math.prod(self.pixels))

    @property
    def printed(self) -> str:
        """How the printed pixel size comes from the true one: rounded, cut off, or not at all."""
        true = self.true_pixel_mm
        if not self.pixel_mm or true is None:
            return ""
        digits = len(self.pixel_mm.partition(".")[2])
        step = 10.0**-digits
        steps = round(float(self.pixel_mm) / step)
        if steps == round(true / step):
            return "rounded"
        return "cut off" if steps == math.floor(true / step) else "differs"


_VGA = (640, 480)

OTHERS = (
    SensorRow(
        "GelSight (2017)", "dong2017improved",
        "S. Dong, W. Yuan, E. H. Adelson, Improved GelSight tactile sensor for measuring geometry "
        "and slip, IROS 2017",
        (40, 80, 40), _VGA, 252, "0.028", True,
    ),
    SensorRow(
        "GelSlim 3.0", "taylor2021gelslim3",
        "I. Taylor, S. Dong, A. Rodriguez, GelSlim3.0: high-resolution measurement of shape, force "
        "and slip in a compact tactile-sensing finger, arXiv 2103.12269, 2021",
        (37, 80, 20), _VGA, 675, "0.047", True,
    ),
    SensorRow(
        "DIGIT", "lambeta2020digit",
        "M. Lambeta et al., DIGIT: a novel design for a low-cost compact high-resolution tactile "
        "sensor with application to in-hand manipulation, RA-L 5(3), 2020",
        (20, 27, 18), _VGA, 305, "0.031", False,
    ),
    SensorRow(
        "FingerVision (2016)", "yamaguchi2016combining",
        "A. Yamaguchi, C. G. Atkeson, Combining finger vision and optical tactile sensing: "
        "reducing and handling errors while cutting vegetables, Humanoids 2016",
        (40, 47, 30), _VGA, 750, "0.049", True,
    ),
    SensorRow(
        "Sferrazza, D'Andrea", "sferrazza2019design",
        "C. Sferrazza, R. D'Andrea, Design, motivation and evaluation of a full-resolution optical "
        "tactile sensor, Sensors 19(4), 2019",
        (50, 50, 43.8), _VGA, 900, "0.054", True,
    ),
    SensorRow(
        "TacTip", "ward2018tactip",
        "B. Ward-Cherrier et al., The TacTip family: soft optical tactile sensors with 3D-printed "
        "biomimetic morphologies, Soft Robotics 5(2), 2018",
        (20, 20, 26), (162, 1), 628, "1.96", False,
    ),
)  # fmt: skip

_DU = (
    "Y. Du, G. Zhang, Y. Zhang, M. Y. Wang, High-resolution 3-dimensional contact deformation "
    "tracking for FingerVision sensor with dense random color pattern, RA-L 6(2), 2021"
)
# One sensor, of two sizes.
PREDECESSOR = SensorRow(
    "FingerVision (2021), table", "du2021high", _DU, (20, 20, 26), _VGA, 756, "0.049", False
)
PREDECESSOR_DRAWN = SensorRow(
    "FingerVision (2021), figure", "du2021high", _DU, (51, 65, 52), _VGA, 756, said_in=FIGURE
)
GECKO = SensorRow(
    "Gecko-enhanced, figure", "pang2021viko",
    "C. Pang et al., Viko: an adaptive gecko gripper with vision-based tactile sensor, ICRA 2021",
    (52, 108, 69), said_in=FIGURE,
)  # fmt: skip
DELTACT = SensorRow(
    "DelTact, the paper's", "deltact", "the paper itself", (39, 60, 30), (798, 586), 675, "0.037",
    True,
)  # fmt: skip
IN_TABLE = (*OTHERS, PREDECESSOR, DELTACT)
CLAIMED_REDUCTION = 1 / 3


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


def _place(of: Callable[[SensorRow], float]) -> int:
    """The paper's sensor's place in the paper's table by a figure, the smallest first."""
    return rank([of(one) for one in IN_TABLE], of(DELTACT))


def claims() -> dict[str, PaperClaim]:
    """Every claim by a short name, in the order in which a reader wants them."""
    drawn, printed = (reduction(s.size_mm) for s in (PREDECESSOR_DRAWN, PREDECESSOR))
    measure, near = nearest_measure()
    smaller = [s.name for s in IN_TABLE if s.volume_mm3 < DELTACT.volume_mm3]
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
            "yes",
            f"place {_place(lambda s: -(s.area_mm2 or 0))} of {len(IN_TABLE)} by area, "
            f"{_place(lambda s: s.true_pixel_mm or 0)} by pixel size and "
            f"{_place(lambda s: -math.prod(s.pixels or (0,)))} by number of pixels; "
            "none of the others has as much area in pixels as small",
        ),
        "compact": PaperClaim(
            "with a compact size",
            "Discussion and Conclusion",
            "hardly",
            f"place {_place(lambda s: s.volume_mm3)} of {len(IN_TABLE)} by volume; smaller: "
            f"{', '.join(smaller)}",
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
