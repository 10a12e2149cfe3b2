"""One offline HTML page by which a sensor is made: print, cast, coat, wire, assemble."""

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
    toml_text,
    write_page,
)

from .cad.design import load_indenters
from .cad.dimensions import Design
from .cad.drafting.wiring import wiring
from .cad.fabrication import bom, quantities
from .cad.fabrication.quantities import DEFAULT, gaps
from .cad.overhangs import laid, stand
from .cad.part import SELF_SUPPORTING_DEG, Part
from .cad.parts.coupons import well_volume_mm3
from .cad.parts.mold import RELEASE_AGENT
from .cad.parts.screw import stock_note
from .cad.registry import list_parts, parts_of_group
from .patterns.quality.measure import measure_quality
from .patterns.recipe import PatternRecipe, load_recipe

VIEW_TOLERANCE_MM = 0.05  # the view is looked at, not measured
VIEW_DOWN_DEG, VIEW_ROUND_DEG, VIEW_AWAY = -20.0, 35.0, 1.25  # the last in diagonals of the model
DARKEST = 0.6  # of a colour's strongest channel: the view's one lamp leaves black without edges
LAYER_MM = 0.05
PLACED_MM = 1.0  # by which a sticker is larger than the view, for a hand that places it
SHOWN_MM = 120.0  # width of the pattern's picture on the page
QUALITY_PX = 100  # of the view, in which it is measured whether the camera sees the pattern
CUP_ML = 50  # cups are sold in steps of it

_BOARD = ("camera-screw", "camera", "camera-holder")
_BACK = (*_BOARD, "cover")
_STACK = ("light-holder", *_BACK)
_FACE = ("skin", "acrylic", "skin-frame")
STEPS: dict[str, tuple[tuple[str, ...], ...]] = {
    "H.1": (("camera-screw",), ("camera",), ("camera-holder",)),
    "H.2": (_BOARD, ("cover",)),
    "H.3": (("light-holder",), _BACK),
    "H.4": (("shell",), _STACK),
    "H.5": (_FACE, ("shell", *_STACK)),
    "H.6": ((*_FACE, "shell", *_STACK), ("screw",)),
    "H.7": ((*_FACE, "shell", *_STACK, "screw"),),
    "H.9": ((*_FACE, "shell", *_STACK, "screw"),),
}
"""What each step of the assembly brings together, from the face backwards."""
FROM_BEHIND = ("H.7",)  # what is done there is done at the cable's notch
WHOLE = "H.9"
# Heads of the tables of dataclasses.
BATCH = ["cavities filled", "part A, g", "part B, g", "mixture, ml"]
PROCESS = {"key": "figure", "meaning": "what it is", "basis": "rests on"}
GAPS = {"said": "the paper", "found": "what is found", "chosen": "what was chosen"}


@dataclass(frozen=True)
class Pictures:
    """What the kernel adds to the page; empty without it, and `note` says why.

    Data URLs: exploded, bench, parts (by name) and steps (by number), all SVG. model: a page of its
    own in which the exploded sensor is turned.
    ceilings: what of a printed part hangs as it lies on the platform, in words, by name.
    """

    exploded: str = ""
    bench: str = ""
    parts: dict[str, str] = field(default_factory=dict)
    model: str = ""
    steps: dict[str, str] = field(default_factory=dict)
    ceilings: dict[str, str] = field(default_factory=dict)
    note: str = ""

    @property
    def whole(self) -> str:
        """The sensor put together: what stands where its model cannot be turned."""
        return self.steps.get(WHOLE, "")


Examples = Callable[[Design, PatternRecipe], Mapping[str, tuple[bytes, bytes]]]
"""Makes JPEG images of a good and a spoiled specimen: of the `print` and of the `sensor`'s view."""


