"""A design of the whole hardware, and derived lengths with their equations.

Frame: origin at the centre of the resting outer face, z out of the sensor, so the back of the
sensor is at z = -30 by default. From the face backwards:

    z = 0        face            skin          12
    -12          ledge           acrylic        2
    -14          joint           air gap        3     frame above, shell below
    -17          lens            lens          7.5
    -24.5        board_front     board          1
    -25.5        board_back      clearance      3     camera holder
    -28.5        floor           cover         1.5
    -30          back
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

from deltact_fab.common import Point2
from deltact_fab.sensor import Bounded, SensorDimensions, bounded_number

from .bench_sections import (
    AdapterDimensions,
    CouponDimensions,
    FitCouponDimensions,
    KerfCouponDimensions,
    LaserDimensions,
    MoldDimensions,
    ResinPrinterDimensions,
    StagePlateDimensions,
    TableDimensions,
    ToolDimensions,
)
from .drafting.dimensioning import TitleBlock
from .sensor_sections import (
    HEAD_PLAY_MM,
    CameraDimensions,
    CoverDimensions,
    HolderDimensions,
    LightDimensions,
    MountDimensions,
    PlateDimensions,
    ScrewDimensions,
    ShellDimensions,
)


@dataclass(frozen=True)
class EnvelopeDimensions(Bounded):
    """Largest outer size of the sensor (paper: 39 x 60 x 30)."""

    width_mm: float = bounded_number(39.0, "largest size along x", 5, 500)
    length_mm: float = bounded_number(60.0, "largest size along y", 5, 500)
    height_mm: float = bounded_number(30.0, "largest size along z", 2, 200)


@dataclass(frozen=True)
class Design(SensorDimensions):
    """The whole hardware. `skin`, `frame` and `optics` are those of SensorDimensions."""

    screw: ScrewDimensions = field(default_factory=ScrewDimensions)
    plate: PlateDimensions = field(default_factory=PlateDimensions)
    shell: ShellDimensions = field(default_factory=ShellDimensions)
    mount: MountDimensions = field(default_factory=MountDimensions)
    table: TableDimensions = field(default_factory=TableDimensions)
    tool: ToolDimensions = field(default_factory=ToolDimensions)
    adapter: AdapterDimensions = field(default_factory=AdapterDimensions)
    stage_plate: StagePlateDimensions = field(default_factory=StagePlateDimensions)
    light: LightDimensions = field(default_factory=LightDimensions)
    camera: CameraDimensions = field(default_factory=CameraDimensions)
    holder: HolderDimensions = field(default_factory=HolderDimensions)
    cover: CoverDimensions = field(default_factory=CoverDimensions)
    envelope: EnvelopeDimensions = field(default_factory=EnvelopeDimensions)
    mold: MoldDimensions = field(default_factory=MoldDimensions)
    coupon: CouponDimensions = field(default_factory=CouponDimensions)
    fit_coupon: FitCouponDimensions = field(default_factory=FitCouponDimensions)
    kerf_coupon: KerfCouponDimensions = field(default_factory=KerfCouponDimensions)
    resin_printer: ResinPrinterDimensions = field(default_factory=ResinPrinterDimensions)
    laser: LaserDimensions = field(default_factory=LaserDimensions)
    drawing: TitleBlock = field(default_factory=TitleBlock)

    @property
    def focal_px(self) -> float:
        """Focal length in px of the raw image: focal length / (pixel x binning), 388.4."""
        return 1000 * self.camera.focal_length_mm / (self.camera.pixel_um * self.camera.binning)

    @property
    def lens_terms(self) -> tuple[float, float, float, float]:
        """Projection of the camera; f tan(theta) as a series, 0.3 % off at 50 degrees."""
        if self.camera.projection == "equidistant":
            return super().lens_terms
        return 1 / 3, 2 / 15, 17 / 315, 62 / 2835

    @property
    def raw_size_px(self) -> tuple[int, int]:
        """Width and height of the raw image: the crop that the camera is set to."""
        return self.camera.crop_width_px, self.camera.crop_height_px

    # Heights, from the face backwards.

    @property
    def z_front_mm(self) -> float:
        """Front of the frame = -protrusion: -6."""
        return -self.skin.protrusion_mm

    @property
    def z_ledge_mm(self) -> float:
        """Back of the skin, front of the acrylic = -thickness: -12."""
        return -self.skin.thickness_mm

    @property
    def z_joint_mm(self) -> float:
        """Back of acrylic and frame, front of the shell = ledge - acrylic: -14."""
        return self.z_ledge_mm - self.optics.acrylic_mm

    @property
    def z_lens_mm(self) -> float:
        """Front of the lens = joint - air gap: -17."""
        return self.z_joint_mm - self.optics.air_gap_mm

    @property
    def z_board_front_mm(self) -> float:
        """Front of the camera's board, back of the light holder = lens - lens height: -24.5."""
        return self.z_lens_mm - self.camera.lens_height_mm

    @property
    def z_board_back_mm(self) -> float:
        """Back of the board, front of the camera holder = board front - board: -25.5."""
        return self.z_board_front_mm - self.camera.board_mm

    @property
    def z_floor_mm(self) -> float:
        """Front of the cover's floor, back of holder and shell = board back - clearance: -28.5."""
        return self.z_board_back_mm - self.holder.clearance_mm

    @property
    def z_back_mm(self) -> float:
        """Back of the sensor = floor - cover: -30."""
        return self.z_floor_mm - self.cover.floor_mm

    @property
    def z_head_mm(self) -> float:
        """Seat of the screw heads = joint + engagement - screw length: -28.4."""
        return self.z_joint_mm + self.screw.engagement_mm - self.screw.length_mm

    @property
    def z_boss_mm(self) -> float:
        """Front of the cover's bosses, back of the shell's posts = head seat + wall: -26.9."""
        return self.z_head_mm + self.shell.wall_mm

    @property
    def z_light_mm(self) -> float:
        """Front of the light holder = joint - axial fit: -14.9."""
        return self.z_joint_mm - self.light.axial_fit_mm

    # Plan.

    @property
    def post_mm(self) -> float:
        """Side of the square corner posts = head bore + 2 walls: 3.55 + 3 = 6.55."""
        return self.screw.row.bore_mm + 2 * self.shell.wall_mm

    @property
    def screw_at_mm(self) -> Point2:
        """Axis of the screw at +x, +y = (outer - post) / 2: (16.225, 16.725)."""
        x, y = self.frame_outer_mm
        return (x - self.post_mm) / 2, (y - self.post_mm) / 2

    @property
    def screw_centres_mm(self) -> list[Point2]:
        """The four axes of the screws, row by row."""
        x, y = self.screw_at_mm
        return [(sx * x, sy * y) for sy in (-1, 1) for sx in (-1, 1)]

    @property
    def post_edge_mm(self) -> Point2:
        """Inner edges of the post at +x, +y = outer / 2 - post: (12.95, 13.45)."""
        x, y = self.frame_outer_mm
        return x / 2 - self.post_mm, y / 2 - self.post_mm

    @property
    def post_in_window_mm(self) -> Point2:
        """Sides by which a post reaches into the frame's window = post - wall: (5.05, 3.55).

        (0, 0) when the walls hold the posts.
        """
        x = self.post_mm - self.frame.wall_x_mm
        y = self.post_mm - self.frame.wall_y_mm
        return (x, y) if min(x, y) > 0 else (0.0, 0.0)

    @property
    def cavity_half_mm(self) -> Point2:
        """Half sides of the shell's cavity = outer / 2 - wall: (18, 18.5)."""
        x, y = self.frame_outer_mm
        return x / 2 - self.shell.wall_mm, y / 2 - self.shell.wall_mm

    @property
    def seat_half_mm(self) -> Point2:
        """Half sides of the frame's pocket for the acrylic = half the skin + seat: (18, 18.5)."""
        skin, frame = self.skin, self.frame
        return skin.width_mm / 2 + frame.seat_x_mm, skin.length_mm / 2 + frame.seat_y_mm

    @property
    def acrylic_half_mm(self) -> Point2:
        """Half sides of the acrylic plate = pocket - plate.fit: (17.9, 18.4)."""
        x, y = self.seat_half_mm
        return x - self.plate.fit_mm, y - self.plate.fit_mm

    @property
    def acrylic_notch_mm(self) -> Point2:
        """Sides of the acrylic's corner notches, so that it clears the posts: (5.05, 5.05).

        Plate half side - (post edge - plate.fit); 0 where the walls hold the posts.
        """
        (x, y), (px, py) = self.acrylic_half_mm, self.post_edge_mm
        nx, ny = x - px + self.plate.fit_mm, y - py + self.plate.fit_mm
        return (nx, ny) if min(nx, ny) > 0 else (0.0, 0.0)

    @property
    def ledge_half_mm(self) -> Point2:
        """Half opening between the shell's ledges = the acrylic's pocket - ledge: (15.7, 15.7).

        The cavity's where it is narrower than the pocket, or without a ledge.
        """
        (x, y), (px, py), shell = self.cavity_half_mm, self.seat_half_mm, self.shell
        of_x = min(x, px) - shell.ledge_x_mm if shell.ledge_x_mm > 0 else x
        return of_x, min(y, py) - shell.ledge_mm

    @property
    def ledge_reach_mm(self) -> Point2:
        """Projection of the ledges from the shell's walls = half cavity - half opening."""
        (x, y), (ox, oy) = self.cavity_half_mm, self.ledge_half_mm
        return x - ox, y - oy

    @property
    def boss_room_mm(self) -> float:
        """Side of the shell's corner recesses for the cover's bosses = post + fit: 6.75."""
        return self.post_mm + self.cover.fit_mm

    @property
    def shell_depth_mm(self) -> float:
        """Height of the shell = joint - floor: 14.5."""
        return self.z_joint_mm - self.z_floor_mm

    @property
    def flange_arm_z_mm(self) -> Point2:
        """Back and front of the arm of a flanged mount, in the flange's middle: (-21.5, -15.5)."""
        middle = self.z_back_mm + self.mount.flange_height_mm / 2
        return middle - self.mount.arm_mm / 2, middle + self.mount.arm_mm / 2

    @property
    def flange_top_mm(self) -> float:
        """Front of a flange with a pattern of holes = back + mount.height."""
        return self.z_back_mm + self.mount.height_mm

    @property
    def flange_middle_mm(self) -> float:
        """y of a pattern's middle: its washers keep HEAD_PLAY_MM from the shell's wall."""
        near_mm = HEAD_PLAY_MM + self.mount.thread.washer_mm / 2
        return self.frame_outer_mm[1] / 2 + near_mm + self.mount.pattern.half_mm[1]

    # Light holder.

    @property
    def light_radius_mm(self) -> float:
        """Outer radius of the light holder = least half opening of the ledges - fit: 15.5."""
        return min(self.ledge_half_mm) - self.light.fit_mm

    @property
    def strip_radius_mm(self) -> float:
        """Radius of the LED strip's back = outer radius - wall: 14.0."""
        return self.light_radius_mm - self.light.wall_mm

    @property
    def light_bore_mm(self) -> float:
        """Inner radius of the light holder = strip radius - channel - diffuser: 10.1."""
        return self.strip_radius_mm - self.light.channel_mm - self.light.diffuser_mm

    @property
    def cut_step_mm(self) -> float:
        """Between the middles of two cuts of the LED strip = 2 pi strip radius / cuts: 44.0."""
        return 2 * math.pi * self.strip_radius_mm / self.light.cuts

    @property
    def channel_inner_mm(self) -> float:
        """Inner radius of the strip's channel = strip radius - channel: 11.6."""
        return self.strip_radius_mm - self.light.channel_mm

    @property
    def head_relief_mm(self) -> float:
        """Radius of the light holder's reliefs = camera screw's head / 2 + clearance: 2.2."""
        return self.holder.row.head_mm / 2 + self.holder.head_clearance_mm

    # Camera holder and pegs.

    @property
    def camera_screw_centres_mm(self) -> list[Point2]:
        """The axes of the camera's screws, in the board's upper holes, if any: (+-10.5, 12.33)."""
        if not self.holder.row.thread_mm:
            return []
        x, y = self.camera.hole_pitch_x_mm / 2, self.camera.hole_rows_mm[0]
        return [(-x, y), (x, y)]

    @property
    def peg_centres_mm(self) -> list[Point2]:
        """The four axes of the pegs, row by row."""
        x, y = self.peg_at_mm
        return [(sx * x, sy * y) for sy in (-1, 1) for sx in (-1, 1)]

    @property
    def holder_half_x_mm(self) -> float:
        """Half width of the camera holder = half cavity - fit: 17.8."""
        return self.cavity_half_mm[0] - self.holder.fit_mm

    @property
    def peg_at_mm(self) -> Point2:
        """Axis of the peg at +x, +y; x = holder's edge - wall - hole / 2: (14.7, 8)."""
        x = self.holder_half_x_mm - self.holder.wall_mm - self.cover.hole_mm / 2
        return x, self.cover.peg_y_mm

    @property
    def peg_length_mm(self) -> float:
        """Height of a peg above the cover's floor = leg + lip: 4.1."""
        return self.peg_leg_mm + self.cover.lip_height_mm

    @property
    def peg_leg_mm(self) -> float:
        """Length of a peg's leg up to its lip = holder + play for a thick holder: 3.3."""
        return self.holder.clearance_mm + self.cover.peg_play_mm

    @property
    def peg_relief_mm(self) -> float:
        """Radius of the light holder's reliefs for the lips = lip + clearance: 1.97."""
        return self.cover.hole_mm / 2 + self.cover.lip_mm + self.light.lip_clearance_mm

    @property
    def snap_strain(self) -> float:
        """Strain at the root of a leg deflected by the lip = 3 fibre lip / length^2: 1.0 %.

        A cantilever loaded at the lip's underside.
        """
        return 3 * self.cover.fibre_mm * self.cover.lip_mm / self.peg_leg_mm**2

    @property
    def holder_window_half_mm(self) -> float:
        """Half width of the holder's window = half the connector + window fit: 11.6."""
        return self.camera.connector_width_mm / 2 + self.holder.window_fit_mm

    @property
    def holder_window_top_mm(self) -> float:
        """Upper edge of the window = upper screw holes - pilot / 2 - wall: 10.0."""
        upper = self.camera.hole_rows_mm[0]
        return upper - self.holder.row.pilot_mm / 2 - self.holder.wall_mm

    @property
    def holder_arm_mm(self) -> float:
        """Edges of the arms in y = +-(peg + hole / 2 + wall): 11.1."""
        return self.cover.peg_y_mm + self.cover.hole_mm / 2 + self.holder.wall_mm

    @property
    def holder_tongue_mm(self) -> Point2:
        """Half width and upper edge of the tongue that holds the two screws: (12.8, 14.7)."""
        margin = self.holder.row.pilot_mm / 2 + self.holder.wall_mm
        return self.camera.hole_pitch_x_mm / 2 + margin, self.camera.hole_rows_mm[0] + margin

    # The whole.

    @property
    def outer_mm(self) -> tuple[float, float, float]:
        """Size of the whole sensor = (frame, frame + mount, face to back): 39 x 60 x 30."""
        x, y = self.frame_outer_mm
        return max(x, self.mount.width_mm), y + self.mount.length_mm, -self.z_back_mm

    @property
    def mold_outer_mm(self) -> tuple[float, float, float]:
        """Size of the mold = n frames + (n + 1) webs; base + protrusion + seat: 102 x 104 x 12."""
        x, y = self.frame_outer_mm
        mold = self.mold
        return (
            mold.columns * x + (mold.columns + 1) * mold.web_mm,
            mold.rows * y + (mold.rows + 1) * mold.web_mm,
            mold.base_mm + self.skin.protrusion_mm + mold.seat_mm,
        )

    @property
    def skin_volume_mm3(self) -> float:
        """Volume of one skin = block - rounded edges - posts.

        A fillet of radius R around a w x l face takes 2 (w + l) R^2 (1 - pi/4) - 4 R^3
        (5/3 - pi/2): the second term is the common volume of two cylinders in a mitre.
        """
        skin, (x, y) = self.skin, self.post_in_window_mm
        r = skin.edge_fillet_mm
        rounded = 2 * (skin.width_mm + skin.length_mm) * r**2 * (1 - math.pi / 4)
        rounded -= 4 * r**3 * (5 / 3 - math.pi / 2)
        block = skin.width_mm * skin.length_mm * skin.thickness_mm
        return block - rounded - 4 * x * y * (skin.thickness_mm - skin.protrusion_mm)

    def unverified(self) -> list[str]:
        """Return keys (`camera.focal_length_mm`) whose values are assumed and not measured.

        The mount's keys only if its kind uses them.
        """
        keys = []
        for section in fields(self):
            record = getattr(self, section.name)
            for f in fields(record):
                if not record.is_unverified(f) or f.name in getattr(record, "measured", ()):
                    continue
                if section.name == "mount" and self.mount.kind != "franka":
                    continue
                keys.append(f"{section.name}.{f.name}")
        return keys
