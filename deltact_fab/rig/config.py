"""A rig file: where the stage stands, what it can do, and what is attached."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from .. import catalog
from ..optics import StageFrame
from ..protocols.limits import StageBox

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class StageConfig(_Strict):
    """The 3-axis stage; machine coordinates are 0 at the homed end and negative below."""

    origin_machine_mm: tuple[Finite, Finite, Finite]
    angle_deg: Finite = 0.0
    travel_mm: tuple[Positive, Positive, Positive]
    max_feed_mm_min: tuple[Positive, Positive, Positive]
    acceleration_mm_s2: tuple[Positive, Positive, Positive]
    baud: int = Field(default=115200, ge=1200)
    max_force_n: tuple[Positive, Positive, Positive] | None = None
    """What the axes can push without losing steps, x, y, z; None: not declared."""

    @property
    def frame(self) -> StageFrame:
        """The rigid transform of this stage."""
        return StageFrame(self.origin_machine_mm, self.angle_deg)

    @property
    def box(self) -> StageBox:
        """What the static checks need to know of this stage."""
        return StageBox(self.frame, self.travel_mm, self.max_feed_mm_min, self.acceleration_mm_s2)


class CameraConfig(_Strict):
    """The simulated camera's sensor and lens faults."""

    blur_px: Positive = 0.6
    shading: float = Field(default=0.35, ge=0, lt=1)
    full_well_electrons: Positive = 8000.0
    read_noise_electrons: NotNegative = 6.0


class PrinterConfig(_Strict):
    """The printer that made the sticker."""

    dpi: int = Field(default=1200, ge=72, le=9600)
    levels: int = Field(default=4, ge=2, le=256)
    misregistration_um: NotNegative = 15.0
    spread_um: NotNegative = 20.0


class ForceConfig(_Strict):
    """A six-axis force sensor (ranges as on its calibration sheet).

    ATI Nano17, `max` in the calibration files that come with it: SI-50-0.5 (FT11564) 50, 50, 70 N
    and 500 N mm, SI-25-0.25 (FT8577) 25, 25, 35 N and 250 N mm. The defaults serve the simulated
    box; `preflight` takes what a rig file does not write down for undeclared.
    """

    range_n: tuple[Positive, Positive, Positive] = (25.0, 25.0, 35.0)
    range_nmm: tuple[Positive, Positive, Positive] = (250.0, 250.0, 250.0)
    origin_mm: tuple[Finite, Finite, Finite] | None = None
    """Where its moments count from, in the sensor frame of the gel; None: not declared."""
    noise_n: NotNegative = 0.01
    rate_hz: Positive = 1000.0


class FiniteGelConfig(_Strict):
    """Resolution of the simulated gel at the level 'hyperelastic'."""

    cell_mm: float | None = Field(default=None, ge=0.1, le=12.0)
    """Cells below the indenter; None: chosen from its shape and the tolerance."""
    tolerance: float = Field(default=0.03, ge=0.001, le=0.5)
    """Of force, for that choice."""
    most_unknowns: int = Field(default=8_000, ge=500, le=1_000_000)
    """Of a mesh chosen so: thousands of knots are solved on it. Larger cells are flagged."""
    lattice_mm: float = Field(default=0.5, ge=0.05, le=2.0)
    """Lattice on which displacements are kept."""
    press_increment_mm: float = Field(default=0.5, gt=0, le=5.0)
    shear_increment_mm: float = Field(default=1.0, gt=0, le=5.0)


class GelConfig(_Strict):
    """Resolution of the simulated gel: at the linear levels, and apart from them at finite strain.

    One solve per increment of motion; between them displacements and forces are interpolated.
    """

    spacing_mm: float = Field(default=0.25, ge=0.05, le=2.0)
    press_increment_mm: float = Field(default=0.1, gt=0, le=1.0)
    shear_increment_mm: float = Field(default=0.25, gt=0, le=2.0)
    hyperelastic: FiniteGelConfig = FiniteGelConfig()


class RigConfig(_Strict):
    """One bench. Only the simulated one can be driven so far."""

    kind: Literal["virtual"]
    stage: StageConfig
    camera: CameraConfig = CameraConfig()
    printer: PrinterConfig = PrinterConfig()
    force: ForceConfig = ForceConfig()
    gel: GelConfig = GelConfig()


def load(name: str) -> tuple[RigConfig, Path]:
    """Read a rig by catalogue name or path. Raises InputError."""
    path = catalog.find("protocols/rigs", name)
    return catalog.validate(RigConfig, catalog.read(path), str(path)), path
