"""The camera of a rig file."""

from __future__ import annotations

from pydantic import Field

from ..strict import Strict


class CameraFile(Strict):
    """What is known of a camera, as it was calibrated."""

    model: str = Field(min_length=1, max_length=4096)
    """A camera file, as `deltact-fab calibrate` writes it; its path counts from the rig file."""


class CameraConfig(Strict):
    """The camera that looks at the gel: how its images come, and how it was calibrated."""

    model: str | None = Field(default=None, min_length=1, max_length=4096)
    """As in CameraFile."""
