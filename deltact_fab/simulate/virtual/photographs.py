"""A folder of simulated photographs of boards, as a bench's owner would take them to calibrate.

FOLDER/contact/*.png   the skin, or a board wetted onto the face
FOLDER/air/*.png       a board in the air beyond the face
FOLDER/blank.png       a skin without a pattern, for the flat field
FOLDER/truth/lens.toml the true lens; nothing that calibrates reads it
`photographs.json` beside the images says that they are simulated, and from which seed.

A board lies on the face in optical contact, or is held in the air beyond it, where every ray of a
pixel meets its plane in one point. Squares are black ink on white with an edge as wide as the ink
spreads; blur, shading, mosaic and noise are the camera's. All of it is a model.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from deltact_fab.bench import VirtualConfig, encode_png
from deltact_fab.common import Array, InputError, make_folder, write_whole
from deltact_fab.physics import Exposure
from deltact_fab.sensor import (
    Checkerboard,
    Fisheye,
    ImageSensor,
    Medium,
    Rectified,
    SensorDimensions,
    camera_toml,
)

from .lens import true_lens
from .picture import RawView

# By hand, for plausible photographs: reflectances (a blank skin saturates no pixel), half width of
# the ramp from black to white, samples per pixel and axis, white margin, image border, least height
# of a board in air, draws of a pose.
INK_LEVEL, FILM_LEVEL, ROOM_LEVEL, BLANK_LEVEL = 0.04, 0.85, 0.25, 0.6
INK_EDGE_MM = 0.02
FINE_N = 3
MARGIN_SQUARES = 1.0
IMAGE_BORDER_PX = 6
MIN_AIR_MM = 0.5
POSE_TRIES = 300


@dataclass(frozen=True)
class BoardPose:
    """Pose of a board in the sensor frame: a rotation, then its middle moved to at_mm."""

    at_mm: tuple[float, float, float]
    turn: Rotation

    def points_mm(self, board_mm: Array) -> NDArray[np.float64]:
        """Points (..., 2) of the board's plane in the sensor frame, (..., 3)."""
        flat = np.concatenate((board_mm, np.zeros_like(board_mm[..., :1])), axis=-1)
        turned = self.turn.apply(flat.reshape(-1, 3)).reshape(flat.shape)
        return np.asarray(turned + self.at_mm)


ON_FACE = BoardPose((0.0, 0.0, 0.0), Rotation.identity())


