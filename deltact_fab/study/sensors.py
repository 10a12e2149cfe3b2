"""The sensors that the paper compares with: its last table and its figure of predecessors, as data.

Every figure is the paper's, as printed there ("Sensor Comparison"; `FIGURE`: the caption of the
figure of the three sensors in "Hardware Design"). What the sensors' own papers say was not looked
up: source is the entry of the paper's bibliography.
"""

from __future__ import annotations

import math
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