def write_guide(
    design: Design,
    out: Path,
    sensors: int = 1,
    progress: Progress | None = None,
    *,
    examples: Examples,
    pictures: Pictures | None = None,
) -> Path:
    """Write the guide of a design to one self-contained file; no part of it is fetched.

    progress: called with (done, total, what). examples: images of a good and a spoiled print and
    sensor, simulated. pictures: ready ones, instead of drawing them.
    Without the CAD kernel the page is written without pictures and 3D view and says what to
    install. Raises InputError for a broken rule or a count below 1, MissingLibrary without
    the extra `report` or shapely, RunFailed when a part cannot be built or the disk refuses.
    """
    require_pages()
    require_extra("cad", "the guide's wiring diagram", "shapely")
    tell = progress or (lambda done, total, what: None)
    lines = bom.bom_lines(design, sensors)
    parts = list_parts(design=design)
    if pictures is None:
        try:
            pictures = draw(design, parts, tell)
        except MissingLibrary as why:
            pictures = Pictures(note=f"No pictures and no 3D view: {why}")
    pattern = sticker(design, examples)
    return write_page(
        out,
        "guide.html",
        _judged(design, pictures, pattern),
        d=design,
        sensors=sensors,
        parts=parts,
        layer_mm=LAYER_MM,
        pictures=pictures,
        bom=html_table(pd.DataFrame([_to_order(line) for line in lines])),
        stock_note=stock_note(design),
        q=quantities,
        f=_figures(design),
        batches=html_table(
            pd.DataFrame(
                [str(count)]
                + [format_number(x, 1) for x in (batch.a_g, batch.b_g, batch.volume_cm3)]
                for count in range(1, quantities.cavities(design) + 1)
                for batch in (quantities.skins_batch(design, count),)
            ).set_axis(BATCH, axis="columns")
        ),
        wiring=_svg_url(wiring(design).svg()),
        p=DEFAULT,
        sticker=pattern,
        facts=quantities.FIGURES,
        process=html_table(pd.DataFrame(quantities.FIGURES, dtype=object), PROCESS),
        gaps=html_table(pd.DataFrame(gaps(design)), GAPS),
        unverified=[(key, f"{attrgetter(key)(design):g}") for key in design.unverified()],
        # Keys that take the names of what a lab has measured, where something is unverified.
        measured=[
            f"{section}.measured"
            for section in dict.fromkeys(key.partition(".")[0] for key in design.unverified())
            if hasattr(getattr(design, section), "measured")
        ],
        self_supporting_deg=SELF_SUPPORTING_DEG,
        release_agent=RELEASE_AGENT,
        indenters=len(load_indenters().indenter),
    )


def _judged(design: Design, pictures: Pictures, pattern: PatternToPrint) -> Iterator[Check]:
    """What speaks for the design, and what is to be seen to before it is printed."""
    yield Check("rules", value="The dimensions of this design go together by all their rules.")
    if n := len(design.unverified()):
        text = (
            f"{n} dimensions were assumed and never measured: measure yours before you print "
            "(the last section names them)."
        )
        yield Check("unverified", value=text, status="warn")
    else:
        yield Check("unverified", value="All dimensions are marked as measured.")
    yield from Check.warnings("pages", (line for line in (pictures.note, pattern.unseen) if line))


def draw(design: Design, parts: Sequence[Part], tell: Progress) -> Pictures:
    """Build every part once and draw it; the sensor exploded, at each step, and on the test bench.

    Raises MissingLibrary without the CAD kernel, RunFailed when a part cannot be built.
    """
    from .cad.assembly import PlacedPart, assemble_bench, assemble_sensor
    from .cad.build import build_part
    from .cad.drafting import picture
    from .cad.drafting.casting import Bench
    from .cad.export.meshes import drawn, glb_bytes
    from .cad.kernel import require
    from .cad.mesh import mesh_solid

    require()
    require_extra("cad", "the guide's 3D view", "trimesh")
    total = len(parts) + len(STEPS) + 3
    solids: dict[str, Any] = {}
    images: dict[str, str] = {}
    for done, part in enumerate(parts):
        tell(done, total, part.name)
        solids[part.name] = build_part(part, design)[0]
        alone = [PlacedPart(part, 0, solids[part.name], (0.0, 0.0, 0.0))]
        # An indenter stands on its stem.
        view = picture.TIPS_UP if part.indenter is not None else picture.CORNER
        drawing = picture.picture_svg(part.name, alone, view, picture.PART_MM, numbered=False)
        images[part.name] = _svg_url(drawing)
    tell(len(parts), total, "exploded view")
    apart = assemble_sensor(design, 1.0, parts_of_group("sensor", design), solids)
    exploded = picture.picture_svg("exploded view", apart, picture.APART, picture.APART_MM)
    steps: dict[str, str] = {}
    for step, placed in Bench(design, solids).steps():
        tell(len(parts), total, f"step {step}")
        steps[step] = _svg_url(picture.picture_svg(f"step {step}", placed))
    for done, (step, layers) in enumerate(STEPS.items(), len(parts) + 1):
        tell(done, total, f"step {step}")
        view = picture.FROM_BACK if step in FROM_BEHIND else picture.APART
        placed = picture.stacked(design, layers, solids)
        steps[step] = _svg_url(picture.picture_svg(f"step {step}", placed, view))
    tell(total - 2, total, "test bench")
    whole = ""
    if tip := next((part for part in parts if part.indenter is not None), None):
        standing = assemble_bench(design, tip, solids)
        whole = _svg_url(picture.picture_svg("test bench", standing, room_mm=picture.BENCH_MM))
    tell(total - 1, total, "3D view")
    # Meshes last: they leave triangles on the solids.
    fine = {p.name: mesh_solid(solids[p.name], VIEW_TOLERANCE_MM, p.name) for p in parts}
    ceilings = {
        part.name: stand(laid(fine[part.name], part.lies)).words(part.lies.supports)
        for part in parts
        if part.printed
    }
    exploded_glb = {
        part.name: (
            drawn(fine[part.name], part.name, _lit(part.colour)),
            [(x, y, z + part.explode_mm) for x, y, z in part.places(design)],
        )
        for part in parts_of_group("sensor", design)
    }
    model = turntable(glb_bytes(exploded_glb))
    tell(total, total, "done")
    return Pictures(_svg_url(exploded), whole, images, model, steps, ceilings)


