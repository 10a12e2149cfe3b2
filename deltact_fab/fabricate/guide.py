"""The build guide, one offline HTML page: print, cast, coat, wire, assemble."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any

import pandas as pd

from deltact_fab.common import (
    Check,
    MissingLibrary,
    Progress,
    format_number,
    html_table,
    require_extra,
    require_pages,
    write_page,
)

from .cad.check.verdict import DesignVerdict, judge_design
from .cad.design import load_indenters
from .cad.dimensions import Design
from .cad.drafting.wiring import wiring
from .cad.fabrication import bom, quantities
from .cad.fabrication.quantities import DEFAULT_FIGURES, gaps
from .cad.overhangs import find_contact, lay_on_platform
from .cad.part import SELF_SUPPORTING_DEG, Part
from .cad.parts.coupons import well_volume_mm3
from .cad.parts.mold import RELEASE_AGENT
from .cad.parts.screw import stock_note
from .cad.registry import list_parts, parts_of_group
from .patterns.quality.measure import measure_quality
from .patterns.recipe import PatternRecipe, load_recipe

# The 3D view, by hand: finer meshes cost bytes; distance in diagonals of the model.
VIEW_TOLERANCE_MM, VIEW_TILT_DEG, VIEW_TURN_DEG, VIEW_DISTANCE = 0.05, -20.0, 35.0, 1.25
MIN_CHANNEL = 0.6  # of a colour's strongest channel, by hand: darker ones show no edges
PRINT_LAYER_MM = 0.05  # by hand, the usual layer of resin printers
PATTERN_WIDTH_MM = 120.0  # of the pattern's picture, by hand: fits the page
QUALITY_PX = 100  # side of the field that is tested for contrast, by hand: more takes longer
CUP_STEP_ML = 50  # by hand: usual sizes of mixing cups

_CAMERA_UNIT = ("camera-screw", "camera", "camera-holder")
_BACK_UNIT = (*_CAMERA_UNIT, "cover")
_LIGHT_UNIT = ("light-holder", *_BACK_UNIT)
_FACE_UNIT = ("skin", "acrylic", "skin-frame")
ASSEMBLY_STEPS: dict[str, tuple[tuple[str, ...], ...]] = {
    "H.1": (("camera-screw",), ("camera",), ("camera-holder",)),
    "H.2": (_CAMERA_UNIT, ("cover",)),
    "H.3": (("light-holder",), _BACK_UNIT),
    "H.4": (("shell",), _LIGHT_UNIT),
    "H.5": (_FACE_UNIT, ("shell", *_LIGHT_UNIT)),
    "H.6": ((*_FACE_UNIT, "shell", *_LIGHT_UNIT), ("screw",)),
    "H.7": ((*_FACE_UNIT, "shell", *_LIGHT_UNIT, "screw"),),
    "H.9": ((*_FACE_UNIT, "shell", *_LIGHT_UNIT, "screw"),),
}
"""Layers joined by each step of the assembly, from the face backwards."""
FROM_BEHIND = ("H.7",)  # steps at the cable's notch
ASSEMBLED_STEP = "H.9"
# Headings of the tables.
BATCH_HEADS = ["cavities filled", "part A, g", "part B, g", "mixture, ml"]
PROCESS_HEADS = {"key": "figure", "meaning": "meaning", "basis": "basis"}
GAP_HEADS = {"said": "paper", "found": "finding", "chosen": "this design"}


@dataclass(frozen=True)
class Pictures:
    """Pictures that need the CAD kernel; empty without it, `note` gives the reason.

    Data URLs: exploded, bench, parts (by name) and steps (by number), all SVG. model: HTML page
    with the exploded sensor in 3D. ceilings: overhangs of each printed part as text, by name.
    """

    exploded: str = ""
    bench: str = ""
    parts: dict[str, str] = field(default_factory=dict)
    model: str = ""
    steps: dict[str, str] = field(default_factory=dict)
    ceilings: dict[str, str] = field(default_factory=dict)
    note: str = ""

    @property
    def assembled(self) -> str:
        """Picture of the assembled sensor, shown where the 3D model cannot be."""
        return self.steps.get(ASSEMBLED_STEP, "")


Examples = Callable[[Design, PatternRecipe], Mapping[str, tuple[bytes, bytes]]]
"""Returns JPEG images of a good and a faulty specimen, for `print` and the `sensor`'s view."""


