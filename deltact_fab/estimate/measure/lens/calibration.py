"""Lens calibration from images of boards: fit, uncertainty and camera file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import InputError, SolverError, read_json
from deltact_fab.sensor import (
    Checkerboard,
    Fisheye,
    FlatField,
    SensorDimensions,
    ShapeError,
    camera_toml,
)

from . import trust
from .corners import Corners, find_corners, read_image
from .problem import BoardView, LensProblem, LensSolution, Prior, first_pose, nominal, priors, solve

BoardPoints = tuple[Checkerboard, NDArray[np.float64], NDArray[np.int64]]
"""A board, its corners' pixels (n, 2), and their columns and rows on it (n, 2)."""
MIN_BOARD_CORNERS = 12  # by hand: fewer leave a pose and a lens undetermined
CLEAR_DEPTH_PX = 0.5  # sigma 3 mm below the face; by hand: boards in air reach 0.25 (decision 0019)


@dataclass(frozen=True)
class LensCalibration:
    """Lens with its uncertainty.

    sigma, covariance: of the fitted parameters, in the order and units of `priors`. share:
    posterior over prior sigma. face_px, depth_px: sigma of projected points of the view, raw px,
    on the face and below it. cover: fraction of the view that contact corners span. simulated:
    seeds of simulated images, None for real ones.
    """

    lens: Fisheye
    priors: dict[str, Prior]
    sigma: dict[str, float]
    share: dict[str, float]
    covariance: NDArray[np.float64]
    face_px: float
    depth_px: dict[float, float]
    cover: float
    noise_px: float
    images: list[dict[str, Any]]
    unread: list[str]
    simulated: list[int] | None

    @classmethod
    def from_points(
        cls, contact: Sequence[BoardPoints], air: Sequence[BoardPoints],
        size_px: tuple[int, int], sensor: SensorDimensions,
    ) -> LensCalibration:  # fmt: skip
        """Calibrate from corners of another detector. Raises as `lens_from_corners`."""
        views = [
            BoardView(Corners(f"board {k}", *points), touching)
            for boards, touching in ((contact, True), (air, False))
            for k, points in enumerate(boards, 1)
        ]
        return lens_from_corners(views, size_px, sensor)

    def notes(self) -> list[str]:
        """Return remarks on the figures."""
        guessed = [n for n, s in self.share.items() if not self.priors[n].weak and s > 0.9]
        lines = []
        if guessed:
            names = ", ".join(guessed)
            lines.append(f"not determined by these images, kept at design values: {names}")
        if self.depth_px[3.0] > CLEAR_DEPTH_PX:
            lines.append(
                f"uncertainty 3 mm below the face: {self.depth_px[3.0]:.1f} px (one sigma); add "
                "photographs of boards in air, at several heights and tilts"
            )
        lines.append(
            "absolute scale comes from the board's square size; an error in it is not detectable "
            "here"
        )
        if self.images[0]["skin"]:
            lines.append("the sensor's origin is the middle of the skin, its axes the skin's")
        else:
            lines.append("the sensor's origin lies below the pupil, its x along the image's rows")
        lines += [f"no board found in {name}" for name in self.unread]
        return lines

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, as in the camera file and `calibrate lens --json`."""
        return {
            "simulated": self.simulated is not None,
            "seeds": self.simulated or [],
            "rms_px": self.noise_px,
            "sigma_face_px": self.face_px,
            "sigma_3mm_px": self.depth_px[3.0],
            "sigma_6mm_px": self.depth_px[6.0],
            "cover": self.cover,
            "n_images": len(self.images),
            "n_corners": sum(i["corners"] for i in self.images),
            "n_outliers": sum(i["outliers"] for i in self.images),
            "notes": self.notes(),
            "parameters": {
                n: {
                    "value": getattr(self.lens, n),
                    "sigma": self.sigma[n],
                    "prior": p.mean,
                    "prior_sigma": p.sigma,
                    "prior_from": p.source,
                }
                for n, p in self.priors.items()
            },
            "order": list(self.priors),
            "covariance": self.covariance.tolist(),
            "images": self.images,
        }

    def camera_toml(self, flat: str | None = None) -> str:
        """Format the camera file; flat: name of the flat-field image beside it."""
        data = self.as_dict()
        images = data.pop("images")
        data["files"] = [i["file"] for i in images]
        tables: dict[str, Any] = {"calibration": data}
        if flat is not None:
            tables["flat"] = {"file": flat}
        origin = "simulated images" if data["simulated"] else "images"
        about = [
            f"A camera, calibrated from {data['n_corners']} corners in {len(images)} {origin}.",
            "sigma_*_px: own sigma (one, in px of the raw image, 95th percentile of the view).",
        ]
        return camera_toml(self.lens, tables, about)


def calibrate_lens(
    contact: Sequence[Path],
    board: Checkerboard,
    air: Sequence[Path] = (),
    air_board: Checkerboard | None = None,
    sensor: SensorDimensions | None = None,
) -> LensCalibration:
    """Calibrate the lens of a sensor from image files of boards on its face and in the air.

    contact: of `board`, in optical contact with the face. air: of `air_board` (default: the same).
    sensor: the design, whose thicknesses are the priors. Raises InputError for unusable images
    and for a calibration that is too uncertain (see `trust`).
    """
    if not contact:
        raise InputError(
            "no contact image: boards in air alone leave the face undetermined, as air gap and "
            "board heights are coupled; give an image of the chessboard skin, or of a board "
            "wetted onto the face"
        )
    if air and (air_board or board).skin:
        raise InputError("--air: a skin cannot be held in the air; name the board with --air-board")
    views: list[BoardView] = []
    unread: list[str] = []
    height, width = read_image(contact[0]).shape[:2]
    for path in (*contact, *air):
        image, touching = read_image(path), path in contact
        if image.shape[:2] != (height, width):
            raise InputError(
                f"{path}: {image.shape[1]} x {image.shape[0]} px, and {contact[0]} has "
                f"{width} x {height}"
            )
        corners = find_corners(image, board if touching else air_board or board, str(path))
        if corners is None:
            unread.append(str(path))
        else:
            views.append(BoardView(corners, touching))
    if not any(s.contact for s in views):
        sides = "a skin" if board.skin else f"a board of {board}, fully visible,"
        names = ", ".join(map(str, contact[:3])) + (", ..." if len(contact) > 3 else "")
        raise InputError(f"{names}: {sides} was not found in any contact image")
    sensor = sensor or SensorDimensions()
    return lens_from_corners(views, (width, height), sensor, unread, _seeds((*contact, *air)))


def fit_flat_field(blank: Path, lens: Fisheye) -> FlatField:
    """Fit the flat field to an image file of a blank skin, by this lens. Raises InputError."""
    image = read_image(blank)
    height, width = image.shape[:2]
    if (width, height) != (lens.width_px, lens.height_px):
        raise InputError(
            f"--flat {blank}: {width} x {height} px, and the boards' images have "
            f"{lens.width_px} x {lens.height_px}"
        )
    return FlatField.from_blank(image, f"--flat {blank}")


def lens_from_corners(
    views: Sequence[BoardView],
    size_px: tuple[int, int],
    sensor: SensorDimensions,
    unread: Sequence[str] = (),
    simulated: list[int] | None = None,
) -> LensCalibration:
    """Calibrate from detected corners in images of (width, height) px. Raises InputError."""
    for view in views:
        if len(view.corners.px) < MIN_BOARD_CORNERS:
            raise InputError(
                f"{view.corners.source}: {len(view.corners.px)} corners of {view.corners.board}; "
                f"at least {MIN_BOARD_CORNERS} are needed"
            )
    contact_views = [s for s in views if s.contact]
    air_views = [s for s in views if not s.contact]
    base = nominal(sensor, [s.corners for s in contact_views], np.array(size_px))
    by_name = priors(base, on_skin=contact_views[0].corners.board.skin)
    try:
        problem = LensProblem(base, by_name, contact_views)
        fit = solve(
            problem,
            np.concatenate((np.zeros(len(by_name)), *(first_pose(s, base) for s in contact_views))),
            scale_px=1.0,
        )
        if air_views:
            lens = problem.lens(fit.x)
            air_poses = [first_pose(s, lens) for s in air_views]
            problem = LensProblem(base, by_name, [*contact_views, *air_views])
            fit = solve(problem, np.concatenate((fit.x, *air_poses)))
    except (SolverError, ShapeError) as error:
        raise InputError(f"{views[0].corners.source}: {error}") from error
    n = len(problem.names)
    shares = np.sqrt(np.diag(fit.covariance))[:n]
    covered = trust.cover(problem, fit, sensor)
    face_px = trust.sigma_px(problem, fit, sensor, 0.0)
    trust.refuse(problem, fit, shares.tolist(), covered, face_px)
    scale = np.array([p.sigma for p in by_name.values()])
    return LensCalibration(
        lens=problem.lens(fit.x),
        priors=by_name,
        sigma=dict(zip(by_name, (shares * scale).tolist(), strict=True)),
        share=dict(zip(by_name, shares.tolist(), strict=True)),
        covariance=fit.covariance[:n, :n] * scale[:, None] * scale,
        face_px=face_px,
        depth_px={d: trust.sigma_px(problem, fit, sensor, d) for d in trust.DEPTHS_MM},
        cover=covered,
        noise_px=fit.noise_px,
        images=[_entry(s, fit, rows) for s, rows in zip(problem.views, problem.rows, strict=True)],
        unread=list(unread),
        simulated=simulated,
    )


def _entry(view: BoardView, fit: LensSolution, rows: slice) -> dict[str, Any]:
    inliers = fit.inliers[rows]
    return {
        "file": view.corners.source,
        "board": str(view.corners.board),
        "skin": view.corners.board.skin,
        "contact": view.contact,
        "corners": len(inliers),
        "outliers": int((~inliers).sum()),
        "rms_px": float(np.sqrt(np.mean(fit.residual_px[rows][inliers] ** 2))),
    }


def _seeds(images: Sequence[Path]) -> list[int] | None:
    """Return the seeds of simulated images among these; None if all are real."""
    seeds = set()
    for folder in {path.parent for path in images}:
        try:
            mark = read_json(folder / Checkerboard.mark_file)
        except InputError:
            continue
        seed = mark.get("seed", -1)
        if mark.get("simulated") and isinstance(seed, int):
            seeds.add(seed)
    return sorted(seeds) or None
