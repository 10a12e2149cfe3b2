"""Render the printed pattern on the deformed surface by inverse mapping.

For every image pixel the material point that projects there is found by iteration on the same
displacement field that the truth stores; where the surface hides a part of itself, the nearest
point on the pixel's ray (`occlusion`). The texture is sampled four times a pixel. Through a lens
this is done in its flat view, and what each pixel of the raw image sees is looked up there.
"""

from __future__ import annotations

import math
import zlib
from typing import ClassVar, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.bench import SimulatorConfig
from deltact_fab.common import SolverError
from deltact_fab.fabricate import PatternRecipe, pattern_albedo
from deltact_fab.physics import Exposure, print_colours, view_grid
from deltact_fab.sensor import (
    CameraModel,
    FaceMotion,
    Fisheye,
    ImageSensor,
    LatticeSampler,
    Pinhole,
    Rectified,
    SensorDimensions,
    SurfaceLattice,
    axes_mm,
    folded_pixels,
    nearest_surface,
)

from .population import NOMINAL_SENSOR, SensorDraw

# By hand: node spacing of a face at rest; band drawn around the tracked view for a calibration that
# is a little off; iterations, of which more cost time on every frame and fewer leave pixels open.
NODES_MM = 1.0
BAND_PX = 40
FIXED_POINT_ITERATIONS = 6
NEWTON_ITERATIONS = 40
MAX_NEWTON_STEP_PX = 8.0


class RawView:
    """Raw pixels (h, w) of a lens on a flat view of the face, which is BAND_PX larger all round."""

    def __init__(self, lens: Fisheye | Pinhole, view: Pinhole | Rectified) -> None:
        """lens: what is drawn through. view: what is tracked, of which the size counts."""
        self.lens = lens
        self.flat = Rectified(
            cast("Fisheye", lens),  # of which the flat view needs `crossing_mm` alone
            view.mm_per_px, view.width_px + 2 * BAND_PX, view.height_px + 2 * BAND_PX,
        )  # fmt: skip
        # With a border of one pixel, so that a halved grid is interpolated at the edge too.
        columns, rows = np.arange(-1, lens.width_px + 1), np.arange(-1, lens.height_px + 1)
        raw = np.stack(np.meshgrid(columns, rows), axis=-1).astype(float)
        looks = self.flat.rest_px(lens.rest_mm(raw))
        edge = (self.flat.width_px - 0.5, self.flat.height_px - 0.5)
        with np.errstate(invalid="ignore"):
            visible = np.all((looks > -0.5) & (looks < edge), axis=-1)
        visible = np.pad(visible[1:-1, 1:-1], 1)
        across, down = (np.flatnonzero(np.any(visible, axis=k)) for k in (0, 1))
        self._rows, self._columns = slice(down[0], down[-1] + 1), slice(across[0], across[-1] + 1)
        bordered = (slice(down[0] - 1, down[-1] + 2), slice(across[0] - 1, across[-1] + 2))
        # A pixel that looks past the flat view is dark, whatever stands here.
        near = np.clip(np.nan_to_num(looks[bordered], nan=0.0), -1, np.add(edge, 0.5))
        self._map = cv2.split(near.astype(np.float32) + 1)  # of a grid with a border
        self._visible = visible[self._rows, self._columns][..., None]
        corner_px = np.hypot(view.width_px, view.height_px) / 2
        offset = (looks[1:-1, 1:-1] - np.asarray(self.flat.centre_px)) / corner_px
        self.offset: NDArray[np.float32] = np.nan_to_num(offset, nan=np.inf)
        """Offset (h, w, 2) from the view's middle in half diagonals; inf: unseen."""

    def sample(self, flat: NDArray[np.float32]) -> NDArray[np.float32]:
        """Resample values of the flat view at the raw pixels that see it.

        flat: (h, w[, 2]) with a border of one pixel, and so is what is returned.
        """
        return np.asarray(cv2.remap(flat, self._map[0], self._map[1], cv2.INTER_LINEAR), np.float32)

    def pad_to_raw(self, radiance: NDArray[np.float32]) -> NDArray[np.float32]:
        """The raw image (h, w, c) with this in its place and the rest dark."""
        size = (self.lens.height_px, self.lens.width_px, radiance.shape[-1])
        image = np.zeros(size, np.float32)
        window = (
            slice(self._rows.start - 1, self._rows.stop - 1),
            slice(self._columns.start - 1, self._columns.stop - 1),
        )
        image[window] = radiance * self._visible
        return image