def write_guide(
    design: Design,
    out: Path,
    sensors: int = 1,
    progress: Progress | None = None,
    *,
    examples: Examples,
    pictures: Pictures | None = None,
    verdict: DesignVerdict | None = None,
    force: bool = False,
) -> Path:
    """Write the guide of a design to one self-contained file, headed by the verdict of its checks.

    progress: called with (done, total, text). examples: simulated images of a good and a faulty
    print and sensor. pictures: ready-made ones. verdict: that of the design; None: of all checks,
    cached. force: write the guide of a design that fails, marked as not to be built. Without the
    CAD kernel the page has no pictures and 3D view and names the package to install. Raises
    InputError for a failed rule or a count below 1, MissingLibrary without the extra `report` or
    shapely, RunFailed if a check fails, or a part cannot be built or written.
    """
    require_pages()
    require_extra("cad", "the guide's wiring diagram", "shapely")
    tell = progress or (lambda *_: None)
    lines = bom.bom_lines(design, sensors)
    verdict = verdict or judge_design(design, "design", tell)
    verdict.require(force)
    parts = list_parts(design=design)
    if pictures is None:
        try:
            pictures = draw(design, parts, tell)
        except MissingLibrary as error:
            pictures = Pictures(note=f"No pictures and no 3D view: {error}")
    pattern = sticker(design, examples)
    return write_page(
        out,
        "guide.html",
        _guide_checks(design, verdict, pictures, pattern),
        d=design,
        sensors=sensors,
        parts=parts,
        layer_mm=PRINT_LAYER_MM,
        pictures=pictures,
        bom=html_table(pd.DataFrame([_bom_row(line) for line in lines])),
        stock_note=stock_note(design),
        q=quantities,
        f=_figures(design),
        batches=html_table(
            pd.DataFrame(
                [str(count)]
                + [format_number(x, 1) for x in (batch.a_g, batch.b_g, batch.volume_cm3)]
                for count in range(1, quantities.cavities(design) + 1)
                for batch in (quantities.skins_batch(design, count),)
            ).set_axis(BATCH_HEADS, axis="columns")
        ),
        wiring=_svg_url(wiring(design).svg()),
        p=DEFAULT_FIGURES,
        sticker=pattern,
        facts=quantities.FABRICATION_FIGURES,
        process=html_table(
            pd.DataFrame(quantities.FABRICATION_FIGURES, dtype=object), PROCESS_HEADS
        ),
        gaps=html_table(pd.DataFrame(gaps(design)), GAP_HEADS),
        unverified=[(key, f"{attrgetter(key)(design):g}") for key in design.unverified()],
        # Keys that list measured dimensions, for sections with unverified ones.
        measured=[
            f"{section}.measured"
            for section in dict.fromkeys(key.partition(".")[0] for key in design.unverified())
            if hasattr(getattr(design, section), "measured")
        ],
        self_supporting_deg=SELF_SUPPORTING_DEG,
        release_agent=RELEASE_AGENT,
        indenters=len(load_indenters().indenter),
    )


def _guide_checks(
    design: Design, verdict: DesignVerdict, pictures: Pictures, pattern: PatternToPrint
) -> Iterator[Check]:
    """Yield the checks at the top of the page."""
    yield from verdict.findings()
    if n := len(design.unverified()):
        text = (
            f"{n} dimensions are assumed, not measured: measure yours before you print (list in "
            "the last section)."
        )
        yield Check("unverified", value=text, status="warn")
    else:
        yield Check("unverified", value="All dimensions are marked as measured.")
    yield from Check.warnings("pages", (line for line in (pictures.note, pattern.unseen) if line))


