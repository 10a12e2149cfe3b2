"""`study run comparison`: the paper's table of sensors recomputed, own designs in rows beside it.

Paper: "Sensor Comparison", the sentences on size in "Hardware Design" and "Discussion and
Conclusion". Every figure of a sensor is as printed there; what the sensors' own papers say was not
looked up. Nothing is simulated.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import pandas as pd

from .. import catalog
from ..errors import InputError
from ..report.paper_charts import FIGURE, OWN, TABLE, area_against_volume
from ..report.result import Headline, ReportFigure, ReportTable, StudyResult
from .request import StudyRequest

NAME = "comparison"
Size = tuple[float, ...]


class Sensor(NamedTuple):
    """A row. pixels: (width, height), or (pins, 1). pixel_mm: as printed, its digits kept.

    size_mm: outer sides in the order in which they are printed. source: an entry of the paper's
    bibliography, or what it is a design of.
    """

    name: str
    said_in: str
    source: str
    size_mm: Size
    pixels: tuple[int, ...] = ()
    area_mm2: float = math.nan
    pixel_mm: str = ""
    calibrated: str = ""

    @property
    def true_pixel_mm(self) -> float:
        """Side of a square pixel = sqrt(area / number of pixels); nan without an area."""
        return math.sqrt(self.area_mm2 / math.prod(self.pixels))

    @property
    def printed(self) -> str:
        """How the printed pixel size comes from the true one: rounded, cut off, or not at all."""
        if not self.pixel_mm:
            return ""
        step = 10.0 ** -len(self.pixel_mm.partition(".")[2])
        steps, true = round(float(self.pixel_mm) / step), self.true_pixel_mm / step
        return {math.floor(true): "cut off", round(true): "rounded"}.get(steps, "differs")


_VGA = (640, 480)
_DU = "Du et al., RA-L 6(2), 2021"
DELTACT = Sensor("DelTact, the paper's", TABLE, "the paper itself", (39, 60, 30), (798, 586), 675,
                 "0.037", "yes")  # fmt: skip
PREDECESSOR = Sensor("FingerVision (2021), table", TABLE, _DU, (20, 20, 26), _VGA, 756, "0.049",
                     "no")  # fmt: skip
DRAWN = Sensor("FingerVision (2021), figure", FIGURE, _DU, (51, 65, 52), _VGA, 756)
GECKO = Sensor("Gecko-enhanced, figure", FIGURE, "Pang et al., ICRA 2021", (52, 108, 69))
TACTIP = Sensor("TacTip", TABLE, "Ward-Cherrier et al., Soft Robotics 5(2), 2018", (20, 20, 26),
                (162, 1), 628, "1.96", "no")  # fmt: skip
IN_TABLE = (
    Sensor("GelSight (2017)", TABLE, "Dong, Yuan, Adelson, IROS 2017", (40, 80, 40), _VGA, 252,
           "0.028", "yes"),
    Sensor("GelSlim 3.0", TABLE, "Taylor, Dong, Rodriguez, arXiv 2103.12269, 2021", (37, 80, 20),
           _VGA, 675, "0.047", "yes"),
    Sensor("DIGIT", TABLE, "Lambeta et al., RA-L 5(3), 2020", (20, 27, 18), _VGA, 305, "0.031",
           "no"),
    Sensor("FingerVision (2016)", TABLE, "Yamaguchi, Atkeson, Humanoids 2016", (40, 47, 30), _VGA,
           750, "0.049", "yes"),
    Sensor("Sferrazza, D'Andrea", TABLE, "Sensors 19(4), 2019", (50, 50, 43.8), _VGA, 900, "0.054",
           "yes"),
    TACTIP, PREDECESSOR, DELTACT,
)  # fmt: skip

MEASURES: dict[str, Callable[[Size], float]] = {
    "volume": math.prod,
    "surface of the box": lambda s: 2 * (s[0] * s[1] + s[1] * s[2] + s[0] * s[2]),
    "footprint, first x second side": lambda s: s[0] * s[1],
    "diagonal": lambda s: math.hypot(*s),
    "longest side": max,
}
HALF = 0.5  # of the last digit of sides in mm and areas in mm², which are printed whole


def run(asked: StudyRequest) -> StudyResult:
    """The study. `asked.more["design"]`: names or paths of designs besides those of the catalogue.

    Raises InputError for a design that is none, and for options that nothing here depends on.
    """
    for given, option in ((asked.scale, "--scale"), (asked.rig, "--rig"), (asked.runs, "--from")):
        if given:
            raise InputError(f"{option}: the study {NAME} has no use for it: nothing is simulated")
    designs = dict.fromkeys([*catalog.designs(), *map(str, asked.more.get("design") or ())])
    table = sensor_table([*IN_TABLE, DRAWN, GECKO, *map(sensor_of, designs)])
    return StudyResult(
        study=NAME,
        title="Sensors compared",
        simulated=False,
        seed=asked.seed,
        scale=None,
        answer=_answer(),
        headlines=_headlines(),
        tables=(
            ReportTable(
                "sensors",
                "Sensors. As the paper prints them, with pixel size and volume recomputed, and own "
                "designs.",
                table,
            ),
            ReportTable(
                "reductions",
                "By how much the paper's sensor is smaller. Per cent; negative: larger. The paper: "
                "one-third than FingerVision (2021), without saying of what.",
                reduction_table(),
            ),
        ),
        figures=(
            ReportFigure(
                "area-against-volume",
                "Sensing area against outer volume; up and to the left is better. Lines: mm² of "
                "face a cm³ of sensor.",
                lambda: area_against_volume(table),
            ),
        ),
        settings={
            "figures of other sensors": "as the paper prints them; their own papers not looked up",
            "pixel size": "sqrt(sensing area / pixels)",
            "volume": "product of the outer sides",
            "own designs": "outer box of the parts' closed forms, no solid built; area: what the "
            "camera has in view of the face",
        },
        notes=(
            "A volume of a box says nothing of cables, computers and lamps outside it.",
            "TacTip has 162 pins in place of pixels; its area is that of a dome: a half sphere "
            "of 20 mm has 628 mm².",
        ),
    )


def sensor_of(name: str) -> Sensor:
    """A design of the `cad` catalogue, or of a file, as a row. Raises InputError."""
    from ..cad.design import load_design
    from ..cad.envelope import size_mm

    design = load_design(name)
    try:
        outer_mm = size_mm(design)
    except InputError as why:
        raise InputError(f"{name}: {why}") from why
    optics = design.optics
    pixels = optics.image_width_px, optics.image_height_px
    stem = catalog.find("cad", name).stem
    return Sensor(stem, OWN, str(name), outer_mm, pixels, math.prod(optics.view_mm))


def sensor_table(rows: Sequence[Sensor]) -> pd.DataFrame:
    """One row a sensor: as printed, and what follows from it."""
    table = pd.DataFrame(
        {
            "sensor": one.name,
            "from": one.said_in,
            "pixels": " x ".join(map(str, one.pixels)).replace(" x 1", " pins"),
            "sensing_area_mm2": one.area_mm2,
            "pixel_printed_mm": float(one.pixel_mm or "nan"),
            "pixel_recomputed_mm": one.true_pixel_mm,
            "printed_is": one.printed,
            "size_mm": " x ".join(f"{side:g}" for side in one.size_mm),
            "volume_cm3": math.prod(one.size_mm) / 1e3,
            "calibrated": one.calibrated,
            "source": one.source,
        }
        for one in rows
    )  # fmt: skip
    table["area_by_volume_mm2/cm3"] = table["sensing_area_mm2"] / table["volume_cm3"]
    return table


def reduction_table() -> pd.DataFrame:
    """One row a way to measure size, one column a size that the paper prints; per cent smaller."""
    others = (DRAWN, PREDECESSOR, GECKO)
    return pd.DataFrame(
        {"measured by": name, **{one.name: smaller(one.size_mm, of) for one in others}}
        for name, of in MEASURES.items()
    )


def smaller(theirs: Size, of: Callable[[Size], float] = math.prod,
            off: tuple[float, float] = (0, 0)) -> float:  # fmt: skip
    """By how many per cent the paper's sensor is smaller than theirs; negative: larger.

    off: what is added to its sides and to theirs, mm.
    """
    own = of(tuple(side + off[0] for side in DELTACT.size_mm))
    return 100 * (1 - own / of(tuple(side + off[1] for side in theirs)))


def places() -> dict[str, int]:
    """The paper's sensor's places in the paper's table; equal ones share the better."""
    ranked: dict[str, Callable[[Sensor], float]] = {
        "area": lambda s: -s.area_mm2,
        "pixel size": lambda s: s.true_pixel_mm,
        "number of pixels": lambda s: -math.prod(s.pixels),
        "volume": lambda s: math.prod(s.size_mm),
    }
    return {name: 1 + sum(of(s) < of(DELTACT) for s in IN_TABLE) for name, of in ranked.items()}


