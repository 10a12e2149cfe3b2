"""What `measure --out` keeps, by name and unit: the columns of its table, the arrays of its files.

`deltact-fab schema measured` and `schema fields` print these.
"""

from __future__ import annotations

from ..configuration import Table
from .formatting import as_dict
from .session import MeasuredImage

Numbers = list[float]


class MeasuredRow(Table):
    """One image; what was not asked for, not calibrated or not found is empty."""

    frame: int
    """Number of the image in the source, from 0; a gap is images that were dropped."""
    t_s: float
    """When it was taken, on the source's clock."""
    since_reference: int
    """Images since the reference, which is 0: motion counts from it."""
    age_ms: float
    """From when the image was taken, or was given where it comes from a file, to its result."""
    cover: float
    """Share of the view whose motion is known; of markers, the share that is held."""
    trusted: bool
    """The tracker believes enough of what it sees; without it no other number counts."""
    extrapolated: bool
    """A calibration is used beyond what it was made from."""
    dropped: int
    """Images that gave way to newer ones, so far."""
    motion_px: float | None = None
    """Largest motion of the pattern in the picture, from the reference."""
    motion_median_px: float | None = None
    """Median of that motion's length."""
    motion_mm: float | None = None
    """Largest motion, on the resting face; empty where its scale is not known."""
    area_change_median: float | None = None
    """Share by which the picture of the pattern grew; the smoothed motion, 24 px off the rim."""
    area_change_least: float | None = None
    """The same at the first hundredth of the picture."""
    area_change_most: float | None = None
    """The same at the last hundredth."""
    shear_median: float | None = None
    """Difference of the principal stretches of the picture, in the same places."""
    shear_least: float | None = None
    """The same at the first hundredth."""
    shear_most: float | None = None
    """The same at the last hundredth."""
    markers: int | None = None
    """Markers in the reference; empty where a dense pattern was followed."""
    markers_held: int | None = None
    """Those of them that are now found."""
    fx_n: float | None = None
    """Force on the sensor along x, from the calibration."""
    fy_n: float | None = None
    """Force on the sensor along y."""
    fz_n: float | None = None
    """Force on the sensor along z; a press has fz_n < 0."""
    tx_nmm: float | None = None
    """Torque about x, about the centre of the resting face."""
    ty_nmm: float | None = None
    """Torque about y."""
    tz_nmm: float | None = None
    """Torque about z."""
    contacts: int | None = None
    """Separate contacts; the columns below are of the deepest."""
    contact_x_mm: float | None = None
    """Its place on the resting face along x."""
    contact_y_mm: float | None = None
    """Its place along y."""
    contact_area_mm2: float | None = None
    """Its area."""
    contact_depth_mm: float | None = None
    """Its peak depth."""
    fields: str = ""
    """File with the image's arrays, from the folder; `schema fields` names them."""
    picture: str = ""
    """File with the image as it was tracked, where pictures were asked for."""

    @classmethod
    def of(cls, m: MeasuredImage, fields: str, picture: str) -> MeasuredRow:
        """Of a result and the names of its files."""
        told = as_dict(m)
        row = {name: told[name] for name in cls.model_fields if name in told}
        force = [*(told["force_n"] or (None,) * 3), *(told["torque_nmm"] or (None,) * 3)]
        row |= zip(("fx_n", "fy_n", "fz_n", "tx_nmm", "ty_nmm", "tz_nmm"), force, strict=True)
        found = told["contacts"]
        row["contacts"] = None if found is None else len(found)
        if found:
            x, y = found[0]["place_mm"]
            row |= {"contact_x_mm": x, "contact_y_mm": y,
                    "contact_area_mm2": found[0]["area_mm2"],
                    "contact_depth_mm": found[0]["peak_depth_mm"]}  # fmt: skip
        return cls(**row, fields=fields, picture=picture)


class FieldArrays(Table):
    """Arrays of one image, as numpy.load reads them; those that were not measured are not there."""

    flow_px: Numbers | None = None
    """(h, w, 2) motion of the pattern from the reference, x and y; a row and a column are 2 px."""
    state: Numbers | None = None
    """(h, w) of flow_px: 2 found in this image, 1 filled from its neighbours, 0 a guess."""
    shift_mm: Numbers | None = None
    """(h, w, 2) motion on the resting face at the points x_mm, y_mm; with a camera or a scale."""
    known: Numbers | None = None
    """(h, w) of shift_mm: it is measured, and no guess."""
    x_mm: Numbers | None = None
    """(w,) places of the columns of shift_mm and known on the resting face."""
    y_mm: Numbers | None = None
    """(h,) places of the rows."""
    depth_mm: Numbers | None = None
    """(h, w) depth of the face into the gel, at depth_x_mm and depth_y_mm."""
    depth_x_mm: Numbers | None = None
    """(w,) places of the columns of depth_mm."""
    depth_y_mm: Numbers | None = None
    """(h,) places of the rows of depth_mm."""
    traction_mpa: Numbers | None = None
    """(h, w, 3) traction on the face, at traction_x_mm and traction_y_mm."""
    traction_x_mm: Numbers | None = None
    """(w,) places of the columns of traction_mpa."""
    traction_y_mm: Numbers | None = None
    """(h,) places of the rows of traction_mpa."""
    position_px: Numbers | None = None
    """(n, 2) places of the markers in the image, nan of one that is lost."""
    displacement_px: Numbers | None = None
    """(n, 2) from where each was in the reference."""
