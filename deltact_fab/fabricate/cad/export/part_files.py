"""Make the files of one part, or of the assembly, as bytes; runs in a worker."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from deltact_fab.common import InputError, Point, RunFailed, did_you_mean

from ..build import build_part
from ..dimensions import Design
from ..kernel import Extent, SolidProperties, enclosing, guarded, shifted
from ..mesh import Mesh, mesh_solid
from ..overhangs import lay_on_platform
from ..part import BOUGHT_PROCESS, LASER_CUT, MACHINED_PROCESS, PRINT_PROCESS, Matrix, Part
from . import dxf, meshes, step

if TYPE_CHECKING:
    from ..drafting.page import DrawingPage

ASSEMBLY_NAME, WIRING_NAME = "assembly", "wiring"
EXPORT_FORMATS = ("step", "stl", "3mf", "dxf", "glb", "svg", "pdf")
DRAWING_FORMATS = ("svg", "pdf")
MESH_FORMATS = ("stl", "3mf", "glb")
PRINT_FORMATS = ("stl", "3mf")
PROCESS_FOLDERS = {
    PRINT_PROCESS: "print",
    LASER_CUT: "laser",
    MACHINED_PROCESS: "machine",
    BOUGHT_PROCESS: "order",
}
"""Folder of the files of each process."""
ASSEMBLY_FOLDER = "assembly"  # of what is cast, wired and assembled


@dataclass(frozen=True)
class PartFile:
    """One file. volume and box are the exact solid's, also for a mesh.

    file: path in the export's folder, below a folder of its process.
    mesh_deviation_mm: measured distance of the mesh from the surface; None without a mesh.
    turned: rotation from the part's frame to the printer's, for files to print; the box is then
    the mesh's, on z = 0 and centred at x = y = 0.
    """

    part: str
    file: str
    material: str
    process: str
    quantity: int
    volume_mm3: float
    bounding_box_mm: Extent
    mesh_deviation_mm: float | None
    sha256: str
    turned: Matrix | None = None


FileData = tuple[PartFile, bytes]


@dataclass(frozen=True)
class ExportTask:
    """Job of a worker: one part in some formats, or (all parts of the sensor) the assembly as STEP
    and the wiring drawing.
    """

    parts: tuple[Part, ...]
    formats: tuple[str, ...]
    design: Design
    tolerance_mm: float
    document: str = "part drawing"
    """Kind of document in a drawing's title block."""

    @property
    def name(self) -> str:
        """Name of the task in progress messages."""
        return self.parts[0].name if len(self.parts) == 1 else ASSEMBLY_NAME


def checked_formats(formats: Sequence[str]) -> tuple[str, ...]:
    """Return the formats once each, in fixed order. Raises InputError naming an unknown one."""
    wanted_formats = [f.strip().lower() for f in formats if f.strip()]
    if not wanted_formats:
        raise InputError(f"format: none given; valid: {', '.join(EXPORT_FORMATS)}")
    for name in wanted_formats:
        if name not in EXPORT_FORMATS:
            raise InputError(f"format {name!r}: unknown; {did_you_mean(name, EXPORT_FORMATS)}")
    return tuple(f for f in EXPORT_FORMATS if f in wanted_formats)


def part_formats(part: Part, formats: Sequence[str]) -> tuple[str, ...]:
    """Return the formats that apply to a part: no meshes of bought parts, dxf of laser-cut ones."""
    to_make = part.process != BOUGHT_PROCESS
    apply = {
        **dict.fromkeys(EXPORT_FORMATS, True),
        **dict.fromkeys(PRINT_FORMATS, to_make),
        **dict.fromkeys(DRAWING_FORMATS, part.callouts is not None),
        "dxf": part.process == LASER_CUT,
    }
    return tuple(f for f in formats if apply[f])