def _answer() -> tuple[str, ...]:
    largest = max(a * b for a, b in itertools.combinations(PREDECESSOR.size_mm, 2))
    times = 1 - smaller(PREDECESSOR.size_mm) / 100
    found = ", ".join(f"{place} by {name}" for name, place in places().items())
    return (
        "The paper prints two sizes of its predecessor. The table's is TacTip's, and its largest "
        f"side, {largest:.0f} mm², cannot hold the row's {PREDECESSOR.area_mm2:.0f} mm²; by it the "
        f"paper's sensor would be {times:.1f} times as large.",
        f"Among the {len(IN_TABLE)} of the table the sensor's place is {found}.",
    )


def _headlines() -> tuple[Headline, ...]:
    over = "bounds, not 95 %: printed in whole millimetres"
    area, theirs, count = DELTACT.area_mm2, DRAWN.area_mm2, math.prod(DELTACT.pixels)
    cut = sum(one.printed == "cut off" for one in IN_TABLE)
    return (
        Headline(
            "smaller by volume than its predecessor as drawn",
            smaller(DRAWN.size_mm), "%", smaller(DRAWN.size_mm, off=(HALF, -HALF)),
            smaller(DRAWN.size_mm, off=(-HALF, HALF)), over, paper=33.3, told=True,
            remark="51 x 65 x 52 mm; the paper says one-third, and not of what",
        ),
        Headline(
            "smaller by sensing area than its predecessor", 100 * (1 - area / theirs), "%",
            100 * (1 - (area + HALF) / (theirs - HALF)),
            100 * (1 - (area - HALF) / (theirs + HALF)),
            over, remark="the paper: almost maintained the same",
        ),
        Headline(
            "pixel size of the paper's sensor", DELTACT.true_pixel_mm, "mm",
            math.sqrt((area - HALF) / count), math.sqrt((area + HALF) / count), over, paper=0.037,
            remark=f"digits cut off, not rounded, as in {cut} of {len(IN_TABLE)} rows; 0.037 mm "
            f"would be {0.037**2 * count:.0f} mm²",
        ),
    )  # fmt: skip