class PictureGeometry:
    """The point of the resting face that each pixel sees, of any pattern that is printed on it.

    It is what drawing costs most, and many patterns of one deformed face can share it.
    """

    MARGIN_PX: ClassVar = 64
    """Width of the face around the view that is searched for the point a pixel sees."""
    TOLERANCE_PX: ClassVar = 2e-3
    """Convergence tolerance of the point that a pixel sees."""

    def __init__(self, camera: CameraModel | RawView, lattice: SurfaceLattice) -> None:
        """camera: flat, or the raw view of a lens."""
        self.raw = camera if isinstance(camera, RawView) else None
        self.camera = camera = camera.flat if isinstance(camera, RawView) else camera
        self._motion: FaceMotion | None = None
        if self.raw is not None:
            self._motion = FaceMotion(lattice, camera.project_px)
        # The view and its margin may reach over the edge of the face.
        xs_mm, ys_mm = (
            points[(points >= nodes[0]) & (points <= nodes[-1])]
            for points, nodes in zip(
                axes_mm(camera, self.MARGIN_PX), lattice.axes_mm(), strict=True
            )
        )
        self._sampler = LatticeSampler.make(lattice, xs_mm, ys_mm)
        if self._motion is not None:
            self._motion_sampler = LatticeSampler.make(self._motion.lattice, xs_mm, ys_mm)
        self._rest = np.stack((*np.meshgrid(xs_mm, ys_mm), np.zeros((len(ys_mm), len(xs_mm)))), -1)
        self._rest_px = camera.rest_px(self._rest[..., :2])
        self._margin_px = np.asarray(-np.rint(self._rest_px[0, 0]), np.float32)
        # One pixel of border, so that the halved grid of a picture is interpolated at the edge too.
        self._target = np.stack(
            np.meshgrid(
                np.arange(-1, camera.width_px + 1, dtype=np.float32),
                np.arange(-1, camera.height_px + 1, dtype=np.float32),
            ),
            axis=-1,
        )

    @classmethod
    def resting(cls, sensor: SensorDimensions) -> PictureGeometry:
        """The geometry of the design's own pinhole, of a face that nothing touches."""
        camera = Pinhole.from_sensor(sensor)
        margin_mm = cls.MARGIN_PX * camera.mm_per_px
        nx, ny = (
            2 * math.ceil((side / 2 + margin_mm) / NODES_MM) + 1 for side in sensor.optics.view_mm
        )
        x_mm, y_mm = (-(n - 1) / 2 * NODES_MM for n in (nx, ny))
        return cls(camera, SurfaceLattice(x_mm, y_mm, NODES_MM, nx, ny))

    @property
    def size_px(self) -> tuple[int, int]:
        camera = self.camera if self.raw is None else self.raw.lens
        return camera.width_px, camera.height_px

    def forward_px(self, displacement_mm: NDArray[np.float64]) -> NDArray[np.float32]:
        """Projected displacement of the rest pixels and their margin, (h + 2m, w + 2m, 2)."""
        return self._forward(displacement_mm)[0]

    def _forward(
        self, displacement_mm: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Projected displacement of the grid's points, and where in the image they are, px."""
        if self._motion is not None:
            motion_px = self._motion_sampler(self._motion(displacement_mm))
            return np.asarray(motion_px, np.float32), self._rest_px + motion_px
        seen_px = self.camera.project_px(self._rest + self._sampler(displacement_mm))
        return np.asarray(seen_px - self._rest_px, np.float32), seen_px

    def material_px(self, displacement_mm: NDArray[np.float64] | None) -> NDArray[np.float32]:
        """Rest position (px) of the material point seen by each pixel, with a border of one pixel.

        Solves X + g(X) = p for X with g the projection of a displacement (ny, nx, 3) on the
        lattice, None at rest; shape (h + 2, w + 2, 2). Raises SolverError where a pixel sees no
        point of the surface.
        """
        if displacement_mm is None:
            return self._target
        field, seen_px = self._forward(displacement_mm)
        rest_px = previous = self._target
        for _ in range(FIXED_POINT_ITERATIONS):
            x, y = cv2.split(rest_px + self._margin_px)
            motion_px = cv2.remap(field, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            previous, rest_px = rest_px, self._target - motion_px
        # The border's first pixel has the index 0, and lies at -1.
        at_px = seen_px + 1
        disputed = folded_pixels(at_px, rest_px.shape[:2])
        x, y = cv2.split(cv2.absdiff(rest_px, previous))
        open_ = (cv2.max(x, y) >= self.TOLERANCE_PX) & ~disputed
        # Fixed point needs a gradient below 1; the stretched skin behind a sliding tip has more.
        rest_px[open_] = _newton(field, self._margin_px, self._target[open_], rest_px[open_])
        unresolved = np.isnan(rest_px[..., 0]) | disputed
        if unresolved.any():
            out_mm = self._sampler(displacement_mm[..., 2:])[..., 0]
            rest_px[unresolved] = nearest_surface(at_px, out_mm, unresolved) - self._margin_px
            blind = int(np.isnan(rest_px[..., 0]).sum())
            if blind:
                raise SolverError(
                    f"{blind} pixels of the picture see no point of the surface within "
                    f"{self.MARGIN_PX} px of the view"
                )
        return rest_px

    def depth_mm(
        self, displacement_mm: NDArray[np.float64], at_px: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Depth (h, w) below rest of the points that pixels see; at_px: from `material_px`."""
        x, y = cv2.split(at_px + self._margin_px)
        out_mm = self._sampler(displacement_mm[..., 2:])[..., 0].astype(np.float32)
        height_mm = cv2.remap(out_mm, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        depth = -np.asarray(height_mm, np.float32)
        if self.raw is None:
            return depth[1:-1, 1:-1]
        return self.raw.pad_to_raw(self.raw.sample(depth)[1:-1, 1:-1, None])[..., 0]


class FrameRenderer:
    """Draws frames of one pattern through one camera; cheap where the geometry is shared."""

    def __init__(
        self,
        geometry: PictureGeometry,
        print_: NDArray[np.float32],
        mm_per_texel: float,
        sensor: ImageSensor,
        draw: SensorDraw = NOMINAL_SENSOR,
    ) -> None:
        """print_: reflectance of the sticker, (h, w, 3) linear RGB, in its middle the face's."""
        self.geometry, self._draw = geometry, draw
        self._print, self._mm_per_texel = print_, mm_per_texel
        self._glows = sensor.contact_glow_per_mm > 0
        camera, raw = geometry.camera, geometry.raw
        if raw is None:
            grid, self._border = view_grid(camera.height_px, camera.width_px), cv2.BORDER_REPLICATE
        else:
            grid, self._border = raw.offset, cv2.BORDER_CONSTANT  # beyond the print it is dark
        self._exposure = Exposure(sensor, grid)
        self.set_light(1.0)
        if sensor.auto_exposure_grey:
            self._exposure.meter(self._radiance(geometry.material_px(None)))

    @classmethod
    def printed(
        cls,
        geometry: PictureGeometry,
        simulator: SimulatorConfig,
        recipe: PatternRecipe,
        seed: int,
        draw: SensorDraw = NOMINAL_SENSOR,
    ) -> FrameRenderer:
        """Renderer of a pattern as the rig's printer made it, before the rig's camera.

        Where a sticker is smaller than the view the camera sees bare film beside it.
        """
        printer, camera = draw.printer(simulator.printer), geometry.camera
        view_mm = max(camera.width_px, camera.height_px) * camera.mm_per_px
        turn, (dx, dy) = math.radians(draw.sticker_deg), draw.sticker_mm
        view_mm += abs(turn) * view_mm + 2 * max(abs(dx), abs(dy))
        side_px = math.ceil(max(recipe.printed_mm, view_mm) / printer.mm_per_dot - 1e-9)
        albedo = pattern_albedo(recipe, printer.mm_per_dot, (side_px, side_px))
        rng = np.random.default_rng(np.random.SeedSequence([seed, 3]))
        print_ = print_colours(printer, albedo, rng)
        return cls(geometry, print_, printer.mm_per_dot, simulator.camera, draw)

    @staticmethod
    def noise(seed: int, stream: str) -> np.random.Generator:
        """The camera's noise in one press, by its name, apart from all others."""
        return np.random.default_rng(np.random.SeedSequence([seed, 2, zlib.crc32(stream.encode())]))

    def set_light(self, share: float) -> None:
        """Set the light, as a share of that of this sensor when new."""
        self._exposure.brightness = share * self._draw.light

    def render(
        self, displacement_mm: NDArray[np.float64] | None, rng: np.random.Generator
    ) -> NDArray[np.uint8]:
        """Image (h, w, 3) BGR of a surface displacement (ny, nx, 3) on the lattice, None at rest.

        Raises SolverError where a pixel sees no point of the surface.
        """
        return self.expose(self.geometry.material_px(displacement_mm), rng, displacement_mm)

    def expose(
        self,
        at_px: NDArray[np.float32],
        rng: np.random.Generator,
        displacement_mm: NDArray[np.float64] | None = None,
    ) -> NDArray[np.uint8]:
        """Image (h, w, 3) BGR of what the geometry's `material_px` says that the pixels see.

        displacement_mm: as of `render`; only a camera in whose light a contact glows reads it.
        """
        radiance = self._radiance(at_px)
        depth_mm: NDArray[np.float32] | None = None
        if self._glows and displacement_mm is not None:
            depth_mm = self.geometry.depth_mm(displacement_mm, at_px)
        return self._exposure.expose(radiance, rng, depth_mm)

    def _radiance(self, at_px: NDArray[np.float32]) -> NDArray[np.float32]:
        """Linear radiance (h, w, 3 RGB) of what the pixels see."""
        material_px, camera, raw = at_px, self.geometry.camera, self.geometry.raw
        if raw is not None:
            material_px = raw.sample(material_px)
        fine = cv2.resize(material_px, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)[2:-2, 2:-2]
        cx, cy = camera.centre_px
        texels = camera.mm_per_px / self._mm_per_texel
        h, w = self._print.shape[:2]
        across = (fine[..., 0] - np.float32(cx)) * np.float32(texels)
        down = (fine[..., 1] - np.float32(cy)) * np.float32(texels)
        (dx, dy), turn = self._draw.sticker_mm, math.radians(self._draw.sticker_deg)
        if dx or dy or turn:
            across -= np.float32(dx / self._mm_per_texel)
            down -= np.float32(dy / self._mm_per_texel)
            c, s = np.float32(math.cos(turn)), np.float32(math.sin(turn))
            across, down = c * across + s * down, c * down - s * across
        map_x, map_y = across + np.float32((w - 1) / 2), down + np.float32((h - 1) / 2)
        albedo = cv2.remap(self._print, map_x, map_y, cv2.INTER_LINEAR, borderMode=self._border)
        size = (material_px.shape[1] - 2, material_px.shape[0] - 2)
        radiance = np.asarray(cv2.resize(albedo, size, interpolation=cv2.INTER_AREA), np.float32)
        return radiance if raw is None else raw.pad_to_raw(radiance)


def _newton(
    field: NDArray[np.float32],
    margin_px: NDArray[np.float32],
    target: NDArray[np.float32],
    start: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Solve X + g(X) = p for points (n, 2) px, g bilinear on the field with its margin.

    nan for those that no step brings home.
    """
    height, width = field.shape[:2]
    p, position = target.astype(float), start.astype(float)
    active = np.arange(len(position))
    for _ in range(NEWTON_ITERATIONS):
        if not len(active):
            break
        x = np.clip(position[active, 0] + margin_px[0], 0, width - 1.001)
        y = np.clip(position[active, 1] + margin_px[1], 0, height - 1.001)
        j, i = x.astype(int), y.astype(int)
        a, b = (x - j)[:, None], (y - i)[:, None]
        q00, q01 = field[i, j], field[i, j + 1]
        q10, q11 = field[i + 1, j], field[i + 1, j + 1]
        along_x = (q01 - q00) * (1 - b) + (q11 - q10) * b
        along_y = (q10 - q00) * (1 - a) + (q11 - q01) * a
        value = q00 * (1 - b) + q10 * b + along_x * a
        miss = position[active] + value - p[active]
        xx, yx = 1 + along_x[:, 0], along_x[:, 1]
        xy, yy = along_y[:, 0], 1 + along_y[:, 1]
        det = xx * yy - xy * yx
        det = np.where(np.abs(det) < 0.05, np.copysign(0.05, det), det)
        step = np.stack((yy * miss[:, 0] - xy * miss[:, 1], xx * miss[:, 1] - yx * miss[:, 0]), -1)
        position[active] -= np.clip(step / det[:, None], -MAX_NEWTON_STEP_PX, MAX_NEWTON_STEP_PX)
        active = active[np.max(np.abs(miss), axis=-1) >= PictureGeometry.TOLERANCE_PX]
    position[active] = np.nan
    return position.astype(np.float32)
