"""One camera for a design: rig, boards, sticker and calibration have the design's, or say no."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from called import called

from deltact_fab.bench.rig import config as rigs
from deltact_fab.common.errors import InputError
from deltact_fab.estimate.measure.lens.calibration import calibrate_lens
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.dimensions import Design
from deltact_fab.sensor.optics.checkerboard import Checkerboard
from deltact_fab.simulate.virtual.lens import true_lens
from deltact_fab.simulate.virtual.photographs import take_photographs

FISHEYE = rigs.load_rig("fisheye")[0]
assert isinstance(FISHEYE, rigs.VirtualConfig)
SKIN, PLATE = Checkerboard(23, 23, 1.5, skin=True), Checkerboard(9, 7, 3.0)


def random_design(seed: int) -> Design:
    """Another crop, focal length, gap, plate and gel than the paper's, that see the same face."""
    rng = np.random.default_rng([seed, 50])
    base = load_design("deltact")
    finer = rng.uniform(0.85, 1.25)
    return replace(
        base,
        camera=replace(
            base.camera,
            focal_length_mm=base.camera.focal_length_mm * finer,
            crop_width_px=2 * round(640 * finer),
            crop_height_px=2 * round(370 * finer),
        ),
        optics=replace(
            base.optics, air_gap_mm=rng.uniform(2.5, 4.0), acrylic_mm=rng.uniform(1.5, 4.0)
        ),
        skin=replace(base.skin, thickness_mm=rng.uniform(10.0, 14.0)),
    )


@pytest.mark.slow
def test_random_design_calibrates_to_its_lens(tmp_path: Path) -> None:
    """Through the fisheye rig: every parameter within three sigma of what drew (20 seeds did)."""
    seed = 0
    design = random_design(seed)
    folder = tmp_path / "photos"
    take_photographs(FISHEYE, design, SKIN, folder, air=4, air_board=PLATE, seed=seed)
    files = [sorted((folder / name).glob("*.png")) for name in ("contact", "air")]
    found = calibrate_lens(files[0], SKIN, files[1], PLATE, design)
    true = true_lens(FISHEYE, design)
    assert (found.lens.width_px, found.lens.height_px) == design.raw_size_px
    off = {n: abs(getattr(found.lens, n) - getattr(true, n)) / s for n, s in found.sigma.items()}
    print(max(off.items(), key=lambda item: item[1]), found.depth_px)
    assert max(off.values()) < 3, off


def test_lens_of_another_sensor_is_refused() -> None:
    lens = FISHEYE.virtual.lens
    assert lens is not None
    own = lens.model_copy(update={"design": None})
    virtual = FISHEYE.virtual.model_copy(update={"lens": own})
    rig = FISHEYE.model_copy(update={"virtual": virtual})
    true_lens(rig, load_design("deltact"))
    with pytest.raises(
        InputError, match=r"virtual\.lens\.air_gap_mm: 3\.05, and the design has 4\.5"
    ):
        true_lens(rig, load_design("large-60x50"))


WIDE = 'base = "large-60x50"\n[optics]\nimage_width_px = 1050\n'


def test_small_sticker_is_refused_everywhere(tmp_path: Path) -> None:
    """The same words from the protocol's check and the photographs of the skin."""
    (tmp_path / "wide.toml").write_text(WIDE)
    protocol = (Path(__file__).parents[3] / "protocols" / "first-press.toml").read_text()
    text = protocol.replace('design = "deltact"', 'design = "wide.toml"')
    text = text.replace('channels = ["force"]', 'channels = ["image", "force"]')
    (tmp_path / "press.toml").write_text(text)
    for words in (
        ["protocol", "check", "press.toml", "--rig", "virtual"],
        ["rig", "photograph", "fisheye", "--board", "skin", "--design", "wide.toml", "--out", "p"],
    ):
        done = called(*words, cwd=tmp_path)
        said = done.stdout + done.stderr
        assert done.returncode != 0, words
        assert "is smaller than the view of 57.86 x 35.04 mm" in said, said
    assert not (tmp_path / "p").exists()
