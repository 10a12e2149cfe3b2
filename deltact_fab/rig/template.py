"""The text of a rig file for a real bench: every table and key, with what it means.

What was found stands in it; what was not stands as a comment with an example. The shipped
`grbl-bench` is this text for no device but a controller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

EXAMPLE_PORT = "/dev/ttyACM0"


@dataclass(frozen=True)
class FoundDevice:
    """Something that was found. name: as a rig file has it; text: what it says it is."""

    name: str
    text: str = ""


def rig_file(ports: Sequence[FoundDevice] = (), cameras: Sequence[FoundDevice] = ()) -> str:
    """The file; the first of each kind is taken, the others stand beside it in comments."""
    port, *others = ports or [FoundDevice(EXAMPLE_PORT, "an example: none was found")]
    more = "".join(f"\n#or port = {_quoted(d.name)}  # {d.text}" for d in others)
    stage = _STAGE.replace("@PORT@", f"port = {_quoted(port.name)}{_said(port)}{more}")
    return _HEAD + stage + _FORCE + _GUARD + _camera(cameras) + _TOUCH


def _camera(found: Sequence[FoundDevice]) -> str:
    if not found:
        return _CAMERA.replace("@TABLE@", "#[camera]").replace("@SOURCE@", "#source = 0")
    first, *others = found
    lines = [f"source = {_quoted(first.name)}{_said(first)}"]
    lines += [f"#or source = {_quoted(d.name)}  # {d.text}" for d in others]
    return _CAMERA.replace("@TABLE@", "[camera]").replace("@SOURCE@", "\n".join(lines))


def _said(device: FoundDevice) -> str:
    return f"  # {device.text}" if device.text else ""


def _quoted(name: str) -> str:
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


_HEAD = """\
# A real bench: a GRBL 1.1 or grblHAL stage, with a force sensor, a camera and indenters.
# `deltact-fab rig new bench` writes such a file with the devices that it finds,
# `deltact-fab rig check bench.toml` says what is wrong with it, and nothing moves.
#
# A line that begins with "#" and goes on at once is a key that is not set: its value is the
# default, or an example where there is none. "#or" is another way to say the same. Paths count
# from this file. No software is an emergency stop: have a switch that cuts the motors' power.
kind = "grbl"
"""

_STAGE = """
# ---- the stage ------------------------------------------------------------------------------
# Machine coordinates are mm, 0 at the homed end of each axis and negative below it. The sensor
# frame is mm from the centre of the gel's resting face: x along its width, y along its length,
# z out of it.
[stage]
# The controller's serial device. A name under /dev/serial/by-id stays the same after replugging.
@PORT@
#baud = 115200
# What its controller speaks; "grbl" is GRBL 1.1 and grblHAL.
#firmware = "grbl"
# Where the reference tip meets the centre of the resting face, in machine coordinates. MEASURE:
# home, jog down until the tip just holds a slip of paper, read the position, less the paper.
origin_machine_mm = [-60.0, -60.0, -40.0]
# How the sensor is turned about z on the stage, and how its face is tilted about x, then about y.
#angle_deg = 0.0
#tilt_deg = [0.0, 0.0]
# `deltact-fab rig register` finds all three by touching the face and writes a file for them.
#or registration = "registration.toml"
# What the stage can do; the controller's own settings must reach at least as far, and more is
# never asked for. MEASURE: `$$` lists travel as $130..$132, feed $110..$112, acceleration
# $120..$122.
travel_mm = [120.0, 120.0, 60.0]
max_feed_mm_min = [1500.0, 1500.0, 1200.0]
acceleration_mm_s2 = [50.0, 50.0, 50.0]
# Axes that turn the other way ($3), and that home at their negative end ($23): 1 for x, 2 for y,
# 4 for z (not of homing: z homes up, away from the gel), added up.
#direction_mask = 0
#homing_direction_mask = 0
# How long homing takes, for the time that a run is said to take; not given, it is reckoned from
# travel and feeds. MEASURE with a watch: `deltact-fab rig home` says it.
#homing_s = 30.0
# What the axes push before they lose steps, N. A NEMA 17 motor with 0.2 N m left at speed, on a
# screw of 8 mm lead with 40 % efficiency: 2 pi x 0.4 x 0.2 / 0.008 = 63 N. MEASURE with a scale.
# A press is refused without it.
#max_force_n = [60.0, 60.0, 60.0]
"""

_FORCE = """
# ---- the force sensor: needed for every press, the guard lives on it --------------------------
#[force]
# Its range, from the calibration sheet; a press is refused without it. ATI Nano17 SI-25-0.25: as
# here; SI-50-0.5: 50, 50, 70 N and 500 N mm.
#range_n = [25.0, 25.0, 35.0]
#range_nmm = [250.0, 250.0, 250.0]
# Where its moments count from, in the sensor frame of the gel (a sensor below the gel has z < 0).
# MEASURE with a rule; not declared, no moment of a press is predicted.
#origin_mm = [0.0, 0.0, -30.0]
#rate_hz = 1000.0
# The way to it: a Net F/T box on the network (extra `netft`),
#[force.netft]
#host = "192.168.1.1"
#rdt_port = 49152
#http_port = 80
# and the transducer's serial number, so that another one is refused.
#serial = "FT11564"
# or a scale on a serial port that writes lines of numbers.
#or [force.serial]
#or port = "/dev/ttyUSB0"
#or baud = 115200
# What each number of a line is: fx, fy, fz, tx, ty, tz, or "-" for what is left out.
#or columns = ["fz"]
#or unit = "N"
#or torque_unit = "Nmm"
# Times each number; a press must come out as Fz < 0, so a scale that shows it as positive has -1.
#or scale = 1.0
# Silence for so long is a fault; and what makes a scale write that has to be asked.
#or silent_s = 0.5
#or ask = "SIR\\r\\n"
"""

_GUARD = """
# ---- the guard: stops the stage beyond any of these -------------------------------------------
# What is not set is 80 % of the force sensor's range.
#[guard]
# On any axis, of either sign, N; or on each axis.
#force_n = 15.0
#or axes_n = [15.0, 15.0, 25.0]
# Of the whole force, N, and of any moment about the force sensor's own origin, N mm.
#resultant_n = 25.0
#torque_nmm = 200.0
"""

_CAMERA = """
# ---- the camera -------------------------------------------------------------------------------
@TABLE@
# A V4L2 device (its number or its file), an rtsp or http address, a folder of images, a video;
@SOURCE@
# or a command that writes raw BGR images, as for the camera port of a Jetson. stamped: 16 bytes
# before each image, int64 ns of the monotonic clock, uint32 number, uint32 of no meaning.
#or command = ["gst-launch-1.0", "-q", "nvarguscamerasrc", "!", "...", "!", "fdsink"]
#or stamped = false
# What a device is asked for; a command must say its size.
#width_px = 1280
#height_px = 720
#rate_hz = 30.0
# The rest is of a V4L2 device: its coding, and what it must not change by itself. MEASURE: choose
# the exposure with the light on and the gel in place; `rig check` says what the device has now.
#fourcc = "MJPG"
#exposure = 100
#gain = 0
#white_balance_k = 4600
#autofocus = false
# From the middle of the exposure to the moment of the stamp, ms.
#latency_ms = 0.0
# Of the images in the record, both lossless: "png" holds some 45 images of 1280 x 720 a second on
# two cores, "jxl" (extra `images`) some 120.
#format = "png"
# The calibration; `deltact-fab calibrate` writes it. Without it nothing can be tracked.
#model = "camera.toml"
"""

_TOUCH = """
# ---- where the face is: looked for after each change of indenter and when a run goes on --------
#[touch]
# By the force sensor, or by hand with a feeler gauge or paper.
#by = "force"
# Where on the face, mm.
#at_mm = [0.0, 0.0]
# So much force is a contact, N: at least five standard deviations of the noise that `rig check`
# finds.
#force_n = 0.1
# Of the approach, and the height above the expected face at which it begins.
#feed_mm_min = 30.0
#clear_mm = 5.0
# The face is looked for so far above and below where it is expected, and never further down.
#search_mm = 3.0
# Touches, and how far apart they may be: more is a loose tool.
#repeats = 3
#spread_mm = 0.03
# By hand: the thickness of the gauge.
#gauge_mm = 0.1
# A run that goes on may find the face so far from where it was.
#moved_mm = 0.3
# A block with upright sides around the middle of the face, as the base's own frame is, by which
# `rig register --jig` finds the face's place. Half its sides along x and y, and the height of its
# top above the resting face, mm. MEASURE with a caliper.
#[touch.jig]
#half_mm = [22.0, 21.0]
#top_mm = -3.0

# How much longer each indenter is than the tip that origin_machine_mm was measured with, mm, one
# table each. MEASURE with a caliper; a touch-off corrects it within search_mm.
#[tools."sphere:10"]
#length_mm = 0.0
"""