class Studio:
    def __init__(self, lens: Fisheye, sensor: ImageSensor, design: SensorDimensions) -> None:
        self.lens, self.design = lens, design
        self._exposure = Exposure(sensor, RawView(lens, Rectified.from_sensor(design, lens)).offset)
        rows, columns = np.arange(-1.0, lens.height_px + 1), np.arange(-1.0, lens.width_px + 1)
        self._origin, self._slope = lens.ray(np.stack(np.meshgrid(columns, rows), -1), "air")

    def photograph(
        self, board: Checkerboard, pose: BoardPose, rng: np.random.Generator, contact: bool = True
    ) -> NDArray[np.uint8]:
        """Image (h, w, 3) BGR of a board on the face, or in the air beyond it."""
        turn = pose.turn.as_matrix()
        origin, board_mm = self._origin, np.asarray(pose.at_mm)
        points_mm = origin
        if not contact:
            normal = turn[:, 2]
            z_mm = (board_mm - origin) @ normal / (self._slope @ normal)
            points_mm = origin + self._slope * z_mm[..., None]
        on_board = (points_mm - board_mm) @ turn[:, :2]
        u, v = (self._upsample(on_board[..., k]) for k in range(2))
        surround = FILM_LEVEL if board.skin else ROOM_LEVEL
        albedo = _board_albedo(board, u, v, surround)
        return self._expose(albedo, rng)

    def blank(self, rng: np.random.Generator) -> NDArray[np.uint8]:
        """Image (h, w, 3) BGR of a skin without a pattern, for the flat field."""
        height, width = self._origin.shape[:2]
        even = np.full(((height - 2) * FINE_N, (width - 2) * FINE_N), BLANK_LEVEL, np.float32)
        return self._expose(even, rng)

    def _expose(self, albedo: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.uint8]:
        """Reflectances, FINER a pixel, behind the window of the frame."""
        half = np.array(self.design.skin.opening_half_mm, np.float32)
        x, y = (self._upsample(self._origin[..., k]) for k in range(2))
        with np.errstate(invalid="ignore"):
            window = (np.abs(x) <= half[0]) & (np.abs(y) <= half[1])
        albedo = np.where(window, albedo, np.float32(INK_LEVEL))
        size = (self.lens.width_px, self.lens.height_px)
        light = np.asarray(cv2.resize(albedo, size, interpolation=cv2.INTER_AREA), np.float32)
        return self._exposure.expose(np.repeat(light[..., None], 3, axis=-1), rng)

    def _upsample(self, values: Array) -> NDArray[np.float32]:
        """Values at the pixels' middles, with a border of one, to FINER a pixel."""
        grid = np.asarray(values, np.float32)
        fine = cv2.resize(grid, None, fx=FINE_N, fy=FINE_N, interpolation=cv2.INTER_LINEAR)
        return np.asarray(fine[FINE_N:-FINE_N, FINE_N:-FINE_N], np.float32)

    def is_visible(self, board: Checkerboard, pose: BoardPose, contact: bool) -> bool:
        """True if all inner corners lie in the image and in the face's window."""
        columns, rows = board.corners
        index = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1)
        corners = pose.points_mm(board.at_mm(index)).reshape(-1, 3)
        sides = np.array([board.nx, board.ny]) * board.square_mm / 2
        rim = pose.points_mm(np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) * sides)
        if not contact and rim[:, 2].min() < MIN_AIR_MM:
            return False
        try:
            medium: Medium = "gel" if contact else "air"
            px = self.lens.project_px(corners, medium)
            crossing = self.lens.crossing_mm(corners, medium)
        except InputError:
            return False  # outside the field
        last = np.array([self.lens.width_px, self.lens.height_px]) - 1 - IMAGE_BORDER_PX
        half = np.array(self.design.skin.opening_half_mm) - board.square_mm / 4
        inside = np.all((px >= IMAGE_BORDER_PX) & (px <= last)) and np.all(np.abs(crossing) <= half)
        return bool(inside)

    def contact_poses(
        self, board: Checkerboard, n: int, rng: np.random.Generator
    ) -> Iterator[BoardPose]:
        """Poses of a board wetted onto the face: middle first, then toward the corners."""
        places = ((0, 0), (1, 1), (-1, 1), (1, -1), (-1, -1))
        for k in range(n):
            out = np.array(places[k % len(places)])
            turn = Rotation.from_euler("z", rng.uniform(-5, 5), degrees=True)
            reach = np.array(self.design.skin.opening_half_mm) * rng.uniform(0.9, 1.0)
            for shrink in np.linspace(1, 0, 41):
                x, y = out * reach * shrink
                pose = BoardPose((float(x), float(y), 0.0), turn)
                if self.is_visible(board, pose, contact=True):
                    yield pose
                    break
            else:
                raise InputError(f"--board {board}: not completely in view on the face")

    def air_poses(
        self, board: Checkerboard, n: int, rng: np.random.Generator
    ) -> Iterator[BoardPose]:
        """Poses of a board in the air beyond the face at random heights, positions and tilts."""
        for _ in range(n):
            for _ in range(POSE_TRIES):
                tilts = rng.uniform(-25, 25, 2)
                turn = Rotation.from_euler("xyz", (*tilts, rng.uniform(-15, 15)), degrees=True)
                x, y = rng.uniform(-5, 5, 2)
                pose = BoardPose((float(x), float(y), float(rng.uniform(3, 20))), turn)
                if self.is_visible(board, pose, contact=False):
                    yield pose
                    break
            else:
                raise InputError(f"--air: a board of {board} is not completely in view")


