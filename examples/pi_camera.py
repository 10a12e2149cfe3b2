"""A Raspberry Pi's camera for a rig file: `[camera] command`, `stamped = true`.

Needs Debian's python3-picamera2 and nothing of deltact_fab, so the system's Python runs it:
`python3 pi_camera.py --size 1280 720 --rate 30 --exposure-us 8000 --gain 1 --red 1.6 --blue 1.9`.
Writes each image to standard output: when it was exposed (nanoseconds of the monotonic clock), its
number, a zero (<qII), then height x width x 3 bytes BGR. Exposure, gain and white balance are held;
what the camera makes of them is told once on standard error.
"""

from __future__ import annotations

import argparse
import struct
import sys
import time

from picamera2 import Picamera2  # type: ignore[import-not-found]


def main() -> None:
    ask = argparse.ArgumentParser()
    ask.add_argument("--size", type=int, nargs=2, default=(1280, 720))
    ask.add_argument("--rate", type=float, default=30.0)
    ask.add_argument("--exposure-us", type=int, required=True)
    ask.add_argument("--gain", type=float, default=1.0)
    ask.add_argument("--red", type=float, required=True, help="gain of the white balance")
    ask.add_argument("--blue", type=float, required=True)
    asked = ask.parse_args()
    camera, (w, h) = Picamera2(), asked.size
    period_us = round(1e6 / asked.rate)
    held = {
        "AeEnable": False, "AwbEnable": False, "ExposureTime": asked.exposure_us,
        "AnalogueGain": asked.gain, "ColourGains": (asked.red, asked.blue),
        "FrameDurationLimits": (period_us, period_us), "NoiseReductionMode": 0, "Sharpness": 0.0,
    }  # fmt: skip
    # libcamera's RGB888 lies in memory as blue, green, red.
    main_stream = {"size": (w, h), "format": "RGB888"}
    camera.configure(camera.create_video_configuration(main_stream, controls=held, buffer_count=4))
    camera.start()
    # The sensor's stamps count from the start of the computer, sleep included.
    shift_ns = time.clock_gettime_ns(time.CLOCK_MONOTONIC) - time.clock_gettime_ns(
        time.CLOCK_BOOTTIME
    )
    before_ns, number, told = 0, 0, False
    while True:
        request = camera.capture_request()
        try:
            about, image = request.get_metadata(), request.make_array("main")
        finally:
            request.release()
        first_row_ns = about["SensorTimestamp"]
        if before_ns:  # the camera does not count: what is missing shows in the time
            number += max(1, round((first_row_ns - before_ns) / (1000 * period_us)))
        before_ns = first_row_ns
        if not told:
            names = ("ExposureTime", "AnalogueGain", "ColourGains")
            print({name: about[name] for name in names}, file=sys.stderr, flush=True)
            told = True
        # The stamp is of the moment at which the first row's exposure ends.
        middle_ns = first_row_ns - 500 * about["ExposureTime"] + shift_ns
        sys.stdout.buffer.write(struct.pack("<qII", middle_ns, number, 0))
        sys.stdout.buffer.write(image[:h, :w].tobytes())
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
