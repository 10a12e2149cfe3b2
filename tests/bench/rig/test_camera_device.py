"""A V4L2 device by the kernel's calls, answered by a driver in user space.

No camera is at hand, nor a kernel that has one. The driver is built against the kernel's header and
preloaded under a process that opens it.
"""

from __future__ import annotations

import itertools
import json
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from jpegs import coded, kept_buffers, lost_buffers, scene

pytestmark = pytest.mark.skipif(
    platform.system() != "Linux" or shutil.which("gcc") is None,
    reason="needs Linux and gcc for the driver",
)
# Opens the camera, takes so many images, and tells as JSON what it saw.
LOOK = """
import json, os, sys, time
from pathlib import Path
from deltact_fab.common.errors import DeltactFabError
from deltact_fab.bench.rig.tables import CameraConfig
from deltact_fab.bench.rig.camera.model import open_camera
from deltact_fab.bench.rig.check import camera_rows
from deltact_fab.bench.rig.interface import WallClock

def look(n, options):
    told, frames = {}, []
    try:
        camera = open_camera(CameraConfig(source=77, **options), Path(), WallClock())
        try:
            camera.begin("press")
            for _ in range(n):
                f = camera.capture()
                frames.append([f.number, f.dropped, f.repeated, time.monotonic() - f.t_s,
                               f.image.shape, int(f.image.min()), int(f.image.max())])
        finally:
            camera.close()
            told["identity"] = camera.identity()
    except DeltactFabError as why:
        told["error"] = [type(why).__name__, str(why)]
    return {**told, "frames": frames}

told = []
for case in json.loads(sys.argv[1]):
    driven = {k: str(v) for k, v in case.items() if k.startswith("V4L2")}
    os.environ.update(driven)
    n, probes = case.get("n", 12), case.get("probes")
    options = {k: v for k, v in case.items() if k not in (*driven, "n", "probes")}
    told.append([(c.name, c.status, "; ".join(filter(None, (c.value, c.remedy)))) for c in
                 camera_rows(CameraConfig(source=77, **options), Path(), 0.3)] if probes else
                look(n, options))
    for name in driven:
        del os.environ[name]
print(json.dumps(told))
"""


