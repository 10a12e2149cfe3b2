"""Parts to files: the same dimensions give the same bytes, in any process."""

from __future__ import annotations

import hashlib
import json
import math
import os
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..errors import InputError, RunFailed, did_you_mean
from .build import build_part, expected
from .checks import Measured
from .dimensions import Design
from .kernel import guarded, require
from .mesh import Mesh, mesh_solid
from .registry import Part

FORMATS = ("step", "stl")
TOLERANCE_MM = (0.001, 1.0)
MANIFEST = "manifest.json"
_DIGITS = 6

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class PartFile:
    """One written file. volume and box are the exact solid's, also for a mesh."""

    part: str
    file: str
    material: str
    process: str
    quantity: int
    volume_mm3: float
    bounding_box_mm: tuple[tuple[float, ...], tuple[float, ...]]
    mesh_deviation_mm: float | None
    sha256: str


def export_parts(
    dims: Design,
    parts: Sequence[Part],
    formats: Sequence[str],
    tolerance_mm: float,
    out_dir: Path,
    progress: Progress | None = None,
) -> list[PartFile]:
    """Write every part in every format and manifest.json into out_dir; return what was written.

    tolerance_mm: largest distance of an STL from the surface; measured, not only asked for.
    progress: called with (done, total, what) before each part and at the end.

    Nothing appears under its name before every part is built, checked and on the disk; the
    manifest comes last. Raises InputError for unusable arguments or dimensions, RunFailed when a
    part cannot be made or the folder cannot be written.
    """
    formats = _checked_formats(formats)
    low, high = TOLERANCE_MM
    if not (math.isfinite(tolerance_mm) and low <= tolerance_mm <= high):
        raise InputError(f"tolerance {tolerance_mm:g} mm: {low:g} to {high:g} mm is right")
    tell = progress or (lambda done, total, what: None)
    out_dir = Path(out_dir)
    for part in parts:
        expected(part, dims)
    require()
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
    except OSError as why:
        raise InputError(f"{out_dir}: cannot be a folder to write: {why.strerror}") from why
    try:
        with tempfile.TemporaryDirectory(prefix=".export-", dir=out_dir) as folder:
            files = []
            for done, part in enumerate(parts):
                tell(done, len(parts), part.name)
                files += _write_part(part, dims, formats, tolerance_mm, Path(folder))
            (Path(folder) / MANIFEST).write_text(manifest(files), encoding="utf-8", newline="\n")
            for name in (*(f.file for f in files), MANIFEST):
                os.replace(Path(folder) / name, out_dir / name)
    except OSError as why:
        raise RunFailed(f"{out_dir}: cannot be written: {why.strerror}") from why
    tell(len(parts), len(parts), "done")
    return files


def manifest(files: Sequence[PartFile]) -> str:
    """The manifest's text: one entry a file, no times and no paths."""
    return json.dumps({"files": [asdict(f) for f in files]}, indent=2) + "\n"


def _checked_formats(formats: Sequence[str]) -> tuple[str, ...]:
    named = tuple(dict.fromkeys(f.strip().lower() for f in formats if f.strip()))
    if not named:
        raise InputError(f"format: none given; valid: {', '.join(FORMATS)}")
    for name in named:
        if name not in FORMATS:
            raise InputError(f"format {name!r}: unknown; {did_you_mean(name, FORMATS)}")
    return named


def _write_part(
    part: Part,
    dims: Design,
    formats: Sequence[str],
    tolerance_mm: float,
    folder: Path,
) -> list[PartFile]:
    solid, measured = build_part(part, dims)
    files = []
    for kind in formats:
        path = folder / f"{part.name}.{kind}"
        deviation_mm = None
        with guarded(part.name, {"tolerance_mm": tolerance_mm}):
            if kind == "step":
                _write_step(solid, part.name, path)
            else:
                mesh = mesh_solid(solid, tolerance_mm, part.name)
                _check_volume(mesh, measured, part.name)
                path.write_bytes(stl_bytes(mesh, part.name))
                deviation_mm = round(mesh.deviation_mm, _DIGITS)
        low, high = (tuple(round(v, _DIGITS) + 0.0 for v in corner) for corner in measured.box_mm)
        files.append(
            PartFile(
                part=part.name,
                file=path.name,
                material=part.material,
                process=part.process,
                quantity=part.quantity,
                volume_mm3=round(measured.volume_mm3, _DIGITS),
                bounding_box_mm=(low, high),
                mesh_deviation_mm=deviation_mm,
                sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
            )
        )
    return files


def _check_volume(mesh: Mesh, solid: Measured, part: str) -> None:
    """A mesh within d of a surface of area A holds the volume to A d, if it looks outwards."""
    slack_mm3 = solid.area_mm2 * mesh.deviation_mm + 1e-6 * solid.volume_mm3
    if not abs(mesh.volume_mm3 - solid.volume_mm3) <= slack_mm3:
        raise RunFailed(
            f"{part}: the mesh encloses {mesh.volume_mm3:.3f} mm3, the solid {solid.volume_mm3:.3f}"
        )


def stl_bytes(mesh: Mesh, part: str) -> bytes:
    """Binary STL, millimetres: 80 bytes of header, a count, 50 bytes a triangle."""
    corners = mesh.corners_mm
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    # A sliver has no normal of its own; zero tells the reader to use the order of the corners.
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0) + 0.0
    record = np.zeros(
        len(corners), dtype=[("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("flags", "<u2")]
    )
    record["normal"], record["corner"] = normal, corners
    header = f"deltact-fab {part}, millimetres".encode().ljust(80)[:80]
    return header + np.uint32(len(record)).astype("<u4").tobytes() + record.tobytes()


def _write_step(solid: Any, name: str, path: Path) -> None:
    """One solid as STEP AP214 in millimetres, its header and product name fixed.

    The kernel stamps the time and counts products over the process's life; both are rewritten.
    """
    from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.Interface import Interface_Static
    from OCP.StepBasic import StepBasic_Product
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer
    from OCP.TCollection import TCollection_HAsciiString as Text

    writer = STEPControl_Writer()
    # Global settings of the kernel: another export in this process may have changed them.
    Interface_Static.SetIVal_s("write.surfacecurve.mode", 1)
    Interface_Static.SetIVal_s("write.precision.mode", 0)
    Interface_Static.SetCVal_s("xstep.cascade.unit", "MM")
    Interface_Static.SetCVal_s("write.step.unit", "MM")
    if writer.Transfer(solid.wrapped, STEPControl_AsIs) != IFSelect_RetDone:
        raise RunFailed(f"{name}: the CAD kernel could not translate the solid to STEP")
    model = writer.Model()
    for number in range(1, model.NbEntities() + 1):
        entity = model.Value(number)
        if isinstance(entity, StepBasic_Product):
            entity.SetId(Text(name))
            entity.SetName(Text(name))
    header = APIHeaderSection_MakeHeader(model)
    header.SetName(Text(name))
    header.SetTimeStamp(Text("1970-01-01T00:00:00"))
    header.SetAuthorValue(1, Text("deltact-fab"))
    header.SetOrganizationValue(1, Text("deltact-fab"))
    header.SetOriginatingSystem(Text(f"deltact-fab {__version__}"))
    header.SetAuthorisation(Text(""))
    if writer.Write(str(path)) != IFSelect_RetDone:
        raise RunFailed(f"{name}: the STEP file could not be written")
