"""What the measurement finds on other people's recordings: `python -m benchmarks.real FOLDER...`

A folder is a clone of a repository of RECORDINGS, a work tree or a bare git directory; its files
tell which, and what only an older commit or another branch has is read from there. Each clone's
section of docs/evidence/real.md is written anew, the others stay. Nothing of a recording is kept.
For nHHD, `peer.python()` must have pynhhd (peers/README.md).
"""

from __future__ import annotations

import argparse
import io
import json
import math
import re
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from scipy import ndimage

from deltact_fab.common import digest
from deltact_fab.common.aliases import Array
from deltact_fab.common.errors import InputError, RunFailed, SensorError
from deltact_fab.common.files import write_whole
from deltact_fab.estimate.analysis.intervals import Interval
from deltact_fab.estimate.measure.dots.tracker import DotTracker
from deltact_fab.estimate.measure.face import FaceFlow
from deltact_fab.estimate.measure.flow.tracker import FlowTracker
from deltact_fab.estimate.measure.force import make_features
from deltact_fab.estimate.measure.force.model import Features
from deltact_fab.estimate.measure.hodge import Hodge
from deltact_fab.estimate.measure.regression import least_squares
from deltact_fab.estimate.measure.sensor_id import SensorModel
from deltact_fab.sensor.optics.camera import Pinhole

from . import peer

PAGE = Path(__file__).parents[1] / "docs" / "evidence" / "real.md"
HEAD = """# On other people's recordings

Written by `python -m benchmarks.real FOLDER...` on clones that you name; do not edit. Nothing here
is simulated. **Real sensors, and none of them is this one**: no recording of the paper's sensor was
found. The recordings are measured where they lie and are no part of this project.
"""
TRACKERS = ("fused", "dis-medium", "farneback/summed", "paper")
BLOCK = 15  # frames that are left out together
REST = 30  # frames of the bubble before it is touched
HALF_PX, REACH_PX, EVERY_PX = 15, 8, 40  # of the correlation's windows, search and nodes
MIN_NCC, MIN_CONTRAST, MOVED_PX = 0.8, 12.0, 1.0

Files = dict[str, bytes]


@dataclass(frozen=True)
class Recording:
    """What a repository has to measure.

    folder: what tells it from others; wanted: which of its files are read (regular expression).
    measure: from these, by path, to lines of the page.
    """

    about: str
    repository: str
    folder: str
    wanted: str
    measure: Callable[[Files], list[str]]

    def section(self, clone: Path) -> str | None:
        """Its section of the page; None of a clone without its files."""
        # The commit that last set them, on whatever branch.
        log = ("log", "--all", "-n1", "--diff-filter=AM", "--format=%H %cs", "--", self.folder)
        commit, _, date = git(clone, *log).decode().strip().partition(" ")
        tree = ("ls-tree", "-r", "--name-only", commit, "--", self.folder)
        listed = git(clone, *tree).decode().splitlines() if commit else []
        if not (names := [name for name in listed if re.search(self.wanted, name)]):
            return None
        files = {}
        for name in names:
            with suppress(InputError):  # a clone may lack its largest files
                files[name] = git(clone, "cat-file", "blob", f"{commit}:{name}")
        if not files:
            raise InputError(f"{clone}: all {len(names)} files wanted are absent from the clone")
        lacks = len(names) - len(files)
        absent = f", {lacks} of {len(names)} files absent from the clone" if lacks else ""
        code = digest.code_digest("real", package=Path(__file__).parent)
        what = f"{self.repository} @ {commit[:7]} of {date}, `{self.folder}`{absent}; "
        what += f"measured {time.strftime('%Y-%m-%d')} by code {code}."
        return "\n".join((f"## {self.about}", "", what, "", *self.measure(files), ""))


def git(clone: Path, *asked: str) -> bytes:
    """What git says. Raises InputError, one line."""
    told = subprocess.run(["git", "-C", str(clone), *asked], capture_output=True, check=False)
    if told.returncode:
        why = told.stderr.decode(errors="replace").strip().splitlines()
        raise InputError(f"{clone}: git {asked[0]}: {why[-1] if why else 'failed'}")
    return told.stdout


