"""What a stage of the measurement may know of the sensor: its camera and its clear skin."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..optics import CameraModel
from ..shapes.sensor import SkinDimensions


@dataclass(frozen=True)
class SensorView:
    """The rectified camera, the gel's outer dimensions and its Poisson ratio, as believed.

    Any of them may be wrong: an estimate is to be judged with that in mind. Young's modulus is not
    here, because a calibration's factors take its place.
    """

    camera: CameraModel
    skin: SkinDimensions
    poisson: float = 0.49

    def __post_init__(self) -> None:
        if not 0 < self.poisson < 0.5:
            raise ValueError(f"poisson: between 0 and .5: {self.poisson} fails")

    def with_gel(self, poisson: float, thickness_mm: float) -> SensorView:
        """The sensor with another gel behind the same face."""
        return replace(self, poisson=poisson, skin=replace(self.skin, thickness_mm=thickness_mm))
