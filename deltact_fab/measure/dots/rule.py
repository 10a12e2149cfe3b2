"""The limits of the dot tracker, in units of the dots themselves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Polarity = Literal["white", "dark"]


@dataclass(frozen=True)
class DotRule:
    """Lengths in dot diameters (d) or pitches.

    work_d_px: diameter in the reduced image in which dots are looked for. blur_d: sigma of the blur
    of the whiteness. level: where between the background and the dots the contour is cut.
    area_factor: a dot's area against what the neighbours' motion predicts may differ by this
    factor; beyond, it is partly covered or merged. gate_pitch: how far from its prediction a dot is
    looked for. keep_frames: how long a lost dot is looked for where its neighbours have carried it;
    then where the affine motion around it puts it, within regain_pitch. odd_share: of the dots, by
    which a guess of the skin's motion may explain less than the last one did before others are
    tried. step_tolerance: how much the steps of two neighbours within one frame may differ, in
    their distance. ncc_min: identity of the ring of colours. ncc_found: the same for a dot found
    again anywhere in the image. ring_d: inner and outer radius of the ring. min_texture: standard
    deviation (grey levels) of the ring below which a pattern has no colours to identify dots by,
    and the neighbours alone tell. min_found_share: of the expected dots, in the first image.
    """

    work_d_px: float = 7.0
    blur_d: float = 0.17
    level: float = 0.5
    area_factor: float = 1.7
    gate_pitch: float = 0.45
    keep_frames: int = 2
    regain_pitch: float = 0.3
    odd_share: float = 0.02
    step_tolerance: float = 0.3
    ncc_min: float = 0.5
    ncc_found: float = 0.65
    ring_d: tuple[float, float] = (0.75, 1.5)
    min_texture: float = 2.0
    min_found_share: float = 0.5
