"""`study run comparison`: the paper's table of sensors recomputed, and its claims compared with it.

Paper: "Sensor Comparison", the sentences on size in "Hardware Design" and "Discussion and
Conclusion". Own designs (`cad/*.toml`) stand in rows beside it. Nothing is simulated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import pandas as pd

from .. import catalog
from ..errors import InputError
from ..report.result import Headline, ReportFigure, ReportTable, StudyResult, records
from .request import StudyRequest
from .sensors import (
    CLAIMED_REDUCTION,
    DELTACT,
    GECKO,
    IN_TABLE,
    MEASURES,
    PREDECESSOR,
    PREDECESSOR_DRAWN,
    PaperClaim,
    SensorRow,
    bounds,
    claims,
    contradiction,
    nearest_measure,
    reduction,
)

NAME = "comparison"
OWN = "cad"


def run(asked: StudyRequest) -> StudyResult:
    """The study. `asked.more["design"]`: names or paths of designs besides those of the catalogue.

    Raises InputError for a design that is none, and for options that nothing here depends on.
    """
    for given, option in ((asked.scale, "--scale"), (asked.rig, "--rig"), (asked.runs, "--from")):
        if given:
            raise InputError(f"{option}: the study {NAME} has no use for it: nothing is simulated")
    own = [sensor_of(name) for name in _designs(asked.more.get("design") or ())]
    table = sensor_table([*IN_TABLE, PREDECESSOR_DRAWN, GECKO, *own])
    reductions, said = reduction_table(), claims()
    return StudyResult(
        study=NAME,
        title="Sensors compared",
        verdict=_verdict(said),
        data={
            "claims": [vars(one) for one in said.values()],
            "contradiction": contradiction(),
            "sensors": records(table),
            "reductions": records(reductions),
        },
        simulated=False,
        seed=asked.seed,
        scale=None,
        headlines=_headlines(),
        tables=_tables(table, reductions, said),
        figures=_figures(table),
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


def sensor_of(name: str) -> SensorRow:
    """A design of the `cad` catalogue, or of a file, as a row. Raises InputError."""
    from ..cad.design import load_design
    from ..cad.envelope import size_mm

    design = load_design(name)
    try:
        outer_mm = size_mm(design)
    except InputError as why:
        raise InputError(f"{name}: {why}") from why
    optics = design.optics
    return SensorRow(
        f"own: {catalog.find(OWN, name).stem}",
        "",
        str(name),
        outer_mm,
        (optics.image_width_px, optics.image_height_px),
        math.prod(optics.view_mm),
        said_in=OWN,
    )


def _designs(named: Sequence[str]) -> list[str]:
    """The catalogue's designs, then those that were named and are not among them."""
    found = catalog.designs()
    return [*found, *(n for n in dict.fromkeys(map(str, named)) if n not in found)]


def sensor_table(rows: Sequence[SensorRow]) -> pd.DataFrame:
    """One row a sensor: as printed, and what follows from it."""
    return pd.DataFrame(
        {
            "sensor": one.name,
            "said_in": one.said_in,
            "cite": one.cite,
            "pixels": "" if one.pixels is None else _pixels(one.pixels),
            "area_mm2": one.area_mm2,
            "pixel_printed_mm": float(one.pixel_mm) if one.pixel_mm else math.nan,
            "pixel_mm": math.nan if one.true_pixel_mm is None else one.true_pixel_mm,
            "printed_is": one.printed,
            "size_mm": " x ".join(f"{side:g}" for side in one.size_mm),
            "volume_cm3": one.volume_mm3 / 1e3,
            "area_mm2_per_cm3": (one.area_mm2 or math.nan) / one.volume_mm3 * 1e3,
            "calibrated": {None: "", True: "yes", False: "no"}[one.calibrated],
            "source": one.source,
        }
        for one in rows
    )  # fmt: skip


def _pixels(pixels: tuple[int, int]) -> str:
    return f"{pixels[0]} x {pixels[1]}" if pixels[1] > 1 else f"{pixels[0]} pins"


def reduction_table() -> pd.DataFrame:
    """One row a way to measure size, one column a size that the paper prints; per cent smaller."""
    return pd.DataFrame(
        {
            "measured_by": measure,
            "than_figure_percent": 100 * reduction(PREDECESSOR_DRAWN.size_mm, measure),
            "than_table_percent": 100 * reduction(PREDECESSOR.size_mm, measure),
            "than_gecko_percent": 100 * reduction(GECKO.size_mm, measure),
        }
        for measure in MEASURES
    )


