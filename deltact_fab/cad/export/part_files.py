"""One part, or the assembly, to the bytes of its files: what runs in a worker."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ...aliases import Point
from ...errors import InputError, RunFailed, did_you_mean
from ..build import build_part
from ..dimensions import Design
from ..drafting.drawing import drawing
from ..drafting.page import DrawingPage
from ..drafting.wiring import wiring
from ..kernel import guarded
from ..mesh import Mesh, mesh_solid
from ..overhangs import laid
from ..part import BOUGHT, LASER_CUT, Part
from ..solid_gate import Box, SolidProperties, enclosing, shifted
from .formats import dxf, glb, step, stl, threemf

ASSEMBLY, WIRING = "assembly", "wiring"
FORMATS = ("step", "stl", "3mf", "dxf", "glb", "svg", "pdf")
DRAWN = ("svg", "pdf")
MESHED = ("stl", "3mf", "glb")
TO_PRINT = ("stl", "3mf")


@dataclass(frozen=True)
class FileBytes:
    """The bytes of one file. volume and box are the exact solid's, also for a mesh; the box of a
    file to print is the mesh's, as it lies on the platform.

    deviation_mm: measured distance of the mesh from the surface; None where there is no mesh.
    """

    format: str
    data: bytes
    volume_mm3: float
    box_mm: Box
    deviation_mm: float | None


@dataclass(frozen=True)
class Task:
    """What one worker makes at a time: a part in some formats, or (part None) the assembly as STEP
    and the wiring drawing.

    sensor: the parts of the assembly.
    """

    part: Part | None
    formats: tuple[str, ...]
    design: Design
    tolerance_mm: float
    sensor: tuple[Part, ...] = ()


def checked_formats(formats: Sequence[str]) -> tuple[str, ...]:
    """Each known format once, in the order of FORMATS. Raises InputError naming what is unknown."""
    named = [f.strip().lower() for f in formats if f.strip()]
    if not named:
        raise InputError(f"format: none given; valid: {', '.join(FORMATS)}")
    for name in named:
        if name not in FORMATS:
            raise InputError(f"format {name!r}: unknown; {did_you_mean(name, FORMATS)}")
    return tuple(f for f in FORMATS if f in named)


def applicable(part: Part, formats: Sequence[str]) -> tuple[str, ...]:
    """The formats that make sense for a part: none to print what is bought, dxf of what is flat."""
    made = part.process != BOUGHT
    apply = {
        **dict.fromkeys(FORMATS, True),
        **dict.fromkeys(TO_PRINT, made),
        **dict.fromkeys(DRAWN, part.callouts is not None),
        "dxf": part.process == LASER_CUT,
    }
    return tuple(f for f in formats if apply[f])


def on_platform(part: Part, kind: str) -> bool:
    """Whether that file of a part has it as it is printed, not in the frame of the design."""
    return part.printed and kind in TO_PRINT


def make(task: Task) -> list[FileBytes]:
    """Build, gate and write to memory. Raises RunFailed naming the part."""
    if task.part is None:
        return [_of_sensor(task.design, task.sensor, kind) for kind in task.formats]
    part = task.part
    solid, measured = build_part(part, task.design)
    made = []
    mesh: Mesh | None = None
    lying: Mesh | None = None
    page: DrawingPage | None = None
    # Meshes last: they leave triangles on the solid.
    for kind in sorted(task.formats, key=lambda f: (f in MESHED, FORMATS.index(f))):
        with guarded(part.name):
            if kind in MESHED:
                mesh = mesh or _mesh(solid, measured, task)
                if on_platform(part, kind):
                    lying = lying or laid(mesh, part.lies)
                    data, box_mm = _mesh_bytes(lying, part, kind), lying.box_mm
                else:
                    data, box_mm = _mesh_bytes(mesh, part, kind), measured.box_mm
            elif kind in DRAWN:
                page = page or drawing(part, task.design, solid)
                data = page.svg().encode() if kind == "svg" else page.pdf()
                box_mm = measured.box_mm
            else:
                data, box_mm = _solid_bytes(solid, part, task.design, kind), measured.box_mm
        deviation_mm = mesh.deviation_mm if mesh and kind in MESHED else None
        made.append(FileBytes(kind, data, measured.volume_mm3, box_mm, deviation_mm))
    return made


def whole(parts: Sequence[tuple[float, Box, Sequence[Point]]]) -> tuple[float, Box]:
    """Volume and box of an assembly of (volume, box, places), one place a copy."""
    volume_mm3 = sum(volume * len(places) for volume, _, places in parts)
    return volume_mm3, enclosing(shifted(box, at) for _, box, places in parts for at in places)


def whole_name(kind: str) -> str:
    """What a file of the whole sensor is called."""
    return WIRING if kind in DRAWN else ASSEMBLY


def _of_sensor(design: Design, parts: Sequence[Part], kind: str) -> FileBytes:
    if kind == "step":
        return _assembly_step(design, parts)
    page = wiring(design)
    data = page.svg().encode() if kind == "svg" else page.pdf()
    return FileBytes(kind, data, 0.0, ((0.0, 0.0, 0.0), (*page.size_mm, 0.0)), None)


def _assembly_step(design: Design, parts: Sequence[Part]) -> FileBytes:
    products = []
    sizes = []
    for part in parts:
        solid, measured = build_part(part, design)
        where = part.places(design)
        products.append((part.name, solid, where))
        sizes.append((measured.volume_mm3, measured.box_mm, where))
    with guarded(ASSEMBLY):
        data = step.assembly_bytes(products, ASSEMBLY)
    return FileBytes("step", data, *whole(sizes), None)


def _solid_bytes(solid: Any, part: Part, design: Design, kind: str) -> bytes:
    if kind == "step":
        return step.part_bytes(solid, part.name)
    laser = design.laser
    return dxf.dxf_bytes(solid, part.name, laser.kerf_mm / 2 if laser.compensate else 0.0)


def _mesh_bytes(mesh: Mesh, part: Part, kind: str) -> bytes:
    if kind == "stl":
        return stl.stl_bytes(mesh, part.name)
    if kind == "3mf":
        return threemf.threemf_bytes(mesh, part.name, part.material, part.colour)
    return glb.glb_bytes([glb.drawn(mesh, part.name, part.colour)])


def _mesh(solid: Any, measured: SolidProperties, task: Task) -> Mesh:
    """A mesh within d of a surface of area A holds the volume to A d, if it looks outwards."""
    assert task.part is not None
    mesh = mesh_solid(solid, task.tolerance_mm, task.part.name)
    slack_mm3 = measured.area_mm2 * mesh.deviation_mm + 1e-6 * measured.volume_mm3
    if not abs(mesh.volume_mm3 - measured.volume_mm3) <= slack_mm3:
        raise RunFailed(
            f"{task.part.name}: the mesh encloses {mesh.volume_mm3:.3f} mm3, "
            f"the solid {measured.volume_mm3:.3f}"
        )
    return mesh