def draw(design: Design, parts: Sequence[Part], tell: Progress) -> Pictures:
    """Build and draw every part, the exploded sensor, each step, and the test bench.

    Raises MissingLibrary without the CAD kernel, RunFailed if a part cannot be built.
    """
    from .cad.assembly import PlacedPart, assemble_bench, assemble_sensor
    from .cad.build import build_part
    from .cad.drafting import picture
    from .cad.drafting.casting import CastingScenes
    from .cad.export.meshes import glb_bytes, shaded_mesh
    from .cad.kernel import require
    from .cad.mesh import mesh_solid

    require()
    require_extra("cad", "the guide's 3D view", "trimesh")
    total = len(parts) + len(ASSEMBLY_STEPS) + 3
    solids: dict[str, Any] = {}
    images: dict[str, str] = {}
    for index, part in enumerate(parts):
        tell(index, total, part.name)
        solids[part.name] = build_part(part, design)[0]
        alone = [PlacedPart(part, 0, solids[part.name], (0.0, 0.0, 0.0))]
        # An indenter stands on its stem.
        view = picture.TIPS_UP if part.indenter is not None else picture.CORNER_VIEW
        drawing = picture.picture_svg(part.name, alone, view, picture.PART_ROOM_MM, numbered=False)
        images[part.name] = _svg_url(drawing)
    tell(len(parts), total, "exploded view")
    sensor_parts = assemble_sensor(design, 1.0, parts_of_group("sensor", design), solids)
    view, room_mm = picture.EXPLODED_VIEW, picture.EXPLODED_MM
    exploded = picture.picture_svg("exploded view", sensor_parts, view, room_mm)
    steps: dict[str, str] = {}
    for step, scene in CastingScenes(design, solids).steps():
        tell(len(parts), total, f"step {step}")
        steps[step] = _svg_url(picture.picture_svg(f"step {step}", scene))
    for index, (step, layers) in enumerate(ASSEMBLY_STEPS.items(), len(parts) + 1):
        tell(index, total, f"step {step}")
        view = picture.FROM_BACK if step in FROM_BEHIND else picture.EXPLODED_VIEW
        scene = picture.stack_layers(design, layers, solids)
        steps[step] = _svg_url(picture.picture_svg(f"step {step}", scene, view))
    tell(total - 2, total, "test bench")
    bench = ""
    if tip := next((part for part in parts if part.indenter is not None), None):
        scene = assemble_bench(design, tip, solids)
        bench = _svg_url(picture.picture_svg("test bench", scene, room_mm=picture.BENCH_ROOM_MM))
    tell(total - 1, total, "3D view")
    # Meshes last: OCCT stores the triangles in the solids.
    fine = {p.name: mesh_solid(solids[p.name], VIEW_TOLERANCE_MM, p.name) for p in parts}
    ceilings = {
        p.name: find_contact(lay_on_platform(fine[p.name], p.pose)).ceilings_text(p.pose.supports)
        for p in parts
        if p.printed
    }
    exploded_glb = {
        part.name: (
            shaded_mesh(fine[part.name], part.name, _brighten(part.colour)),
            [(x, y, z + part.explode_mm) for x, y, z in part.places(design)],
        )
        for part in parts_of_group("sensor", design)
    }
    model = turntable(glb_bytes(exploded_glb))
    tell(total, total, "done")
    return Pictures(_svg_url(exploded), bench, images, model, steps, ceilings)


def _bom_row(line: bom.BomLine) -> dict[str, str]:
    """Table row of a line of the bill of materials."""
    amount = format_number(line.quantity, 2 if line.unit == "ml" else 1)
    order = "made"
    if line.source is not None:
        second, alternative = line.source.second_source, line.source.instead
        order = str(line.source)
        order += f"; or {second}" * (not second.startswith("not "))
        order += f"; {alternative}" * (alternative != "not looked up")
    return {
        "part": f"{line.item}. {line.part}",
        "specification": line.material if line.source else f"{line.material}; {line.process}",
        "quantity": f"{amount} {line.unit}",
        "note": line.note,
        "to order": order,
    }


