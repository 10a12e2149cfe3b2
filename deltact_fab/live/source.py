"""The one interface of whatever delivers images."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from ..rig.interface import CameraFrame

if TYPE_CHECKING:
    from ..optics import CameraModel, FlatField
    from ..shapes.sensor import SkinDimensions


@dataclass(frozen=True)
class KnownSensor:
    """What a source knows of the sensor that it shows; None where it cannot tell.

    camera: the projection of the images that are tracked; its `maps` make them from those that the
    source gives. flat: how the light falls off over the tracked ones. skin: the gel's. recipe: of
    the pattern. design, serial: of the sensor. simulated: a word and the seed, where no hardware
    was involved. nominal: the camera is the design's, for none was calibrated. in_px: the camera
    stands for none, and its millimetre is a pixel.
    """

    camera: CameraModel | None = None
    flat: FlatField | None = None
    skin: SkinDimensions | None = None
    recipe: Mapping[str, Any] | None = None
    design: str | None = None
    serial: str | None = None
    simulated: str | None = None
    nominal: bool = False
    in_px: bool = False


NOTHING = KnownSensor()


class Source(Protocol):
    """Images of one sensor, raw as its camera gives them, with times of one clock."""

    name: str
    live: bool
    """Images come whether they are taken or not: the newest counts, and times are those of
    `time.monotonic`. Else every image counts."""
    known: KnownSensor

    def frames(self) -> Iterator[CameraFrame]:
        """Images (h, w, 3) BGR uint8 in order of time; the first is at rest.

        Raises InputError or a kind of RunFailed that names the source.
        """

    def at_rest(self) -> Iterator[CameraFrame]:
        """Of `frames`, those of a face that nothing touches, as far as the source can tell."""

    def close(self) -> None:
        """Let go of device or file, once `frames` is no longer read; again does nothing."""
