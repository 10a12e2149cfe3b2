"""STEP AP214 in millimetres, header and names fixed.

The kernel writes the time and numbers products and their uses over the life of the process; all of
this is rewritten. The assembly has no colours: the kernel orders them by memory address.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

from deltact_fab.common import Point, RunFailed
from deltact_fab.version import PACKAGE_VERSION


def part_bytes(solid: Any, name: str) -> bytes:
    """Return a cadquery Solid as one product. Raises RunFailed if the kernel cannot convert it."""
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.StepBasic import StepBasic_Product
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer
    from OCP.TCollection import TCollection_HAsciiString as Text

    writer = STEPControl_Writer()
    _settings()
    if writer.Transfer(solid.wrapped, STEPControl_AsIs) != IFSelect_RetDone:
        raise RunFailed(f"{name}: the CAD kernel could not translate the solid to STEP")
    for entity in _entities(writer):
        if isinstance(entity, StepBasic_Product):
            entity.SetId(Text(name))
            entity.SetName(Text(name))
    return _step_bytes(writer, name)


def assembly_bytes(parts: Sequence[tuple[str, Any, Sequence[Point]]], name: str) -> bytes:
    """Return an assembly of parts (name, solid, position of each copy), in order.

    Raises RunFailed when the kernel cannot translate it.
    """
    from OCP.gp import gp_Trsf, gp_Vec
    from OCP.STEPCAFControl import STEPCAFControl_Writer
    from OCP.STEPControl import STEPControl_AsIs
    from OCP.StepRepr import StepRepr_NextAssemblyUsageOccurrence
    from OCP.TCollection import TCollection_ExtendedString as Wide
    from OCP.TCollection import TCollection_HAsciiString as Text
    from OCP.TDataStd import TDataStd_Name
    from OCP.TDocStd import TDocStd_Document
    from OCP.TopLoc import TopLoc_Location
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    document = TDocStd_Document(Wide("BinXCAF"))
    tool = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    assembly = tool.NewShape()
    TDataStd_Name.Set_s(assembly, Wide(name))
    for part, solid, places in parts:
        product = tool.AddShape(solid.wrapped, False)
        TDataStd_Name.Set_s(product, Wide(part))
        for copy, place in enumerate(places, start=1):
            move = gp_Trsf()
            move.SetTranslation(gp_Vec(*place))
            use = tool.AddComponent(assembly, product, TopLoc_Location(move))
            TDataStd_Name.Set_s(use, Wide(f"{part}-{copy}"))
    tool.UpdateAssemblies()
    writer = STEPCAFControl_Writer()
    _settings()
    for turn_off in (writer.SetColorMode, writer.SetLayerMode, writer.SetPropsMode):
        turn_off(False)
    writer.SetNameMode(True)
    if not writer.Transfer(document, STEPControl_AsIs):
        raise RunFailed(f"{name}: the CAD kernel could not translate the assembly to STEP")
    uses = 0
    for entity in _entities(writer.ChangeWriter()):
        if isinstance(entity, StepRepr_NextAssemblyUsageOccurrence):
            uses += 1
            entity.SetId(Text(str(uses)))
    return _step_bytes(writer.ChangeWriter(), name)


def _settings() -> None:
    """Set the kernel's global options; another export in this process may have changed them."""
    from OCP.Interface import Interface_Static

    Interface_Static.SetIVal_s("write.surfacecurve.mode", 1)
    Interface_Static.SetIVal_s("write.precision.mode", 0)
    Interface_Static.SetIVal_s("write.stepcaf.subshapes.name", 0)
    Interface_Static.SetCVal_s("xstep.cascade.unit", "MM")
    Interface_Static.SetCVal_s("write.step.unit", "MM")


def _entities(writer: Any) -> list[Any]:
    model = writer.Model()
    return [model.Value(number) for number in range(1, model.NbEntities() + 1)]


def _step_bytes(writer: Any, name: str) -> bytes:
    from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.TCollection import TCollection_HAsciiString as Text

    header = APIHeaderSection_MakeHeader(writer.Model())
    header.SetName(Text(name))
    header.SetTimeStamp(Text("1970-01-01T00:00:00"))
    header.SetAuthorValue(1, Text("deltact-fab"))
    header.SetOrganizationValue(1, Text("deltact-fab"))
    header.SetOriginatingSystem(Text(f"deltact-fab {PACKAGE_VERSION}"))
    header.SetAuthorisation(Text(""))
    stream = io.BytesIO()
    if writer.WriteStream(stream) != IFSelect_RetDone:
        raise RunFailed(f"{name}: the STEP file could not be written")
    return stream.getvalue()