def video(data: bytes) -> Iterator[Array]:
    """Images (h, w, 3) BGR of a video file's bytes."""
    with tempfile.NamedTemporaryFile(suffix=".avi") as file:
        file.write(data)
        file.flush()
        reader = cv2.VideoCapture(file.name)
        more, image = reader.read()
        while more:
            yield image
            more, image = reader.read()


def picture(data: bytes) -> Array:
    """An image file's bytes as (h, w, 3) BGR."""
    return np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR))


class Correlation:
    """Where windows of a first image are in later ones, by normalised cross-correlation.

    It judges the trackers and shares nothing with them: numpy and scipy, windows of 2 HALF_PX + 1
    around nodes (n, 2) (x, y), always those of the first image, searched within REACH_PX of where
    they were last; between pixels a paraboloid over 3 x 3. image: (h, w) or (h, w, 3).
    """

    def __init__(self, first: Array) -> None:
        grey, margin = _grey(first), HALF_PX + REACH_PX
        y, x = (range(margin, side - margin, EVERY_PX) for side in grey.shape)
        nodes = np.array([(a, b) for b in y for a in x])
        windows = np.stack([_window(grey, a, b, HALF_PX) for a, b in nodes])
        textured = windows.std(axis=(1, 2)) >= MIN_CONTRAST
        self.nodes, windows = nodes[textured], windows[textured]
        windows = windows - windows.mean(axis=(1, 2), keepdims=True)
        self._windows = windows / np.linalg.norm(windows, axis=(1, 2), keepdims=True)
        self._step = np.zeros_like(self.nodes)

    def update(self, image: Array) -> Array:
        """Displacements (n, 2) px from the first image, nan where the best correlation is below
        MIN_NCC, at the end of the search, or out of the image."""
        grey, side, margin = _grey(image), 2 * HALF_PX + 1, HALF_PX + REACH_PX
        out = np.full(self.nodes.shape, np.nan)
        for i, (node, window) in enumerate(zip(self.nodes, self._windows, strict=True)):
            x, y = node + self._step[i]
            if not (margin <= x < grey.shape[1] - margin and margin <= y < grey.shape[0] - margin):
                continue
            around = _window(grey, x, y, margin)
            every = np.lib.stride_tricks.sliding_window_view(around, (side, side))
            product = np.einsum("abij,ij->ab", every, window, optimize=True)
            inner = slice(HALF_PX, HALF_PX + 2 * REACH_PX + 1)
            mean, square = (
                ndimage.uniform_filter(v, side)[inner, inner] for v in (around, around**2)
            )
            ncc = product / (side * np.sqrt(np.maximum(square - mean**2, 1e-9)))
            row, column = np.unravel_index(ncc.argmax(), ncc.shape)
            inside = 0 < row < 2 * REACH_PX and 0 < column < 2 * REACH_PX
            if inside and ncc[row, column] >= MIN_NCC:
                self._step[i] += (column - REACH_PX, row - REACH_PX)
                out[i] = self._step[i] + _summit(ncc[row - 1 : row + 2, column - 1 : column + 2])
        return out


def _grey(image: Array) -> Array:
    return np.asarray(image, float) if image.ndim == 2 else np.asarray(image, float).mean(axis=2)


def _window(grey: Array, x: int, y: int, half: int) -> Array:
    return grey[y - half : y + half + 1, x - half : x + half + 1]


def _summit(near: Array) -> Array:
    """Where the paraboloid of least squares through 3 x 3 values has its top, from the middle."""
    y, x = (axis.ravel() for axis in np.mgrid[-1:2, -1:2])
    columns = np.stack((np.ones(9), x, y, x * x, x * y, y * y), axis=1)
    _, a, b, c, d, e = np.linalg.lstsq(columns, near.ravel(), rcond=None)[0]
    return np.clip(np.linalg.solve([[2 * c, d], [d, 2 * e]], [-a, -b]), -1, 1)


def left_out(columns: Array, y: Array, block: int = BLOCK) -> Array:
    """Errors (n,) of y (n,) by regressions on columns (n, k) that never saw its block of rows.

    An offset is fitted with them: the force sensor's zero is not known.
    """
    columns = np.column_stack((columns, np.ones(len(y))))
    names = [str(i) for i in range(columns.shape[1])]
    off = np.empty(len(y))
    for start in range(0, len(y), block):
        out = np.zeros(len(y), bool)
        out[start : start + block] = True
        fit = least_squares(columns[~out], y[~out], names)
        off[out] = columns[out] @ np.array(fit.coefficients) - y[out]
    return off