def make(task: ExportTask) -> list[FileData]:
    """Build and gate a part and make its files. Raises RunFailed naming the part."""
    if len(task.parts) > 1:
        return [_sensor_file(task, kind) for kind in task.formats]
    (part,) = task.parts
    solid, measured = build_part(part, task.design)
    results = []
    mesh: Mesh | None = None
    page: DrawingPage | None = None
    # Meshes last: they leave triangles on the solid.
    for kind in sorted(task.formats, key=lambda f: (f in MESH_FORMATS, EXPORT_FORMATS.index(f))):
        box_mm, deviation_mm, turned = measured.box_mm, None, None
        with guarded(part.name):
            if kind in MESH_FORMATS:
                mesh = mesh or _mesh(solid, measured, task)
                deviation_mm, printed_mesh = mesh.deviation_mm, mesh
                if part.printed and kind in PRINT_FORMATS:
                    printed_mesh, turned = lay_on_platform(mesh, part.pose), part.pose.turn
                    box_mm = printed_mesh.box_mm
                data = _mesh_bytes(printed_mesh, part, kind)
            elif kind in DRAWING_FORMATS:
                from ..drafting.drawing import drawing

                page = page or drawing(part, task.design, solid, task.document)
                data = _page_bytes(page, kind)
            elif kind == "step":
                data = step.part_bytes(solid, part.name)
            else:
                laser = task.design.laser
                kerf_mm = laser.kerf_mm if laser.compensate else 0.0
                data = dxf.dxf_bytes(solid, part.name, kerf_mm / 2)
        about = part.material, part.process, part.quantity
        size = measured.volume_mm3, box_mm, deviation_mm
        results.append(_describe_file(part.name, kind, data, about, size, turned))
    return results


def assembly_file(
    name: str, kind: str, data: bytes, parts: Sequence[tuple[float, Extent, Sequence[Point]]],
    deviation_mm: float | None = None,
) -> FileData:  # fmt: skip
    """Return a file of an assembly of (volume, box, positions), one position per copy."""
    volume_mm3 = sum(volume * len(places) for volume, _, places in parts)
    box_mm = enclosing(shifted(box, shift) for _, box, places in parts for shift in places)
    about = "", "wired" if name == WIRING_NAME else "assembled", 1
    return _describe_file(name, kind, data, about, (volume_mm3, box_mm, deviation_mm))


def _describe_file(
    name: str, kind: str, data: bytes, about: tuple[str, str, int],
    size: tuple[float, Extent, float | None], turned: Matrix | None = None,
) -> FileData:  # fmt: skip
    """Return a file with its entry in the manifest."""
    sha = hashlib.sha256(data).hexdigest()
    folder = PROCESS_FOLDERS.get(about[1], ASSEMBLY_FOLDER)
    return PartFile(name, f"{folder}/{name}.{kind}", *about, *size, sha, turned), data


def _sensor_file(task: ExportTask, kind: str) -> FileData:
    if kind in DRAWING_FORMATS:
        from ..drafting.wiring import wiring

        page = wiring(task.design)
        sheet: Extent = ((0.0, 0.0, 0.0), (*page.size_mm, 0.0))
        data = _page_bytes(page, kind)
        return assembly_file(WIRING_NAME, kind, data, [(0.0, sheet, meshes.AT_ORIGIN)])
    products, sizes = [], []
    for part in task.parts:
        solid, measured = build_part(part, task.design)
        places = part.places(task.design)
        products.append((part.name, solid, places))
        sizes.append((measured.volume_mm3, measured.box_mm, places))
    with guarded(ASSEMBLY_NAME):
        data = step.assembly_bytes(products, ASSEMBLY_NAME)
    return assembly_file(ASSEMBLY_NAME, kind, data, sizes)


def _page_bytes(page: DrawingPage, kind: str) -> bytes:
    return page.svg().encode() if kind == "svg" else page.pdf()


def _mesh_bytes(mesh: Mesh, part: Part, kind: str) -> bytes:
    if kind == "stl":
        return meshes.stl_bytes(mesh, part.name)
    if kind == "3mf":
        return meshes.threemf_bytes(mesh, part.name, part.material, part.colour)
    return meshes.glb_bytes(
        {part.name: (meshes.shaded_mesh(mesh, part.name, part.colour), meshes.AT_ORIGIN)}
    )


def _mesh(solid: Any, measured: SolidProperties, task: ExportTask) -> Mesh:
    """Mesh a solid; its volume must agree within area x deviation (normals outwards)."""
    mesh = mesh_solid(solid, task.tolerance_mm, task.name)
    slack_mm3 = measured.area_mm2 * mesh.deviation_mm + 1e-6 * measured.volume_mm3
    if not abs(mesh.volume_mm3 - measured.volume_mm3) <= slack_mm3:
        raise RunFailed(
            f"{task.name}: the mesh encloses {mesh.volume_mm3:.3f} mm3, "
            f"the solid {measured.volume_mm3:.3f}"
        )
    return mesh