def _verdict(said: Mapping[str, PaperClaim]) -> tuple[str, ...]:
    measure, near = nearest_measure()
    drawn = reduction(PREDECESSOR_DRAWN.size_mm)
    cut = sum(one.printed == "cut off" for one in IN_TABLE)
    return (
        f"The paper's sensor is {100 * drawn:.0f} % smaller by volume than the predecessor of the "
        "paper's figure, not one-third; by the paper's table it is "
        f"{1 - reduction(PREDECESSOR.size_mm):.1f} times as large. A third fits the {measure} best "
        f"({100 * near:.0f} %).",
        contradiction(),
        f"Area and resolution: {said['large area'].figures}. Size: {said['compact'].figures}.",
        f"All pixel sizes of the table follow from area and pixels; {cut} of {len(IN_TABLE)} are "
        "cut off, not rounded, the paper's own (0.037 for 0.0380 mm) among them.",
    )


def _headlines() -> tuple[Headline, ...]:
    over = "bounds, not 95 %: sides are printed in whole millimetres"
    third = 100 * CLAIMED_REDUCTION
    remarks = {
        PREDECESSOR_DRAWN: "the paper says one-third and not of what",
        PREDECESSOR: "the row repeats TacTip's size: larger, not smaller",
        GECKO: "",
    }
    found = []
    for one, remark in remarks.items():
        low, high = (100 * b for b in bounds(one.size_mm))
        found.append(
            Headline(
                f"smaller by volume than {one.name}", 100 * reduction(one.size_mm), "%", low, high,
                over, paper=None if one is GECKO else third, remark=remark,
            )
        )  # fmt: skip
    found.append(
        Headline(
            "pixel size of the paper's sensor", DELTACT.true_pixel_mm or math.nan, "mm",
            math.sqrt(674.5 / (798 * 586)), math.sqrt(675.5 / (798 * 586)),
            "bounds: the area is printed in whole mm²", paper=0.037,
            remark="the table cuts digits off",
        )
    )  # fmt: skip
    return tuple(found)


def _tables(
    table: pd.DataFrame, reductions: pd.DataFrame, said: Mapping[str, PaperClaim]
) -> tuple[ReportTable, ...]:
    from ..report import paper_charts

    return (
        ReportTable("claims", "The paper's claims.", pd.DataFrame(list(said.values()))),
        ReportTable(
            "sensors",
            "Sensors. As the paper prints them, with pixel size and volume recomputed, and own "
            "designs. The sources are in the CSV and in the table below.",
            table.replace({"said_in": paper_charts.WORDS}),
            tuple(str(name) for name in table if name not in ("source", "cite")),
            {
                "said_in": "from",
                "area_mm2": "sensing area, mm²",
                "pixel_printed_mm": "pixel, printed, mm",
                "pixel_mm": "pixel, recomputed, mm",
                "printed_is": "printed one is",
                "size_mm": "size, mm",
                "volume_cm3": "volume, cm³",
                "area_mm2_per_cm3": "area a volume, mm²/cm³",
            },
        ),
        ReportTable(
            "reductions",
            "By how much the paper's sensor is smaller. Per cent; negative: larger. The paper: "
            "one-third, without saying of what.",
            reductions,
            None,
            {
                "measured_by": "measured by",
                "than_figure_percent": "than the figure's FingerVision, 51 x 65 x 52 mm",
                "than_table_percent": "than the table's du2021high, 20 x 20 x 26 mm",
                "than_gecko_percent": "than the figure's Gecko-enhanced, 52 x 108 x 69 mm",
            },
        ),
        ReportTable(
            "sources", "Sources", table.loc[table["cite"] != "", ["sensor", "cite", "source"]]
        ),
    )


def _figures(table: pd.DataFrame) -> tuple[ReportFigure, ...]:
    from ..report import paper_charts

    return (
        ReportFigure(
            "volumes",
            "Outer volume. The paper's predecessor stands twice, for the paper gives it two sizes.",
            lambda: paper_charts.volumes(table),
        ),
        ReportFigure(
            "area-against-volume",
            "Sensing area against outer volume; up and to the left is better. Lines: mm² of face "
            "a cm³ of sensor.",
            lambda: paper_charts.area_against_volume(table),
        ),
    )