def bubble(files: Files) -> list[str]:
    """Trackers against the correlation, and force from flow. Raises InputError if images lack."""
    told = json.loads(files["demo/0/data.json"])
    force = np.array([row[3][:3] for row in told])
    if lacks := 1 + len(told) - len(files):
        raise InputError(f"demo/0: {lacks} images are absent from the clone")
    images = [np.load(io.BytesIO(files[f"demo/0/expand/rgb_{i}.npy"])) for i in range(len(told))]
    judge = Correlation(images[0])
    moved = np.stack([judge.update(image) for image in images])
    size_px = np.linalg.norm(moved, axis=-1)
    moving = size_px > MOVED_PX  # False where nan
    # In pixels: no scale is known, so a pixel is the millimetre of the features.
    camera = Pinhole(1.0, images[0].shape[1], images[0].shape[0], 1e3)
    sets = [make_features(name, SensorModel(camera)) for name in ("sums", "paper")]
    flows, forces, first = [], [], None

    def noise(shift: Array) -> float:
        return float(np.nanmedian(np.nanstd(shift[1:REST], axis=0)))

    for name in TRACKERS:
        tracker, (x, y) = FlowTracker(name), judge.nodes.T
        seen = [tracker.update(image) for image in images]
        found, sure = (np.stack([f[y, x] for f in of]) for of in
                       ([s.flow_px for s in seen], [s.confident for s in seen]))  # fmt: skip
        faces = [FaceFlow.from_flow(s, camera, spacing_px=8) for s in seen]
        first = found if first is None else first
        off = np.linalg.norm(found - moved, axis=-1)
        middle, most = np.percentile(off[moving & sure], (50, 95))
        flows.append(
            f"| {name} | {sum(face.trusted for face in faces)} | "
            f"{min(face.cover for face in faces):.3f} | {noise(found):.3f} | "
            f"{middle:.2f}, {most:.2f} ({np.percentile(off[moving], 95):.2f}) | "
            f"{sure[moving].mean():.0%} | "
            f"{np.median(np.linalg.norm(found - first, axis=-1)[moving]):.2f} | "
            f"{np.median([s.diagnostics.cpu_ms for s in seen]):.0f} |"
        )
        for features in sets:
            rows = np.array([features.compute(face) for face in faces])
            cells = " | ".join(_force(rows, features, axis) for axis in force.T)
            forces.append(f"| {name} | {features.name} | {cells} |")
    ranges = ", ".join(f"{n:.2f}" for n in np.ptp(force, axis=0))
    rest = ", ".join(f"{n:.2f}" for n in force[:REST].std(axis=0))
    return [
        f"{len(images)} images. The correlation: {len(x)} windows of {2 * HALF_PX + 1} px, motion "
        f"to {np.nanmax(size_px):.1f} px, noise at rest {noise(moved):.3f} px; its "
        f"{np.count_nonzero(moving)} displacements over {MOVED_PX:g} px judge.",
        "",
        "| tracker | trusted | least cover | noise at rest, px | off the correlation where "
        f"confident, px: median, 95 % (all, 95 %) | confident | off {TRACKERS[0]}, px, median | "
        "CPU ms |",
        "|---" * 8 + "|",
        *flows,
        "",
        f"Force ranges over {ranges} N and has {rest} N of noise in the first {REST} images. RMSE "
        f"in N of Fx, Fy, Fz with blocks of {BLOCK} images left out, 95 % intervals over the "
        "blocks, R2 in brackets. It is one press, in one direction. Goals: 0.20, 0.19, 0.25.",
        "",
        "| tracker | features | Fx | Fy | Fz |",
        "|---" * 5 + "|",
        *forces,
    ]