@pytest.fixture(scope="module")
def driver(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library to preload."""
    library = tmp_path_factory.mktemp("driver") / "v4l2.so"
    source = Path(__file__).with_name("v4l2_driver.c")
    flags = ["-O2", "-shared", "-fPIC", "-o", str(library), str(source), "-ldl", "-lpthread"]
    subprocess.run(["gcc", *flags], check=True)
    return library


@pytest.fixture
def look(driver: Path) -> Any:
    def looked(*cases: dict[str, Any]) -> list[dict[str, Any]]:
        """Settings of the driver are in capitals, of the rig file in small letters; n images."""
        done = subprocess.run(
            [sys.executable, "-c", LOOK, json.dumps(cases)],
            env={**os.environ, "LD_PRELOAD": str(driver)},
            capture_output=True, text=True, timeout=60, check=True,
        )  # fmt: skip
        assert done.stderr == ""
        told: list[dict[str, Any]] = json.loads(done.stdout)
        return told

    return looked


@pytest.mark.slow
def test_device_images_have_driver_numbers(look: Any) -> None:
    (seen,) = look({"V4L2_SKIP": 8, "V4L2_BAD": 11})
    numbers = [frame[0] for frame in seen["frames"]]
    assert not {8, 11} & set(numbers)
    # A busy machine loses more of them, and all the same each is counted.
    gaps = [b - a - 1 for a, b in itertools.pairwise(numbers)]
    assert [f[1] for f in seen["frames"]][1:] == gaps
    assert all(f[2] == 0 and f[4] == [480, 640, 3] for f in seen["frames"])
    assert all(-1e-3 < f[3] < 5 for f in seen["frames"])  # ages
    identity = seen["identity"]
    assert identity["stamped_by"] == "driver"
    assert identity["losses_by"] == "numbers"
    assert identity["rate_hz"] == 50
    assert identity["controls"]["white_balance_k"] == 4600


def test_locked_settings_are_read_back(look: Any) -> None:
    size = {"width_px": 1280, "height_px": 720, "rate_hz": 50.0, "fourcc": "BGR3"}
    (seen,) = look({"n": 3, "exposure": 100, "gain": 30, "white_balance_k": 5000, **size})
    assert seen["frames"][0][4] == [720, 1280, 3]
    assert seen["identity"]["controls"] == {
        "fourcc": "BGR3", "rate_hz": 50.0, "auto_exposure": 1, "exposure": 100, "auto_gain": 0,
        "gain": 30, "auto_white_balance": 0, "white_balance_k": 5000, "autofocus": None,
    }  # fmt: skip


REFUSED: list[tuple[dict[str, Any], str]] = [
        ({"gain": 30, "V4L2_STEP": 7}, "camera.gain: requested 30, the camera uses 28; range 0 to "
         "100 in steps of 7"),
        ({"exposure": 9000}, "camera.exposure: requested 9000, the camera uses 5000; range 1 to "
         "5000"),
        ({"exposure": 156, "V4L2_KEEP": 1}, "camera.exposure: automatic control stays on"),
        ({"gain": 3, "autofocus": False, "V4L2_BARE": 1}, "camera.gain: requested 3, the camera "
         "has no such control; camera.autofocus: requested 0, the camera has no such control"),
        ({"width_px": 320, "height_px": 240}, "camera.width_px: requested 320 x "
         "240, the camera uses 640 x 480 px"),
        ({"rate_hz": 60.0}, "camera.rate_hz: requested 60, the camera uses 50 at this size"),
        ({"V4L2_CODE": "RG10"}, "camera.fourcc: requested any of BGR3, RGB3, YUYV, UYVY, GREY, "
         "MJPG, JPEG, the camera uses RG10"),
]  # fmt: skip


def test_setting_not_accepted_is_refused(look: Any) -> None:
    for (_, says), seen in zip(REFUSED, look(*(case for case, _ in REFUSED)), strict=True):
        kind, text = seen["error"]
        assert kind == "InputError"
        assert text.startswith(says)
        assert "\n" not in text


FAILS = [
    ({"V4L2_STALL": 5}, 5, "stalled: no image within 0.5 s; check its cable and power"),
    ({"V4L2_SAME": 5}, 6, "the same image "),
    ({"V4L2_GONE": 5}, 5, "disconnected: No such device; check its cable"),
    ({"V4L2_SHORT": 5}, 5, "stalled"),  # nothing that can be decoded
]


@pytest.mark.slow
def test_device_failure_is_reported(look: Any) -> None:
    """Up to n images come before; those that wait when it is unplugged are gone with it."""
    seen = look(*({"n": 200, **case} for case, _, _ in FAILS))
    for (_, n, says), one in zip(FAILS, seen, strict=True):
        kind, text = one["error"]
        assert kind == "SensorError"
        assert text.startswith("camera /dev/video77: ")
        assert says in text
        assert len(one["frames"]) <= n


@pytest.mark.slow
def test_stamps_of_other_clock_are_ignored(look: Any) -> None:
    (seen,) = look({"V4L2_CLOCK": 1})
    assert seen["identity"]["stamped_by"] == "arrival"
    assert all(0 <= f[3] < 5 for f in seen["frames"])


@pytest.mark.slow
def test_padded_lines_and_jpeg_are_decoded(look: Any, tmp_path: Path) -> None:
    """Each image is of one grey, by its number; what follows a line is bright."""
    file = tmp_path / "image.jpg"
    cv2.imwrite(str(file), np.full((480, 640, 3), 100, np.uint8))
    lines, jpeg = look({"V4L2_CODE": "YUYV"}, {"n": 1, "V4L2_CODE": "MJPG", "V4L2_FILE": str(file)})
    for number, *_, low, high in lines["frames"]:
        assert low == high == pytest.approx(255 / 219 * (number % 200), abs=1)
    assert lines["identity"]["controls"]["fourcc"] == "YUYV"
    assert [abs(grey - 100) <= 1 for grey in jpeg["frames"][0][-2:]] == [True, True]


@pytest.mark.slow
def test_damaged_buffer_is_a_lost_image(look: Any, tmp_path: Path) -> None:
    """Of 16 images in turn, all different, one buffer is damaged or unusual."""
    images = [coded(scene(k)) for k in range(16)]
    lost = {**lost_buffers(images[9], images[10]), "another size": coded(scene(9, 320, 240))}
    kept = kept_buffers(images[9])
    del kept["filler before it"], kept["no end mark, zeros"]  # OpenCV prints a warning of them
    cases = []
    for i, buffer in enumerate([*lost.values(), *kept.values()]):
        folder = tmp_path / str(i)
        folder.mkdir()
        for k, image in enumerate(images):
            (folder / f"{k}.jpg").write_bytes(buffer if k == 9 else image)
        file = str(folder / "%ld.jpg")
        cases.append({"n": 12, "V4L2_CODE": "MJPG", "V4L2_WAIT": 1, "V4L2_FILE": file})
    for name, seen in zip([*lost, *kept], look(*cases), strict=True):
        numbers = [frame[0] for frame in seen["frames"]]
        gaps = [b - a - 1 for a, b in itertools.pairwise(numbers)]
        counts = seen["identity"]["counts"]
        assert len(numbers) == 12, name
        assert [frame[1] for frame in seen["frames"]][1:] == gaps, name
        assert counts["dropped"] >= counts["damaged"] == (name in lost), name
        assert (9 in numbers) == (name in kept), name
        assert all(frame[4] == [480, 640, 3] for frame in seen["frames"]), name


@pytest.mark.slow
def test_steadily_damaged_device_is_refused(look: Any, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.jpg"
    damaged.write_bytes(lost_buffers(coded(scene(1)), b"")["half, end mark"])
    (seen,) = look({"V4L2_CODE": "MJPG", "V4L2_FILE": str(damaged)})
    kind, text = seen["error"]
    assert kind == "SensorError"
    assert "images in a row lost: damaged JPEG: data break off after block " in text


@pytest.mark.slow
def test_unlocked_setting_is_reported_with_value(look: Any) -> None:
    (seen,) = look({"probes": True, "gain": 5})
    passed = [text for _, verdict, text in seen if verdict == "pass"]
    failed = [text for _, verdict, text in seen if verdict != "pass"]
    assert "gain locked at 5" in passed
    assert failed[0].startswith("camera.model: not calibrated")
    assert failed[-2:] == [  # a busy machine may be slow besides
        "camera.exposure: not locked; `exposure = 156` keeps the present value",
        "camera.white_balance_k: not locked; `white_balance_k = 4600` keeps the present value",
    ]
