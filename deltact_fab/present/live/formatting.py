"""Results as plain data, as a status line, and as rows and arrays of `measure --out`.

Rows and arrays have names and units, printed by `deltact-fab schema`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan
from typing import Any

from pydantic import Field, create_model

from deltact_fab.common import Table

from .session import MeasuredImage


def as_dict(m: MeasuredImage, outlines: bool = False) -> dict[str, Any]:
    """Return one result as plain numbers; None where not requested or not calibrated.

    outlines: with the contacts' outlines, as lists of points in mm.
    """
    result, contacts, force = m.result, m.result.contacts, m.result.force
    return {
        "frame": m.source.frame,
        "t_s": round(m.source.t_s, 6),
        "since_reference": result.frame,
        "age_ms": round(result.age_ms, 3),
        "cover": round(result.cover, 4),
        "trusted": result.trusted,
        "extrapolated": result.extrapolated,
        "force_n": None if force is None else _rounded(force.force_n),
        "torque_nmm": None if force is None else _rounded(force.torque_nmm),
        "contacts": None if contacts is None else [_contact(c, outlines) for c in contacts],
        "dropped": m.dropped,
        "motion_px": _rounded_or_none(m.motion.largest_px),
        "motion_median_px": _rounded_or_none(m.motion.median_px),
        "motion_mm": _rounded_or_none(m.motion.largest_mm),
        "markers": m.motion.markers,
        "markers_held": m.motion.markers_held,
    }


def _contact(contact: Any, outline: bool) -> dict[str, Any]:
    entry = {
        "area_mm2": round(float(contact.area_mm2), 3),
        "centroid_mm": _rounded(contact.centroid_mm),
        "place_mm": _rounded(contact.place_mm),
        "cover": round(contact.cover, 4),
        "peak_depth_mm": _rounded_or_none(contact.peak_depth_mm),
        "force_share": _rounded_or_none(contact.force_share),
        "count": contact.count,
        "resolution_mm": _rounded_or_none(contact.resolution_mm),
    }
    if outline:
        entry["outline_mm"] = [_rounded(p) for p in contact.outline_mm]
    return entry


def _rounded_or_none(value: float | None) -> float | None:
    return None if value is None else round(float(value), 4)


def _rounded(values: Any) -> list[float | None]:
    return [None if isnan(v) else round(float(v), 4) for v in values]


def _signed(values: list[float | None], digits: int) -> str:
    return " ".join("-" if v is None else f"{v:+.{digits}f}" for v in values)


def contact_number(contacts: list[dict[str, Any]]) -> str:
    """Format the number of contacts, given those of `as_dict`."""
    counts = [contact["count"] for contact in contacts]
    merged = counts.count("two or more")
    if merged:
        return f"{len(counts) + merged} or more"
    return f"{len(counts)}" + (", perhaps more" if "cannot tell" in counts else "")


def status_text(m: MeasuredImage) -> str:
    """Format one result as a status line."""
    values = as_dict(m)
    parts = [
        f"{m.hz:5.1f} Hz",
        f"age {values['age_ms']:3.0f} ms",
        f"cover {values['cover']:4.0%}" + ("" if values["trusted"] else " NOT TRUSTED"),
    ]
    if values["force_n"] is not None:
        parts.append(f"F {_signed(values['force_n'], 2)} N")
        parts.append(f"T {_signed(values['torque_nmm'], 1)} N mm")
    elif values["motion_px"] is not None:
        mm, px = values["motion_mm"], values["motion_px"]
        parts.append(f"displacement {px:.2f} px" if mm is None else f"displacement {mm:.3f} mm")
    if values["markers"] is not None:
        parts.append(f"{values['markers_held']}/{values['markers']} markers")
    if values["extrapolated"]:
        parts.append("EXTRAPOLATED")
    if values["contacts"] is not None:
        parts.append(f"contacts: {contact_number(values['contacts'])}")
        parts += [f"{c['area_mm2']:.1f} mm2 at ({c['place_mm'][0]:+.1f}, "
                  f"{c['place_mm'][1]:+.1f}) mm" for c in values["contacts"][:1]]  # fmt: skip
    if m.dropped:
        parts.append(f"{m.dropped} dropped")
    return "  ".join(parts)


@dataclass(frozen=True)
class TableColumn:
    """Column of a table. kind: string, int64, float64 or bool."""

    name: str
    kind: str
    unit: str
    text: str


def _columns(kind: str, **texts: str) -> list[TableColumn]:
    units = {"n": "N", "nmm": "N mm", "mpa": "MPa"}
    units |= {u: u for u in ("px", "mm", "mm2", "s", "ms")}
    ends = {name: units.get(name.rpartition("_")[2], "") for name in texts}
    return [TableColumn(name, kind, ends[name], text) for name, text in texts.items()]


WRENCH_COLUMNS = ("fx_n", "fy_n", "fz_n", "tx_nmm", "ty_nmm", "tz_nmm")
CONTACT_COLUMNS = ("contact_x_mm", "contact_y_mm", "contact_area_mm2", "contact_depth_mm")
RESULT_COLUMNS = [
    *_columns(
        "int64",
        frame="Number of the image in the source, from 0; gaps are dropped images.",
        since_reference="Images since the reference, from which displacement is measured.",
        dropped="Images dropped so far in favour of newer ones.",
        markers="Markers in the reference; empty for a dense pattern.",
        markers_held="Markers found in this image.",
        contacts="Separate contacts; needs a depth calibration. See contact_count.",
    ),
    *_columns(
        "bool",
        trusted="Enough of the view is tracked reliably; if false, ignore all other values.",
        extrapolated="A calibration is used outside its range, or too little is known.",
    ),
    *_columns(
        "float64",
        t_s="Time of the image, on the source's clock.",
        age_ms="Delay from taking the image (reading it, from a file) to its result.",
        cover="Fraction of the view with known displacement; of markers, the fraction found.",
        motion_px="Largest displacement of the pattern in the image since the reference.",
        motion_median_px="Median length of the displacement.",
        motion_mm="Largest displacement on the resting face, where its scale is known.",
        **dict.fromkeys(WRENCH_COLUMNS, "Force on the sensor (fz_n < 0 in a press), and torque "
                        "about the centre of the resting face."),
        **dict.fromkeys(CONTACT_COLUMNS, "Deepest contact, in the frame of the sensor."),
        contact_resolution_mm="Least distance of two contacts not taken for the deepest one.",
    ),
    *_columns(
        "string",
        contact_count="Contacts in the region of the deepest: one, two or more, cannot tell.",
        fields="File with the image's arrays; `schema fields` names them.",
        picture="File with the tracked image, if pictures were requested.",
    ),
]  # fmt: skip
ARRAY_COLUMNS = _columns(
    "array",
    flow_px="(h, w, 2) displacement since the reference, x, y; rows and columns are 2 px apart.",
    state="(h, w) quality of flow_px: 2 measured, 1 filled from neighbours, 0 a guess.",
    shift_mm="(h, w, 2) displacement on the face, at x_mm and y_mm; needs a camera or a scale.",
    known="(h, w) true where shift_mm is measured, not a guess.",
    x_mm="(w,) column positions of shift_mm.",
    y_mm="(h,) row positions of shift_mm.",
    depth_mm="(h, w) depth into the gel, at depth_x_mm and depth_y_mm.",
    depth_x_mm="(w,) column positions of depth_mm.",
    depth_y_mm="(h,) row positions of depth_mm.",
    traction_mpa="(h, w, 3) traction on the face, at traction_x_mm and traction_y_mm.",
    traction_x_mm="(w,) column positions of traction_mpa.",
    traction_y_mm="(h,) row positions of traction_mpa.",
    position_px="(n, 2) positions of the markers, nan if not found.",
    displacement_px="(n, 2) displacement of the markers since the reference.",
)
_COLUMN_TYPES: dict[str, Any] = {
    "int64": int, "bool": bool, "float64": float, "string": str, "array": list[float]
}  # fmt: skip


def _model(name: str, columns: list[TableColumn]) -> type[Table]:
    keys: dict[str, Any] = {
        c.name: (_COLUMN_TYPES[c.kind] | None, Field(None, description=c.text)) for c in columns
    }
    return create_model(name, __base__=Table, **keys)


MeasuredRow = _model("MeasuredRow", RESULT_COLUMNS)
FieldArrays = _model("FieldArrays", ARRAY_COLUMNS)


def table_row(m: MeasuredImage, fields: str, picture: str) -> list[Any]:
    """Row of a result by RESULT_COLUMNS, "" if unknown; fields, picture: names of its files."""
    values = as_dict(m)
    wrench = [*(values["force_n"] or ()), *(values["torque_nmm"] or ())]
    row = values | dict(zip(WRENCH_COLUMNS, wrench, strict=False))
    row |= {"fields": fields, "picture": picture}
    if (contacts := values["contacts"]) is not None:
        row["contacts"] = len(contacts)
    if contacts:
        deepest = [*contacts[0]["place_mm"], contacts[0]["area_mm2"], contacts[0]["peak_depth_mm"]]
        row |= zip(CONTACT_COLUMNS, deepest, strict=True)
        row |= {f"contact_{key}": contacts[0][key] for key in ("count", "resolution_mm")}
    return ["" if (value := row.get(c.name)) is None else value for c in RESULT_COLUMNS]
