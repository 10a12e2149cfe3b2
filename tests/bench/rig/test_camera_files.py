"""Addresses as cameras of a rig, calibrations, and what is said of a camera before a run."""

from __future__ import annotations

import http.server
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from jpegs import coded, lost_buffers, scene
from looked import to_the_end

from deltact_fab.bench.record.importing import import_recording
from deltact_fab.bench.rig.camera.files import open_images
from deltact_fab.bench.rig.camera.model import load_view, open_camera, take_photograph, view_notes
from deltact_fab.bench.rig.camera.stream import QUEUE_DEPTH
from deltact_fab.bench.rig.check import camera_rows
from deltact_fab.bench.rig.devices import HostDevice, list_cameras
from deltact_fab.bench.rig.interface import WallClock
from deltact_fab.bench.rig.tables import CameraConfig
from deltact_fab.common.errors import InputError
from deltact_fab.estimate.measure.lens.corners import read_image
from deltact_fab.present.live.source import file_source
from deltact_fab.sensor.optics.camera import Pinhole
from deltact_fab.sensor.optics.fisheye import Fisheye
from deltact_fab.sensor.optics.flat import FlatField, camera_toml
from deltact_fab.sensor.optics.rectified import Rectified
from deltact_fab.sensor.shapes.sensor import SensorDimensions

W, H = 64, 48


def test_invalid_camera_is_refused(tmp_path: Path) -> None:
    def refusal(**options: Any) -> str:
        with pytest.raises(InputError) as why:
            open_camera(CameraConfig(**options), tmp_path, WallClock())
        assert "\n" not in str(why.value)
        return str(why.value)

    with pytest.raises(ValueError, match=r"source: 'film\.mpg' is not a camera"):
        CameraConfig(source="film.mpg")
    assert "/dev/video63: cannot be opened" in refusal(source=63)
    assert "/dev/no-camera: cannot be opened" in refusal(source="/dev/no-camera")
    assert "no image stream" in refusal(source="http://127.0.0.1:9/video")


