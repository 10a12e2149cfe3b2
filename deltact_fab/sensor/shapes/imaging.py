"""Parameters of printer and camera for the rig file and for `imaging`.

The defaults are assumed values of an office laser printer and a small fisheye camera.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Le, Lt

from deltact_fab.common import MM_PER_INCH

CAMERA_GAMMA = 2.2  # standard: close to sRGB (IEC 61966-2-1)
_FROM_FILE = {"extra": "forbid", "allow_inf_nan": False, "use_attribute_docstrings": True}


@dataclass(frozen=True)
class Printer:
    """Printer of the sticker."""

    dpi: Annotated[int, Ge(72), Le(9600)] = 1200
    """Resolution."""
    levels: Annotated[int, Ge(2), Le(256)] = 4
    """Ink levels per printed dot."""
    misregistration_um: Annotated[float, Ge(0), Le(1000)] = 15.0
    """Misregistration of the colours."""
    spread_um: Annotated[float, Ge(0), Le(500)] = 20.0
    """Spread of the ink."""

    __pydantic_config__ = _FROM_FILE

    @property
    def mm_per_dot(self) -> float:
        """Pitch of the printer's dots."""
        return MM_PER_INCH / self.dpi


@dataclass(frozen=True)
class ImageSensor:
    """Image sensor and lens defects of the simulated camera."""

    blur_px: Annotated[float, Ge(0.01), Le(50)] = 0.6
    """Standard deviation of the blur of lens and sensor together."""
    shading: Annotated[float, Ge(0), Lt(1)] = 0.35
    """Loss of light in the corner of the view, as a share."""
    full_well_electrons: Annotated[float, Ge(1), Le(10_000_000)] = 8000.0
    """Electrons of a white pixel; sets the shot noise."""
    read_noise_electrons: Annotated[float, Ge(0), Le(100_000)] = 6.0
    """Standard deviation of the read noise."""
    corner_blur_px: Annotated[float, Ge(0), Le(50)] = 0.0
    """Standard deviation of the blur in the corner of the view, if above blur_px."""
    led_gradient: Annotated[float, Ge(0.1), Le(10)] = 1.0
    """Light at the edge of the view over that at its centre: 1 to 6 with LEDs around it."""
    highlight: Annotated[float, Ge(0), Le(10)] = 0.0
    """Peak light of an LED's reflection; 1 is white."""
    contact_glow_per_mm: Annotated[float, Ge(0), Le(10)] = 0.0
    """Brightening of the face per millimetre of depth, up to white."""
    gamma: Annotated[float, Ge(1), Le(4)] = CAMERA_GAMMA
    """Gamma of the camera: a pixel's value is its light to the power of 1 / gamma."""
    demosaic: Literal["edge-aware", "bilinear", "gradients"] = "edge-aware"
    """Demosaicing of the Bayer pattern."""
    sharpening: Annotated[float, Ge(0), Le(3)] = 0.0
    """Strength of the camera's unsharp mask of 1 px, its edge enhancement."""
    auto_exposure_grey: Annotated[float, Ge(0), Le(250)] = 0.0
    """Mean grey level that automatic exposure gives the face at rest; 0: fixed exposure."""
    format: Literal["raw", "yuyv", "nv12", "mjpeg-422", "mjpeg-420"] = "raw"
    """Transfer format: raw is lossless; yuyv and mjpeg-422 halve the colour's columns, nv12 and
    mjpeg-420 its rows too; mjpeg compresses."""
    jpeg_quality: Annotated[int, Ge(10), Le(100)] = 85
    """JPEG quality of the mjpeg formats."""

    mosaic: ClassVar[bool] = True
    """True for one colour per pixel (Bayer filter), False for three chips."""

    __pydantic_config__ = _FROM_FILE