def _to_order(line: bom.BomLine) -> dict[str, str]:
    """A line of the bill of materials."""
    amount = format_number(line.quantity, 2 if line.unit == "ml" else 1)
    order = "made"
    if line.source is not None:
        second, instead = line.source.second_source, line.source.instead
        order = str(line.source)
        order += f"; or {second}" * (not second.startswith("not "))
        order += f"; {instead}" * (instead != "not looked up")
    return {
        "part": f"{line.item}. {line.part}",
        "for": line.group,
        "material": line.material or "",
        "process": line.process,
        "quantity": f"{amount} {line.unit}",
        "note": line.note,
        "to order": order,
    }


@dataclass(frozen=True)
class PatternToPrint:
    """The pattern to print for a design: its side, and what the camera sees of it.

    file: the recipe, where it is no shipped one. image: a data URL, one pixel a patch; enlarged: by
    how much it is larger on the page. pairs: a good and a spoiled print and sensor of it. unseen:
    a warning where the camera does not see the pattern, by the model of `pattern quality`.
    """

    size_mm: float
    file: str
    image: str
    enlarged: float
    pairs: dict[str, list[str]]
    unseen: str


def sticker(design: Design, examples: Examples) -> PatternToPrint:
    """The recommended pattern, as large as the design's view needs it."""
    from PIL import Image

    recipe, view_mm = load_recipe(), design.optics.view_mm
    file = ""
    if design.optics.print_shortfall(recipe.printed_mm) is not None:
        patch_mm = recipe.patch_mm or 1.0
        squares = math.ceil((max(view_mm) + PLACED_MM) / patch_mm)
        recipe = recipe.model_copy(update={"size_mm": round(squares * patch_mm, 6)})
        file = toml_text(recipe.model_dump(mode="json", exclude_none=True))
    patches, patch_mm = recipe.patches(), recipe.patch_mm or recipe.printed_mm
    columns, rows = (min(round(side / patch_mm), len(patches)) for side in view_mm)
    left, top = (len(patches) - columns) // 2, (len(patches) - rows) // 2
    held = io.BytesIO()
    Image.fromarray(patches[top : top + rows, left : left + columns]).save(held, "PNG")
    image = _data_url("image/png", held.getvalue())
    pairs = {
        of: [_data_url("image/jpeg", one) for one in pair]
        for of, pair in examples(design, recipe).items()
    }
    bare, mm_per_px = recipe.model_copy(update={"dots": None}), design.optics.mm_per_px
    seen = measure_quality(bare, mm_per_px=mm_per_px, view_mm=(QUALITY_PX * mm_per_px,) * 2).seen
    unseen = "" if seen else (
        "The camera of this design hardly resolves the pattern below, by the model of printer and "
        f"camera of `pattern quality`: `study run pattern-search --mm-per-px {mm_per_px:.4g}` "
        "finds a coarser one."
    )  # fmt: skip
    return PatternToPrint(recipe.size_mm, file, image, SHOWN_MM / view_mm[0], pairs, unseen)


def turntable(glb: bytes) -> str:
    """A page in which a model is turned: three.js (MIT) around it, as trimesh carries it."""
    from trimesh import load_scene
    from trimesh.scene import Camera
    from trimesh.viewer.notebook import scene_to_html

    scene = load_scene(io.BytesIO(glb), file_type="glb")
    angles = (math.radians(VIEW_DOWN_DEG), math.radians(VIEW_ROUND_DEG), 0.0)
    # Unnamed it gets another name each time, and one of a part would be that part's node.
    scene.camera = Camera("viewpoint", fov=(60, 45))
    scene.set_camera(angles, distance=VIEW_AWAY * scene.scale)
    return str(scene_to_html(scene))


def _lit(colour: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    red, green, blue, alpha = colour
    gain = max(1.0, DARKEST / max(red, green, blue))
    return red * gain, green * gain, blue * gain, alpha


def _figures(d: Design) -> dict[str, Any]:
    """What the steps name and no dimension or quantity says."""
    screw = d.screw
    deepest_mm = screw.length_mm + screw.tip_clearance_mm
    full = quantities.skins_batch(d, quantities.cavities(d))
    coupon_g = d.coupon.wells * well_volume_mm3(d) / 1000 * DEFAULT.density_g_cm3
    return {
        "cup_ml": CUP_ML * math.ceil(full.volume_cm3 * DEFAULT.foam_factor / CUP_ML),
        # Half as much again: two drops, and what stays in the cup.
        "coupon_g": max(1.5 * coupon_g, DEFAULT.coat_batch_g),
        "brighter": quantities.resistor_for_ohm(20.0, d.light),
        "shrinkage_mm": quantities.shrinkage_mm(d),
        "longer_mm": [mm for mm in screw.row.stock_mm if screw.length_mm < mm <= deepest_mm],
    }


def _svg_url(svg: str) -> str:
    return _data_url("image/svg+xml", svg.encode())


def _data_url(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