class Mjpeg(http.server.BaseHTTPRequestHandler):
    """A network camera as many are: JPEG after JPEG in one answer, then the cable is pulled."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        for k in range(12):
            data = coded(scene(k, W, H))
            if k == 5 and "damaged" in self.path:
                data = lost_buffers(data, b"")["half, end mark"]
            head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
            self.wfile.write(head.encode() + data + b"\r\n")

    def log_message(self, *args: Any) -> None: ...


@pytest.fixture
def network_camera() -> Iterator[str]:
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Mjpeg)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/video"
    server.shutdown()
    server.server_close()
    thread.join()


def test_network_camera_read_until_it_ends(network_camera: str, tmp_path: Path) -> None:
    camera = open_camera(CameraConfig(source=network_camera), tmp_path, WallClock())
    taken, why = to_the_end(camera)
    identity = camera.identity()
    assert "stream ended; check its address" in why
    assert taken[0].image.shape == (H, W, 3)
    assert np.all(np.diff([f.t_s for f in taken]) > 0)
    assert (identity["kind"], identity["stamped_by"]) == ("url", "arrival")
    assert len(taken) + sum(f.dropped for f in taken) >= 10


def test_damaged_image_of_network_is_lost(network_camera: str, tmp_path: Path) -> None:
    camera = open_camera(CameraConfig(source=f"{network_camera}/damaged"), tmp_path, WallClock())
    taken, why = to_the_end(camera)
    assert "stream ended" in why
    assert camera.identity()["counts"]["damaged"] == 1
    assert sum(f.dropped for f in taken) >= 1
    right = [cv2.imdecode(np.frombuffer(coded(scene(k, W, H)), np.uint8), 1) for k in range(12)]
    shown = [next(k for k in range(12) if np.array_equal(right[k], f.image)) for f in taken]
    assert 5 not in shown
    assert len(shown) >= QUEUE_DEPTH


def test_damaged_image_of_video_is_lost(tmp_path: Path) -> None:
    """Each image keeps its time, and a run counts the one that is missing."""
    file = tmp_path / "video.avi"
    code = cv2.VideoWriter.fourcc(*"MJPG")
    writer = cv2.VideoWriter(str(file), cv2.CAP_FFMPEG, code, 20, (640, 480))
    for k in range(12):
        writer.write(scene(k))
    writer.release()
    data = bytearray(file.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 3000] = bytes(3000)
    file.write_bytes(data)
    frames = list(file_source(open_images(file)).frames(True))
    assert sum(f.dropped for f in frames) == 12 - len(frames) == 1
    assert [f.t_s for f in frames] == pytest.approx(
        [f.number / 20 for f in frames if f.number is not None]
    )
    (tmp_path / "r.toml").write_text('images = "video.avi"\ndescription = "test"\n')
    summary = import_recording(tmp_path / "r.toml", tmp_path / "run", open_images, lambda _: None)
    assert summary["frames"] == 11
    assert summary["notes"][-1] == "1 damaged images are missing"


def test_damaged_file_is_one_line(tmp_path: Path) -> None:
    for name, data in lost_buffers(coded(scene(1)), coded(scene(2))).items():
        file = tmp_path / f"{name}.jpg"
        file.write_bytes(data)
        with pytest.raises(InputError, match=r"\.jpg: (damaged JPEG: .|not a readable image)"):
            read_image(file)


def test_camera_file_sets_view_size_light(tmp_path: Path) -> None:
    lens = Fisheye(width_px=W, height_px=H, cx_px=31.5, cy_px=23.5, f_px=20.0)
    share = np.full((H, W, 3), 0.5, np.float32)
    (tmp_path / "light.png").write_bytes(FlatField(share).to_png())
    (tmp_path / "lens.toml").write_text(camera_toml(lens, {"flat": {"file": "light.png"}}))
    (tmp_path / "pinhole.toml").write_text(camera_toml(Pinhole(0.1, W, H, 12.85)))
    sensor, rig = SensorDimensions(), tmp_path / "bench.toml"

    def config(**options: Any) -> CameraConfig:
        return CameraConfig(source=0, **options)

    view = load_view(config(model="lens.toml", width_px=W, height_px=H), sensor, rig)
    assert view == Rectified.from_sensor(sensor, lens)
    light = FlatField.from_camera_file(tmp_path / "lens.toml")
    assert light is not None
    assert light.share.shape == (H, W, 3)
    assert load_view(config(model="pinhole.toml"), sensor, rig) == Pinhole(0.1, W, H, 12.85)
    assert load_view(config(), sensor, rig) is None
    assert "not calibrated" in next(view_notes(None, None)).text
    with pytest.raises(InputError, match=r"1280 x 720 px, and .*lens\.toml is for .* 64 x 48 px"):
        load_view(config(model="lens.toml", width_px=1280, height_px=720), sensor, rig)
    with pytest.raises(InputError, match=r"camera\.model: .*none\.toml: no such file"):
        load_view(config(model="none.toml"), sensor, rig)


@pytest.mark.slow
def test_camera_faults_are_reported_with_remedy(tmp_path: Path) -> None:
    def lines(expression: str, **options: Any) -> dict[bool, str]:
        """A command that draws 60 images a second from a random k."""
        code = (
            "import os, sys, time\n"
            "for i in range(1000):\n"
            f"    k = os.urandom({W * H * 3})\n"
            f"    sys.stdout.buffer.write({expression})\n"
            "    sys.stdout.flush(); time.sleep(1 / 60)\n"
        )
        command = (sys.executable, "-c", code)
        config = CameraConfig(command=command, width_px=W, height_px=H, **options)
        found = list(camera_rows(config, tmp_path, seconds=0.5))
        return {
            ok: " | ".join(f"{f.value}; {f.remedy}" for f in found if (f.status == "pass") is ok)
            for ok in (True, False)
        }

    (tmp_path / "camera.toml").write_text(camera_toml(Pinhole(0.1, W, H, 12.85)))
    good = lines("k", rate_hz=20.0, model="camera.toml")
    assert good[False] == ""
    assert "images of 64 x 48 px, stamped by arrival, 0 ms after its exposure" in good[True]
    assert "camera.model: not calibrated" in lines("k")[False]
    assert "of 200; the sender is slow" in lines("k", rate_hz=200.0)[False]
    assert "over-exposed" in lines("k[:99] + b'\\xff' * (len(k) - 99)")[False]
    assert "the image is dark" in lines("k[:99] + bytes(len(k) - 99)")[False]
    assert "the same image " in lines("bytes(len(k))")[False]
    absent = list(camera_rows(CameraConfig(source=63, model="none.toml"), tmp_path, 0.5))
    assert [f.status for f in absent] == ["fail", "fail"]


def test_photographs_are_exposed_after_their_prompt(tmp_path: Path) -> None:
    code = (
        "import os, sys, time\n"
        "for k in range(2000):\n"
        f"    sys.stdout.buffer.write(bytes([k % 256]) + os.urandom({W * H * 3 - 1}))\n"
        "    sys.stdout.flush(); time.sleep(0.02)\n"
    )
    command = (sys.executable, "-c", code)
    config = CameraConfig(command=command, width_px=W, height_px=H)
    asked = []

    def ask(number: int) -> None:
        asked.append(number)
        time.sleep(0.2)

    out = tmp_path / "photos"
    files = take_photograph(config, tmp_path, out, 2, ask)
    assert asked == [1, 2]
    assert files == [out / "contact" / "1.png", out / "contact" / "2.png"]
    first, second = (cv2.imread(str(file))[0, 0, 0] for file in files)
    assert int(second) - int(first) >= 3
    with pytest.raises(InputError, match="already exists"):
        take_photograph(config, tmp_path, out, 1)


def test_cameras_are_listed_by_node(tmp_path: Path) -> None:
    """A second node of a camera gives metadata."""
    sysfs, dev = tmp_path / "sys", tmp_path / "dev"
    (dev / "v4l" / "by-id").mkdir(parents=True)
    for number, name, index in ((10, "Arducam", 0), (2, "See3CAM", 0), (3, "See3CAM", 1)):
        node = sysfs / f"video{number}"
        node.mkdir(parents=True)
        (node / "name").write_text(f"{name}\n")
        (node / "index").write_text(f"{index}\n")
    (dev / "v4l" / "by-id" / "usb-See3CAM-index0").symlink_to(dev / "video2")
    found = list_cameras(sysfs, dev)
    assert found == [
        HostDevice(str(dev / "v4l" / "by-id" / "usb-See3CAM-index0"), "See3CAM"),
        HostDevice(str(dev / "video10"), "Arducam"),
    ]
    assert list_cameras(tmp_path / "none", dev) == []
