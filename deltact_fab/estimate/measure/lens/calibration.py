"""A lens from images of boards: the fit, its own uncertainty, and the file it is kept in."""

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
from .corners import find, read_image
from .problem import BoardView, LensProblem, LensSolution, Prior, nominal, pose, priors, solve

CLEAR_DEPTH_PX = 0.5


@dataclass(frozen=True)
class LensCalibration:
    """A lens with its uncertainty.

    sigma, covariance: of the fitted parameters, in the order and units of `priors`. share: what is
    left of a prior's sigma. face_px, depth_px: own sigma of where a point of the view is seen, raw
    px, on the face and below it. cover: share of the view that contact corners span. simulated:
    seeds of simulated images, None where they are real.
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

    def notes(self) -> list[str]:
        """What a reader of the numbers must know."""
        guessed = [n for n, s in self.share.items() if not self.priors[n].weak and s > 0.9]
        lines = []
        if guessed:
            lines.append(f"the images do not tell, taken as made: {', '.join(guessed)}")
        if self.depth_px[3.0] > CLEAR_DEPTH_PX:
            lines.append(
                f"what lies 3 mm below the face is known to {self.depth_px[3.0]:.1f} px (one "
                "sigma): photograph boards in the air too, at several heights and tilts"
            )
        lines.append(
            "lengths have the boards' scale: what is wrong with the squares' side shows only where "
            "it contradicts the thicknesses"
        )
        if self.images[0]["skin"]:
            lines.append("the sensor's origin is the middle of the skin, its axes the skin's")
        else:
            lines.append("the sensor's origin lies below the pupil, its x along the image's rows")
        lines += [f"no board found in {name}" for name in self.unread]
        return lines

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as the camera file and `calibrate --json` hold it."""
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
                    "prior_from": p.why,
                }
                for n, p in self.priors.items()
            },
            "order": list(self.priors),
            "covariance": self.covariance.tolist(),
            "images": self.images,
        }

    def camera_toml(self, flat: str | None = None) -> str:
        """The text of the camera file; flat: name of the flat-field image beside it."""
        found = self.as_dict()
        images = found.pop("images")
        found["files"] = [i["file"] for i in images]
        tables: dict[str, Any] = {"calibration": found}
        if flat is not None:
            tables["flat"] = {"file": flat}
        origin = "simulated images" if found["simulated"] else "images"
        about = [
            f"A camera, calibrated from {found['n_corners']} corners in {len(images)} {origin}.",
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
    """Calibrate the lens of a sensor by image files of boards on its face and in the air beyond.

    contact: of `board`, in optical contact with the face. air: of `air_board` (default: the same).
    sensor: the design, whose thicknesses are the priors. Raises InputError for images that cannot
    be used and for a calibration that would not be known well enough (see `trust`).
    """
    if not contact:
        raise InputError(
            "no contact image: boards in air leave the face undetermined, for the air gap and "
            "their heights shift together; give an image of the chessboard skin, or of a board "
            "wetted onto the face"
        )
    if air and (air_board or board).skin:
        raise InputError("--air: a skin is not held in the air; name the board with --air-board")
    seen: list[BoardView] = []
    unread: list[str] = []
    height, width = read_image(contact[0]).shape[:2]
    for path in (*contact, *air):
        image, touching = read_image(path), path in contact
        if image.shape[:2] != (height, width):
            raise InputError(
                f"{path}: {image.shape[1]} x {image.shape[0]} px, and {contact[0]} has "
                f"{width} x {height}"
            )
        corners = find(image, board if touching else air_board or board, str(path))
        if corners is None:
            unread.append(str(path))
        else:
            seen.append(BoardView(corners, touching))
    if not any(s.contact for s in seen):
        sides = "a skin" if board.skin else f"a board of {board}, seen whole,"
        names = ", ".join(map(str, contact[:3])) + (", ..." if len(contact) > 3 else "")
        raise InputError(f"{names}: {sides} was not found in any contact image")
    sensor = sensor or SensorDimensions()
    return of_corners(seen, (width, height), sensor, unread, _seeds((*contact, *air)))


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


def of_corners(
    seen: Sequence[BoardView],
    size_px: tuple[int, int],
    sensor: SensorDimensions,
    unread: Sequence[str] = (),
    simulated: list[int] | None = None,
) -> LensCalibration:
    """The same from corners that were found, in images of (width, height) px. Raises InputError."""
    touching = [s for s in seen if s.contact]
    held = [s for s in seen if not s.contact]
    base = nominal(sensor, [s.corners for s in touching], np.array(size_px))
    known = priors(base, placed=touching[0].corners.board.skin)
    try:
        problem = LensProblem(base, known, touching)
        fit = solve(
            problem,
            np.concatenate((np.zeros(len(known)), *(pose(s, base) for s in touching))),
            scale_px=1.0,
        )
        if held:
            lens = problem.lens(fit.x)
            more = [pose(s, lens) for s in held]
            problem = LensProblem(base, known, [*touching, *held])
            fit = solve(problem, np.concatenate((fit.x, *more)))
    except (SolverError, ShapeError) as why:
        raise InputError(f"{seen[0].corners.source}: {why}") from why
    n = len(problem.names)
    left = np.sqrt(np.diag(fit.covariance))[:n]
    covered = trust.cover(problem, fit, sensor)
    face_px = trust.sigma_px(problem, fit, sensor, 0.0)
    trust.refuse(problem, fit, left.tolist(), covered, face_px)
    scale = np.array([p.sigma for p in known.values()])
    return LensCalibration(
        lens=problem.lens(fit.x),
        priors=known,
        sigma=dict(zip(known, (left * scale).tolist(), strict=True)),
        share=dict(zip(known, left.tolist(), strict=True)),
        covariance=fit.covariance[:n, :n] * scale[:, None] * scale,
        face_px=face_px,
        depth_px={d: trust.sigma_px(problem, fit, sensor, d) for d in trust.DEPTHS_MM},
        cover=covered,
        noise_px=fit.noise_px,
        images=[_said(s, fit, rows) for s, rows in zip(problem.seen, problem.rows, strict=True)],
        unread=list(unread),
        simulated=simulated,
    )


def _said(seen: BoardView, fit: LensSolution, rows: slice) -> dict[str, Any]:
    kept = fit.kept[rows]
    return {
        "file": seen.corners.source,
        "board": str(seen.corners.board),
        "skin": seen.corners.board.skin,
        "contact": seen.contact,
        "corners": len(kept),
        "outliers": int((~kept).sum()),
        "rms_px": float(np.sqrt(np.mean(fit.off_px[rows][kept] ** 2))),
    }


def _seeds(images: Sequence[Path]) -> list[int] | None:
    """Seeds of the simulated images among these; None where all are real."""
    seeds = set()
    for folder in {path.parent for path in images}:
        try:
            said = read_json(folder / Checkerboard.mark_file)
        except InputError:
            continue
        seed = said.get("seed", -1)
        if said.get("simulated") and isinstance(seed, int):
            seeds.add(seed)
    return sorted(seeds) or None
