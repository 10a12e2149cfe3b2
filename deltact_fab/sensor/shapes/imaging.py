"""Printer and camera as numbers: what a rig's file sets and `imaging` computes with.

The defaults are assumed values of an office laser printer and a small fisheye camera.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Le, Lt

from deltact_fab.common import MM_PER_INCH

CAMERA_GAMMA = 2.2
_FROM_FILE = {"extra": "forbid", "allow_inf_nan": False, "use_attribute_docstrings": True}


@dataclass(frozen=True)
class Printer:
    """The printer that made the sticker."""

    dpi: Annotated[int, Ge(72), Le(9600)] = 1200
    """Resolution."""
    levels: Annotated[int, Ge(2), Le(256)] = 4
    """Levels of each ink at a printed dot."""
    misregistration_um: Annotated[float, Ge(0), Le(1000)] = 15.0
    """How far the colours lie beside each other."""
    spread_um: Annotated[float, Ge(0), Le(500)] = 20.0
    """How far ink runs."""

    __pydantic_config__ = _FROM_FILE

    @property
    def mm_per_dot(self) -> float:
        """Pitch of the printer's dots."""
        return MM_PER_INCH / self.dpi


@dataclass(frozen=True)
class ImageSensor:
    """The simulated camera's sensor and lens faults."""

    blur_px: Annotated[float, Ge(0.01), Le(50)] = 0.6
    """Standard deviation of the blur of lens and sensor together."""
    shading: Annotated[float, Ge(0), Lt(1)] = 0.35
    """Share of the light that is lost in the corner of the view."""
    full_well_electrons: Annotated[float, Ge(1), Le(10_000_000)] = 8000.0
    """What a pixel holds when it is white; sets the shot noise."""
    read_noise_electrons: Annotated[float, Ge(0), Le(100_000)] = 6.0
    """Standard deviation of the noise of reading a pixel."""
    corner_blur_px: Annotated[float, Ge(0), Le(50)] = 0.0
    """Standard deviation of the blur in the corner of the view, where it is more than blur_px."""
    led_gradient: Annotated[float, Ge(0.1), Le(10)] = 1.0
    """Light at the edge of the view over light in its middle: 1 to 6 where LEDs stand around it."""
    highlight: Annotated[float, Ge(0), Le(10)] = 0.0
    """Light of the reflection of one LED, at its middle; 1 is white."""
    contact_glow_per_mm: Annotated[float, Ge(0), Le(10)] = 0.0
    """How much brighter the face gets a millimetre of depth, until it saturates to white."""
    gamma: Annotated[float, Ge(1), Le(4)] = CAMERA_GAMMA
    """Of the camera's processor: a pixel's value is its light to the power of 1 / gamma."""
    demosaic: Literal["edge-aware", "bilinear", "gradients"] = "edge-aware"
    """How the processor makes three colours of the one that each pixel saw."""
    sharpening: Annotated[float, Ge(0), Le(3)] = 0.0
    """Share of what an image has over its own blur of 1 px that the processor adds to it."""
    format: Literal["raw", "yuyv", "nv12", "mjpeg-422", "mjpeg-420"] = "raw"
    """What goes over the cable: raw keeps all; yuyv and mjpeg-422 halve the colour's columns, nv12
    and mjpeg-420 its rows too; mjpeg compresses."""
    jpeg_quality: Annotated[int, Ge(10), Le(100)] = 85
    """Of the mjpeg formats."""

    mosaic: ClassVar[bool] = True
    """One colour a pixel behind a Bayer filter; False is three chips, every colour everywhere."""

    __pydantic_config__ = _FROM_FILE
