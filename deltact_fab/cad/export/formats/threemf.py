"""3MF (core specification 1.3): a part, or a plate of parts, in a zip of three files, millimetres.

Ids start at 1, vertices are shared, the archive carries no date of its own: lib3mf reads it in its
strict mode, and the bytes are the same every time.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

from ....version import VERSION
from ...mesh import Mesh

_DATE = (1980, 1, 1, 0, 0, 0)  # the earliest a zip can state
_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_MODEL = "application/vnd.ms-package.3dmanufacturing-3dmodel+xml"
_TYPES = f"""<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="{_MODEL}"/>
</Types>
"""
_RELATIONS = """<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Target="/3D/3dmodel.model" Id="rel1" \
Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"""


def threemf_bytes(
    mesh: Mesh, name: str, material: str, colour: tuple[float, float, float, float]
) -> bytes:
    """The mesh as a 3MF archive: one object, one base material, one item.

    The vertices keep their numbers; the item moves them into the positive octant, where the
    specification wants what is to be printed. colour: sRGB and opacity, 0 to 1.
    """
    vertices = "\n".join(
        f'<vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>' for x, y, z in mesh.vertices_mm.tolist()
    )
    triangles = "\n".join(
        f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in mesh.triangles.tolist()
    )
    x, y, z = (0.0 - mesh.vertices_mm.min(axis=0).astype(float)).tolist()
    body = (
        f"<mesh>\n<vertices>\n{vertices}\n</vertices>\n"
        f"<triangles>\n{triangles}\n</triangles>\n</mesh>"
    )
    return plate_bytes([ArchiveObject(name, body, ((x, y, z),))], name, material, colour)


@dataclass(frozen=True)
class ArchiveObject:
    """One object of an archive: its `<mesh>` as text, and where its copies stand."""

    name: str
    mesh: str
    places_mm: tuple[tuple[float, float, float], ...]


def read_mesh(data: bytes) -> str:
    """The `<mesh>` of an archive that threemf_bytes wrote, as it stands there."""
    with zipfile.ZipFile(io.BytesIO(data)) as zipped:
        model = zipped.read("3D/3dmodel.model").decode()
    return model[model.index("<mesh>") : model.index("</mesh>") + len("</mesh>")]


def plate_bytes(
    pieces: Sequence[ArchiveObject],
    name: str,
    material: str,
    colour: tuple[float, float, float, float],
) -> bytes:
    """Several parts of one material as they stand on one platform, each under its own name."""
    shade = "#" + "".join(f"{round(255 * c):02X}" for c in colour)
    objects = "\n".join(
        f'<object id="{i}" type="model" name={quoteattr(piece.name)} pid="1" pindex="0">\n'
        f"{piece.mesh}\n</object>"
        for i, piece in enumerate(pieces, 2)
    )
    items = "\n".join(
        f'<item objectid="{i}" transform="1 0 0 0 1 0 0 0 1 {x:.9g} {y:.9g} {z:.9g}"/>'
        for i, piece in enumerate(pieces, 2)
        for x, y, z in piece.places_mm
    )
    model = f"""<?xml version="1.0" encoding="UTF-8"?>
<model unit="millimeter" xml:lang="en" xmlns="{_CORE}">
<metadata name="Title">{escape(name)}</metadata>
<metadata name="Application">deltact-fab {VERSION}</metadata>
<resources>
<basematerials id="1"><base name={quoteattr(material)} displaycolor="{shade}"/></basematerials>
{objects}
</resources>
<build>
{items}
</build>
</model>
"""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as zipped:
        for path, text in (
            ("[Content_Types].xml", _TYPES),
            ("_rels/.rels", _RELATIONS),
            ("3D/3dmodel.model", model),
        ):
            entry = zipfile.ZipInfo(path, _DATE)
            entry.create_system = 3  # else the platform's
            entry.external_attr = 0o644 << 16
            zipped.writestr(entry, text.encode(), zipfile.ZIP_DEFLATED, 6)
    return archive.getvalue()