def _board_albedo(
    board: Checkerboard, u_mm: NDArray[np.float32], v_mm: NDArray[np.float32], surround: float
) -> NDArray[np.float32]:
    """Albedo at points of a board's plane; nan (no point seen) is black."""
    across = np.float32(board.nx * board.square_mm / 2), np.float32(board.ny * board.square_mm / 2)
    out = np.maximum(np.abs(u_mm) - across[0], np.abs(v_mm) - across[1])
    levels = FILM_LEVEL + INK_LEVEL, FILM_LEVEL - INK_LEVEL
    mean, half = (np.float32(level / 2) for level in levels)
    dark = _stripes(u_mm + across[0], board.square_mm, board.nx)
    dark *= _stripes(v_mm + across[1], board.square_mm, board.ny)
    albedo = np.where(out <= 0, mean - half * dark, np.float32(FILM_LEVEL))
    albedo = np.where(out > MARGIN_SQUARES * board.square_mm, np.float32(surround), albedo)
    return np.where(np.isfinite(out), albedo, np.float32(INK_LEVEL))


def _stripes(at_mm: NDArray[np.float32], width_mm: float, n: int) -> NDArray[np.float32]:
    """1 in the first of n stripes, from 0 on, -1 in the next, and so on, with ramps between."""
    with np.errstate(invalid="ignore"):
        nearest = np.clip(np.rint(at_mm / np.float32(width_mm)), 1, n - 1)
        ramp = np.clip((at_mm - nearest * np.float32(width_mm)) / np.float32(INK_EDGE_MM), -1, 1)
        return np.where(np.mod(nearest, 2) == 0, ramp, -ramp)


MAX_PHOTOS = 200  # by hand: more is a typing error


def take_photographs(
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
    raised_board = air_board or board
    if not (0 <= contact <= MAX_PHOTOS and 0 <= air <= MAX_PHOTOS):
        raise InputError(f"contact {contact}, air {air}: 0 to {MAX_PHOTOS} images of each")
    if air and raised_board.skin:
        raise InputError("--air: not possible with a skin; name the board with --air-board")
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise InputError(f"{folder}: already exists; name a new folder")
    shortfall = design.optics.print_shortfall(board.nx * board.square_mm) if board.skin else None
    if shortfall is not None:
        raise InputError(f"--board skin: {shortfall}: wet a larger board onto the face")
    lens = true_lens(config, design)
    studio = Studio(lens, config.virtual.camera, design)
    rng = np.random.default_rng(np.random.SeedSequence([seed, 5]))
    poses = [ON_FACE] if board.skin else list(studio.contact_poses(board, contact, rng))
    images = {
        f"contact/{k}.png": studio.photograph(board, pose, rng) for k, pose in enumerate(poses, 1)
    }
    for k, pose in enumerate(studio.air_poses(raised_board, air, rng), 1):
        images[f"air/{k}.png"] = studio.photograph(raised_board, pose, rng, contact=False)
    images["blank.png"] = studio.blank(rng)
    marker = json.dumps({"seed": seed, "simulated": True}, indent=1).encode() + b"\n"
    about = ["The true lens of simulated photographs: for comparison, not for calibration."]
    truth = camera_toml(lens, {"simulated": {"seed": seed}}, about)
    make_folder(folder, "truth", *(str(Path(name).parent) for name in images))
    for name, image in images.items():
        write_whole(folder / name, encode_png(image))
    for name in {str(Path(n).parent) for n in images}:
        write_whole(folder / name / Checkerboard.mark_file, marker)
    write_whole(folder / "truth" / "lens.toml", truth.encode())
    return [folder / name for name in images]
