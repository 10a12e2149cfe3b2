"""Where the paper's numbers contradict each other or say nothing, and what was chosen."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..dimensions import Design
from ..parts.screw import stock_note
from ..sensor_sections import LightDimensions
from ..standards import CAP_SCREWS
from ..stiffness import press
from . import quantities

PATTERN_MM = 35.0
PAPER_AREA_MM2 = 675.0
PAPER_MM_PER_PX = 0.037
PAPER_PX = (798, 586)
EARLIER_MM = (51, 65, 52)
PAPER_MM = (39, 60, 30)
PAPER_PLATE_MM = 2.0
PAPER_DEPTH_MM = 10.0
PAPER_OHM, PAPER_V = 750.0, 5.0
PAPER_SHEAR_MM = 10.0


@dataclass(frozen=True)
class PaperGap:
    """said: the paper. found: why that does not do. chosen: what this design does instead."""

    said: str
    found: str
    chosen: str


def gaps(design: Design) -> list[PaperGap]:
    """Every contradiction and gap, the figures of this design worked in."""
    return [*_mechanics(design), *_light_and_camera(design), *_tests(design)]


def _mechanics(d: Design) -> list[PaperGap]:
    screw, row = d.screw, d.screw.row
    longest = CAP_SCREWS["M1.6"].stock_mm[-1]
    left_mm = d.cover.floor_mm - row.head_height_mm
    left = f"leaves {left_mm:.2g} mm" if left_mm > 0 else "leaves nothing"
    beside = (d.frame.wall_y_mm - row.clearance_mm) / 2
    ax, ay = d.acrylic_half_mm
    found = press(d, d.plate.force_n)
    return [
        PaperGap(
            "Four M1.6 screws, 19 mm long.",
            f"ISO 4762 M1.6 is sold up to {longest:g} mm.",
            (stock_note(d) or f"{screw.thread} x {screw.length_mm:g} is stocked")
            + f". The seat of the heads follows from length and engagement ({screw.engagement_mm:g}"
            " mm), so that other lengths need no other parts than the cover and the shell.",
        ),
        PaperGap(
            "The cover is 1.5 mm thick, and screws pass through it.",
            f"A flush head of {row.head_height_mm:g} mm {left} of a {d.cover.floor_mm:g} mm floor "
            "to carry it.",
            f"Bosses on the cover; the heads bear {d.z_head_mm - d.z_back_mm:.3g} mm above the "
            "back of the sensor.",
        ),
        PaperGap(
            "40 mm over a skin of 34 mm, and holes for screws.",
            f"A {d.frame.wall_y_mm:g} mm wall leaves {beside:.2g} mm beside a clearance hole.",
            f"Square corner posts of {d.post_mm:g} mm; {_notched(d)}.",
        ),
        PaperGap(
            "An acrylic plate behind the skin; no drawing of how it is held.",
            "A plate as large as the skin has nothing to rest on.",
            f"A pocket with a ledge of {d.frame.seat_y_mm:g} mm in y on the frame, a ledge on the "
            f"shell below it; the plate is {2 * ax:g} x {2 * ay:g} mm.",
        ),
        PaperGap(
            f"The plate is {PAPER_PLATE_MM:g} mm thick; nothing of the press that it bears.",
            f"Under {d.plate.force_n:g} N ({d.plate.depth_mm:g} mm deep) a plate of "
            f"{PAPER_PLATE_MM:g} mm on two ledges would yield by {_on_two_mm(d):.2g} mm.",
            f"{_carried(d)}: {found.deflection_mm:.2g} mm, "
            f"{100 * found.deflection_mm / d.plate.depth_mm:.2g} % of the depth, and "
            f"{found.stress_mpa:.2g} MPa; the light holder stands {d.light.axial_fit_mm:g} mm "
            f"behind it. The simulated sensor's plate is rigid.",
        ),
        PaperGap(
            "Four snap-fit cylinders, no dimension.",
            "A solid peg does not spring.",
            f"Split pegs of {d.cover.peg_mm:g} mm with a lip of {d.cover.lip_mm:g} mm: strain "
            f"{100 * d.snap_strain:.2g} % against {100 * d.cover.strain_limit:g} % of the resin.",
        ),
        PaperGap(
            "The mount fits the gripper of a Panda arm; no hole pattern.",
            "No drawing of the finger's flange was found; a public adapter for the Panda hand has "
            "two holes of 4.3 mm, 12 mm apart, counterbored 8 mm.",
            "The mount of kind franka has these as dimensions, marked unverified: measure your "
            "gripper before printing.",
        ),
        PaperGap(
            "The size is reduced by one third against the earlier sensor.",
            f"{_product(PAPER_MM):.0f} mm³ against {_product(EARLIER_MM):.0f} mm³ is "
            f"{100 * (_product(PAPER_MM) / _product(EARLIER_MM) - 1):.0f} % of volume.",
            "The dimensions are what is built: {:g} x {:g} x {:g} mm.".format(*d.outer_mm),
        ),
    ]


def _carried(d: Design) -> str:
    edges = "four" if d.shell.ledge_x_mm > 0 else "two"
    return f"{d.optics.acrylic_mm:g} mm on {edges} ledges of the shell"


def _on_two_mm(d: Design) -> float:
    """Deflection of the paper's plate with its x edges free."""
    shell = replace(d.shell, ledge_x_mm=0.0)
    optics = replace(d.optics, acrylic_mm=PAPER_PLATE_MM)
    return press(replace(d, shell=shell, optics=optics), d.plate.force_n).deflection_mm