def _force(rows: Array, features: Features, force: Array) -> str:
    """A cell of the table: a force by all that the set has for forces, blocks left out.

    How sensor and picture are turned to each other is not known, so no feature is kept from any.
    """
    labels = dict.fromkeys(n for c in ("fx", "fy", "fz") for n in features.explains[c])
    off = left_out(rows[:, [features.names.index(n) for n in labels]], force)
    found = Interval.rmse(off, np.arange(len(off)) // BLOCK, "block")
    r2 = 1 - np.mean(off**2) / force.var()
    return f"{found.value:.2f} [{found.low:.2f}, {found.high:.2f}] ({r2:.2f})"


def dark_spots(image: Array) -> Array:
    """Centres (n, 2) px of dark spots by scipy alone: darker than their surroundings by a fifth."""
    grey = ndimage.gaussian_filter(_grey(image), 1.0)
    label, count = ndimage.label(grey < 0.8 * ndimage.uniform_filter(grey, 61))
    every = np.arange(1, count + 1)
    area = ndimage.sum_labels(label > 0, label, every)
    like = np.abs(np.log(area / np.median(area))) < np.log(2.5)
    return np.array(ndimage.center_of_mass(label > 0, label, every[like]))[:, ::-1]


def chained(frames: Sequence[Array], start: Array, reach_px: float) -> Array:
    """Places (frames, n, 2) of spots by the nearest one in the image before, nan once lost.

    frames: spots (m, 2) of each image. Dots of `start` and spots must be each other's nearest.
    """
    out = np.full((len(frames), *start.shape), np.nan)
    last = start.copy()
    for k, spots in enumerate(frames):
        apart = np.linalg.norm(last[:, None] - spots, axis=-1)
        apart[~np.isfinite(apart)] = np.inf
        near, rows = apart.argmin(axis=1), np.arange(len(last))
        mutual = (apart[:, near].argmin(axis=0) == rows) & (apart[rows, near] <= reach_px)
        last = np.where(mutual[:, None], spots[near], np.nan)
        out[k] = last
    return out


def markers(images: Sequence[Array]) -> list[str]:
    """The dots of a foreign skin: held, swapped, and whether the dense tracker claims to see."""
    tracker = DotTracker.from_image(images[0])
    seen = [tracker.update(image) for image in images]
    place = np.stack([one.position_px for one in seen])
    place = place[:, np.isfinite(place[0, :, 0])]
    spots = [dark_spots(image) for image in images]
    chains = chained(spots, place[0], 0.45 * tracker.pitch_px)
    off = np.linalg.norm(place - chains, axis=-1)[1:]
    judged, found = off[np.isfinite(off)], np.isfinite(place[1:, :, 0])
    swapped = np.count_nonzero(judged > tracker.pitch_px / 2)
    trusted, count = trusted_of(images)
    return [
        f"{len(images)} images; {place.shape[1]} dots found in the first ({len(spots[0])} spots by "
        f"scipy), {tracker.pitch_px:.1f} px apart at least, motion to "
        f"{np.nanmax(np.linalg.norm(place - place[0], axis=-1)):.1f} px. Held: {found.mean():.1%} "
        f"of the dots over the images, {found.sum(axis=1).min()} dots at least, "
        f"{found.all(axis=0).sum()} throughout. **{swapped} identities swapped** of {judged.size} "
        "judged by chains of nearest spots, which share nothing with the tracker; "
        f"{np.median(judged):.2f} px off these in the median. "
        f"{np.median([one.cpu_ms for one in seen[1:]]):.1f} CPU ms an image.",
        "",
        f"The dense tracker, with nothing to see there, trusts **{trusted} of {count}** images.",
    ]


def trusted_of(images: Iterable[Array]) -> tuple[int, int]:
    """Of the images after the first: how many the dense tracker trusts, how many there were.

    A first image that it refuses, having no texture, trusts none.
    """
    first, *others = images
    tracker = FlowTracker(full=False)
    try:
        tracker.update(first)
    except SensorError:
        return 0, len(others)
    return sum(tracker.update(one).diagnostics.trusted for one in others), len(others)


def fields(files: Files) -> list[str]:
    """Measured displacement fields through Hodge, and nHHD's parts beside."""
    measured = []
    for text in files.values():
        shift = np.loadtxt(io.BytesIO(text), delimiter=",", skiprows=1, usecols=(3, 4))
        measured.append(shift.reshape(-1, math.isqrt(len(shift)), 2))
    told = peer.ask("nHHD", "nhhd_parts.py", {"fields": np.stack(measured)}, timeout_s=120)
    out = [
        "All rms over the field's; " + (f"pynhhd {told['version']}" if told else "nHHD not run"),
        "",
        "| field | rms, px | d, r, h of it | ours less nHHD's: d, r, h | correlation: d, r, h |",
        "|---" * 5 + "|",
    ]
    for i, (name, field) in enumerate(zip(files, measured, strict=True)):
        parts, size = Hodge(field), _rms(field)
        ours = [parts.d, parts.r, parts.h]
        both = [(a, told[k][i]) for a, k in zip(ours, "drh", strict=True)] if told else []
        shares = ", ".join(f"{_rms(part) / size:.2f}" for part in ours)
        apart = ", ".join(f"{_rms(a - b) / size:.3f}" for a, b in both)
        alike = ", ".join(f"{np.corrcoef(a.ravel(), b.ravel())[0, 1]:.3f}" for a, b in both)
        out.append(f"| {Path(name).stem} | {size:.2f} | {shares} | {apart} | {alike} |")
    return out


def _rms(field: Array) -> float:
    return float(np.sqrt(np.mean(field**2)))


def plain(sequences: Iterable[Iterable[Array]]) -> list[str]:
    """Gels without pattern: no image may be trusted."""
    found = [trusted_of(images) for one in sequences if (images := list(one))]
    trusted, count = np.sum(found, axis=0)
    return [f"{len(found)} sequences, {count} images after the first: **{trusted} trusted**."]


def pairs(files: Files) -> Iterator[list[Array]]:
    """Rest and press, where both are there."""
    for name, data in files.items():
        press = files.get(name.replace("ref.png", "sample.png"))
        if name.endswith("ref.png") and press is not None:
            yield [picture(data), picture(press)]


RECORDINGS = (
    Recording(
        "A soft bubble with random speckle, one press, a six-axis force sensor",
        "uiuc-iml/punyo_force_estimation", "demo/0", r"data\.json$|rgb_\d+\.npy$", bubble,
    ),
    Recording(
        "A GelSight Mini with markers, pressed",
        "gelsightinc/gsrobotics", "demos/marker_tracking/data", r"mini_example\.avi$",
        lambda files: markers(list(video(*files.values()))),
    ),
    Recording(
        "Dots of the paper's group, two pictures with marks burnt in",
        "adamzhang129/Fingervision_script_compilation", "tracking", r"image[23]\.jpg$",
        lambda files: markers([picture(data) for data in files.values()]),
    ),
    Recording(
        "Displacement fields that the paper's group measured",
        "Guanlan-gkd/finger_vision_master", "scripts/fv_lib/pynhhd/data", r"\.csv$", fields,
    ),
    Recording(
        "A gel without pattern, squeezed between fingers, every 8th image",
        "GelSight-lab/EstimateModulus", "example_data", r"\.avi$",
        lambda files: plain(islice(video(data), 0, None, 8) for data in files.values()),
    ),
    Recording(
        "Two gels without pattern, rest and a ball's press",
        "linchangyi1/9DTact", "shape_reconstruction/calibration", r"/(ref|sample)\.png$",
        lambda files: plain(pairs(files)),
    ),
)  # fmt: skip


def section_of(clone: Path) -> str:
    """Of the recording that a clone holds. Raises InputError, one line, if it holds none."""
    for recording in RECORDINGS:
        if section := recording.section(clone):
            return section
    known = ", ".join(recording.repository for recording in RECORDINGS)
    raise InputError(f"{clone}: no recording known here; needed is a clone of one of {known}")


def with_section(page: str, section: str) -> str:
    """The page with a section in its place: sections are in the order of RECORDINGS."""
    kept = {text.partition("\n")[0]: text.strip() for text in page.split("\n## ")[1:]}
    title = section.removeprefix("## ")
    kept[title.partition("\n")[0]] = title.strip()
    ordered = [kept[r.about] for r in RECORDINGS if r.about in kept]
    return "\n".join((HEAD, *(f"## {text}\n" for text in ordered)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    try:
        for folder in parser.parse_args().folders:
            page = PAGE.read_text(encoding="utf-8") if PAGE.is_file() else ""
            section = section_of(folder)
            write_whole(PAGE, with_section(page, section).encode())
            print(section, flush=True)
    except (InputError, RunFailed) as why:
        parser.exit(2, f"{why}\n")


if __name__ == "__main__":
    main()
