"""A result as a program reads it, and as a person does on one line."""

from __future__ import annotations

from math import isnan
from typing import Any

from .session import MeasuredImage


def as_dict(m: MeasuredImage, outlines: bool = False) -> dict[str, Any]:
    """Plain numbers of one result; what was not asked for, or was not calibrated, is None.

    outlines: also those of the contacts, as lists of points in mm.
    """
    result = m.result
    contacts = result.contacts
    force = result.force
    return {
        "frame": m.given.frame,
        "t_s": round(m.given.t_s, 6),
        "since_reference": result.frame,
        "age_ms": round(result.age_ms, 3),
        "cover": round(result.cover, 4),
        "trusted": result.trusted,
        "extrapolated": result.extrapolated,
        "force_n": None if force is None else _rounded(force.force_n),
        "torque_nmm": None if force is None else _rounded(force.torque_nmm),
        "contacts": None if contacts is None else [_contact(c, outlines) for c in contacts],
        "dropped": m.dropped,
        "motion_px": _one(m.motion.largest_px),
        "motion_median_px": _one(m.motion.median_px),
        "motion_mm": _one(m.motion.largest_mm),
        "markers": m.motion.markers,
        "markers_held": m.motion.markers_held,
    }


def _contact(contact: Any, outline: bool) -> dict[str, Any]:
    told = {
        "area_mm2": round(float(contact.area_mm2), 3),
        "centroid_mm": _rounded(contact.centroid_mm),
        "place_mm": _rounded(contact.place_mm),
        "cover": round(contact.cover, 4),
        "peak_depth_mm": _one(contact.peak_depth_mm),
        "force_share": _one(contact.force_share),
    }
    if outline:
        told["outline_mm"] = [_rounded(p) for p in contact.outline_mm]
    return told


def _one(value: float | None) -> float | None:
    return None if value is None else round(float(value), 4)


def _rounded(values: Any) -> list[float | None]:
    return [None if isnan(v) else round(float(v), 4) for v in values]


def _signed(values: list[float | None], digits: int) -> str:
    return " ".join("-" if v is None else f"{v:+.{digits}f}" for v in values)


def line(m: MeasuredImage) -> str:
    """One result, as a person reads it while it runs."""
    told = as_dict(m)
    parts = [
        f"{m.hz:5.1f} Hz",
        f"age {told['age_ms']:3.0f} ms",
        f"cover {told['cover']:4.0%}" + ("" if told["trusted"] else " NOT TRUSTED"),
    ]
    if told["force_n"] is not None:
        parts.append(f"F {_signed(told['force_n'], 2)} N")
        parts.append(f"T {_signed(told['torque_nmm'], 1)} N mm")
    elif told["motion_px"] is not None:
        mm, px = told["motion_mm"], told["motion_px"]
        parts.append(f"motion {px:.2f} px" if mm is None else f"motion {mm:.3f} mm")
    if told["markers"] is not None:
        parts.append(f"{told['markers_held']} of {told['markers']} markers")
    if told["extrapolated"]:
        parts.append("BEYOND ITS CALIBRATION")
    if told["contacts"] is not None:
        parts.append(f"contacts: {len(told['contacts'])}")
        parts += [f"{c['area_mm2']:.1f} mm2 at ({c['place_mm'][0]:+.1f}, "
                  f"{c['place_mm'][1]:+.1f}) mm" for c in told["contacts"][:1]]  # fmt: skip
    if m.dropped:
        parts.append(f"{m.dropped} dropped")
    return "  ".join(parts)