def _notched(d: Design) -> str:
    """What makes room for the posts."""
    parts = {"skin": d.post_in_window_mm, "acrylic": d.acrylic_notch_mm}
    names = [name for name, notch in parts.items() if any(notch)]
    if not names:
        return "the walls of the frame hold them"
    return f"{' and '.join(names)} {'are' if len(names) > 1 else 'is'} notched around them"


def _light_and_camera(d: Design) -> list[PaperGap]:
    light = d.light
    room_mm = d.z_joint_mm - d.z_board_front_mm
    strip_room = f"{room_mm - 10:.2g} mm" if room_mm > 10 else "nothing"
    paper = quantities.wirings(LightDimensions(resistor_ohm=PAPER_OHM, supply_v=PAPER_V))[0]
    taken = f"{light.resistor_ohm:g} ohm: {quantities.wirings(light)[0].total_ma:.2g} mA in all."
    sold = quantities.resistor_for_ohm(20.0, light)[1]
    taken += f" {sold:g} ohm gives at most 20 mA."
    lens = [key for key in d.unverified() if key.startswith("camera.")]
    checked = f"unverified ({len(lens)} keys): measure yours" if lens else "measured"
    view_x, view_y = d.optics.view_mm
    return [
        PaperGap(
            f"Five 5050 LEDs, {PAPER_OHM:g} ohm in series, {PAPER_V:g} V.",
            f"That is {paper.total_ma:.2g} mA in all; a 12 V strip stays dark.",
            f"{light.supply_v:g} V strip in one-LED cuts, {taken}",
        ),
        PaperGap(
            "A light strip is inserted into the holder.",
            f"A 10 mm strip leaves {strip_room} of floor in a holder {room_mm:g} mm high.",
            f"A strip of {light.strip_width_mm:g} mm above a floor of {light.floor_mm:g} mm.",
        ),
        PaperGap(
            "Five LEDs of a common strip.",
            f"{light.strip_mm:.3g} mm of strip; corner posts stand in the way of a square loop.",
            f"A ring inside the posts, {light.led_count} single LEDs joined by wire.",
        ),
        PaperGap(
            "A Waveshare IMX219 camera with a 200 degree lens.",
            "No drawing of lens diameter, height or focal length was found.",
            "Outline of a Raspberry Pi camera; lens "
            f"{d.camera.lens_diameter_mm:g} x {d.camera.lens_height_mm:g} mm and focal length "
            f"{d.camera.focal_length_mm:g} mm, {checked}.",
        ),
        PaperGap(
            "The lens sees the whole skin from behind the acrylic.",
            "Without an air gap total reflection hides the corners of the view at any angle.",
            f"{d.optics.air_gap_mm:g} mm of air between lens and acrylic.",
        ),
        PaperGap(
            f"{PAPER_AREA_MM2:g} mm² on {PAPER_PX[0]} x {PAPER_PX[1]} px, and "
            f"{PAPER_MM_PER_PX} mm/px.",
            f"{PAPER_MM_PER_PX} mm/px gives {_product(PAPER_PX) * PAPER_MM_PER_PX**2:.0f} mm²; "
            f"{PAPER_AREA_MM2:g} mm² needs {(PAPER_AREA_MM2 / _product(PAPER_PX)) ** 0.5:.4f}.",
            f"{d.optics.mm_per_px:g} mm/px: {view_x:.1f} x {view_y:.1f} mm.",
        ),
    ]


def _tests(d: Design) -> list[PaperGap]:
    skin = d.skin
    deep = 100 * PAPER_DEPTH_MM / skin.thickness_mm
    half_mm = skin.length_mm / 2 - PAPER_SHEAR_MM
    short = min(skin.width_mm, skin.length_mm)
    over = "wider than" if short < PATTERN_MM else "within"
    return [
        PaperGap(
            f"The pattern is printed {PATTERN_MM:g} x {PATTERN_MM:g} mm.",
            f"That is {over} the {short:g} mm side of the skin.",
            "The film is cut with a margin and trimmed after drying.",
        ),
        PaperGap(
            "The 2-dot indenter is named in the text.",
            "The figure shows four dots.",
            "Both are in the list of indenters.",
        ),
        PaperGap(
            f"Presses {PAPER_DEPTH_MM:g} mm deep, shear of {PAPER_SHEAR_MM:g} mm each way.",
            f"{PAPER_DEPTH_MM:g} mm is {deep:.0f} % of {skin.thickness_mm:g} mm of gel; half an "
            f"indenter and its offset must stay within {half_mm:g} mm in y.",
            "Footprints of 9 mm by default; protocol check refuses what leaves the face.",
        ),
        PaperGap(
            "The second grid of patterns lists d in {0.5, 0.75, 0.1}.",
            "The result names 0.075; 0.5 and 0.75 would be coarser than the first grid.",
            "Read as {0.05, 0.075, 0.1}.",
        ),
        PaperGap(
            "1:1, thin layers, a prime coat, a vacuum pump.",
            "No masses, thicknesses, drying times or pressure.",
            "The figures of this guide; each says whether it is assumed.",
        ),
    ]


def _product(sides: tuple[int, ...]) -> float:
    total = 1.0
    for side in sides:
        total *= side
    return total