@dataclass(frozen=True)
class PatternToPrint:
    """The pattern to print for a design.

    file: the recipe, unless it is a shipped one. image: data URL of the visible part, one pixel
    per patch; enlarged: its magnification on the page. pairs: images of a good and a faulty print
    and sensor. unseen: warning if the camera does not resolve it (model of `pattern quality`).
    """

    size_mm: float
    file: str
    image: str
    enlarged: float
    pairs: dict[str, list[str]]
    unseen: str


def sticker(design: Design, examples: Examples) -> PatternToPrint:
    """Return the recommended pattern, in the size for the design."""
    from PIL import Image

    recipe, view_mm = load_recipe(), design.optics.view_mm
    shipped, recipe = recipe, recipe.fitted(view_mm, design.skin.face_mm)
    file = "" if recipe == shipped else recipe.file_text()
    patches, patch_mm = recipe.patches(), recipe.patch_mm or recipe.printed_mm
    columns, rows = (min(round(side / patch_mm), len(patches)) for side in view_mm)
    column, row = (len(patches) - columns) // 2, (len(patches) - rows) // 2
    buffer = io.BytesIO()
    Image.fromarray(patches[row : row + rows, column : column + columns]).save(buffer, "PNG")
    image = _data_url("image/png", buffer.getvalue())
    pairs = {
        subject: [_data_url("image/jpeg", data) for data in pair]
        for subject, pair in examples(design, recipe).items()
    }
    bare, mm_per_px = recipe.model_copy(update={"dots": None}), design.optics.mm_per_px
    field_mm = (QUALITY_PX * mm_per_px,) * 2
    resolved = measure_quality(bare, mm_per_px=mm_per_px, view_mm=field_mm).seen
    unseen = "" if resolved else (
        "The camera of this design hardly resolves the pattern below (model of `pattern quality`). "
        f"Find a coarser one: `study run pattern-search --mm-per-px {mm_per_px:.4g}`."
    )  # fmt: skip
    return PatternToPrint(recipe.size_mm, file, image, PATTERN_WIDTH_MM / view_mm[0], pairs, unseen)


def turntable(glb: bytes) -> str:
    """HTML page with a turnable model, by the three.js (MIT) of trimesh."""
    from trimesh import load_scene
    from trimesh.scene import Camera
    from trimesh.viewer.notebook import scene_to_html

    scene = load_scene(io.BytesIO(glb), file_type="glb")
    angles = (math.radians(VIEW_TILT_DEG), math.radians(VIEW_TURN_DEG), 0.0)
    # A fixed name: random ones change the bytes, a part's name would be that part's node.
    scene.camera = Camera("viewpoint", fov=(60, 45))
    scene.set_camera(angles, distance=VIEW_DISTANCE * scene.scale)
    return str(scene_to_html(scene))


def _brighten(colour: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    red, green, blue, alpha = colour
    gain = max(1.0, MIN_CHANNEL / max(red, green, blue))
    return red * gain, green * gain, blue * gain, alpha


def _figures(d: Design) -> dict[str, Any]:
    """Figures of the steps that are no dimension or quantity."""
    screw = d.screw
    deepest_mm = screw.length_mm + screw.tip_clearance_mm
    full = quantities.skins_batch(d, quantities.cavities(d))
    coupon_g = d.coupon.wells * well_volume_mm3(d) / 1000 * DEFAULT_FIGURES.density_g_cm3
    return {
        "cup_ml": CUP_STEP_ML
        * math.ceil(full.volume_cm3 * DEFAULT_FIGURES.foam_factor / CUP_STEP_ML),
        # Half as much again for two drops and the rest in the cup.
        "coupon_g": max(1.5 * coupon_g, DEFAULT_FIGURES.coat_batch_g),
        "brighter": quantities.resistor_for_ohm(20.0, d.light),
        "shrinkage_mm": quantities.shrinkage_mm(d),
        "longer_mm": [mm for mm in screw.row.stock_mm if screw.length_mm < mm <= deepest_mm],
    }


def _svg_url(svg: str) -> str:
    return _data_url("image/svg+xml", svg.encode())


def _data_url(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
