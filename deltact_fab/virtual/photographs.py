"""A folder of simulated photographs of boards, as a bench's owner would take them to calibrate.

FOLDER/contact/*.png   the skin, or a board wetted onto the face
FOLDER/air/*.png       a board in the air beyond the face
FOLDER/blank.png       a skin without a pattern, for the flat field
FOLDER/truth/lens.toml the true lens; nothing that calibrates reads it
`photographs.json` beside the images says that they are simulated, and from which seed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files import making, write_whole
from ..imaging import ImageSensor
from ..measure.lens import PHOTOGRAPHS, Checkerboard
from ..optics import as_toml
from ..record import encode_png
from ..record.files import json_bytes
from ..rig.config import VirtualConfig
from ..shapes import SensorDimensions
from .boards import ON_FACE, Studio
from .lens import true_lens

MOST = 200


def take(
    config: VirtualConfig,
    design: SensorDimensions,
    board: Checkerboard,
    folder: Path,
    *,
    contact: int = 1,
    air: int = 0,
    air_board: Checkerboard | None = None,
    seed: int = 0,
) -> list[Path]:
    """Write the photographs, and return their files; the folder must be new or empty.

    contact, air: how many of `board` on the face and of air_board (default: the same) beyond it; a
    skin is photographed once. Raises InputError before anything is written.
    """
    held = air_board or board
    if not (0 <= contact <= MOST and 0 <= air <= MOST):
        raise InputError(f"contact {contact}, air {air}: 0 to {MOST} images of each")
    if air and held.skin:
        raise InputError("--air: a skin is not held in the air; name the board with --air-board")
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise InputError(f"{folder}: is there already; name a new folder")
    lens = true_lens(config, design)
    studio = Studio(lens, ImageSensor(**config.virtual.camera.model_dump()), design)
    rng = np.random.default_rng(np.random.SeedSequence([seed, 5]))
    poses = [ON_FACE] if board.skin else list(studio.contact_poses(board, contact, rng))
    taken = {
        f"contact/{k}.png": studio.photograph(board, pose, rng) for k, pose in enumerate(poses, 1)
    }
    for k, pose in enumerate(studio.air_poses(held, air, rng), 1):
        taken[f"air/{k}.png"] = studio.photograph(held, pose, rng, contact=False)
    taken["blank.png"] = studio.blank(rng)
    said = json_bytes({"simulated": True, "seed": seed})
    about = ["The true lens of simulated photographs: for comparison, not for calibration."]
    truth = as_toml(lens, {"simulated": {"seed": seed}}, about)
    with making(folder):
        for name in {"truth", *(str(Path(n).parent) for n in taken)}:
            (folder / name).mkdir(parents=True, exist_ok=True)
    for name, image in taken.items():
        write_whole(folder / name, encode_png(image))
    for name in {str(Path(n).parent) for n in taken}:
        write_whole(folder / name / PHOTOGRAPHS, said)
    write_whole(folder / "truth" / "lens.toml", truth.encode())
    return [folder / name for name in taken]
