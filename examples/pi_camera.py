"""A Raspberry Pi's camera for a rig file: `[camera] command`, `stamped = true`.

Needs Debian's python3-picamera2 but not deltact_fab, so run it with the system's Python:
`python3 pi_camera.py --size 1280 720 --rate 30 --exposure-us 8000 --gain 1 --red 1.6 --blue 1.9`.
Writes each image to standard output: time of its exposure (nanoseconds of the monotonic clock), its
number, a zero (<qII), then height x width x 3 bytes BGR. Exposure, gain and white balance are
fixed; the camera's actual values are printed once on standard error.
"""

from __future__ import annotations

import argparse
import struct
import sys
import time

from picamera2 import Picamera2  # type: ignore[import-not-found]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--size", type=int, nargs=2, default=(1280, 720))
    parser.add_argument("--rate", type=float, default=30.0)
    parser.add_argument("--exposure-us", type=int, required=True)
    parser.add_argument("--gain", type=float, default=1.0)
    parser.add_argument("--red", type=float, required=True, help="gain of the white balance")
    parser.add_argument("--blue", type=float, required=True)
    options = parser.parse_args()
    camera, (w, h) = Picamera2(), options.size
    period_us = round(1e6 / options.rate)
    held = {
        "AeEnable": False, "AwbEnable": False, "ExposureTime": options.exposure_us,
        "AnalogueGain": options.gain, "ColourGains": (options.red, options.blue),
        "FrameDurationLimits": (period_us, period_us), "NoiseReductionMode": 0, "Sharpness": 0.0,
    }  # fmt: skip
    # libcamera's RGB888 is stored in memory as blue, green, red.
    main_stream = {"size": (w, h), "format": "RGB888"}
    camera.configure(camera.create_video_configuration(main_stream, controls=held, buffer_count=4))
    camera.start()
    # The sensor's time stamps count from boot, including sleep.
    shift_ns = time.clock_gettime_ns(time.CLOCK_MONOTONIC) - time.clock_gettime_ns(
        time.CLOCK_BOOTTIME
    )
    before_ns, number, reported = 0, 0, False
    while True:
        request = camera.capture_request()
        try:
            metadata, image = request.get_metadata(), request.make_array("main")
        finally:
            request.release()
        first_row_ns = metadata["SensorTimestamp"]
        if before_ns:  # the camera has no counter: missing frames show in the time
            number += max(1, round((first_row_ns - before_ns) / (1000 * period_us)))
        before_ns = first_row_ns
        if not reported:
            names = ("ExposureTime", "AnalogueGain", "ColourGains")
            print({name: metadata[name] for name in names}, file=sys.stderr, flush=True)
            reported = True
        # The time stamp is the end of the first row's exposure.
        middle_ns = first_row_ns - 500 * metadata["ExposureTime"] + shift_ns
        sys.stdout.buffer.write(struct.pack("<qII", middle_ns, number, 0))
        sys.stdout.buffer.write(image[:h, :w].tobytes())
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
