"""Folders and videos as cameras of a rig, addresses, and what is said of a camera before a run."""

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
from looked import to_the_end

from deltact_fab.errors import InputError, SensorError
from deltact_fab.optics import Fisheye, FlatField, Pinhole, Rectified, as_toml
from deltact_fab.rig.camera.config import CameraConfig
from deltact_fab.rig.camera.model import flat_field, tracked_view, view_notes
from deltact_fab.rig.camera.open import open_camera
from deltact_fab.rig.camera.photograph import photograph
from deltact_fab.rig.camera.probe import probe
from deltact_fab.rig.clock import WallClock
from deltact_fab.rig.devices import FoundDevice, cameras
from deltact_fab.rig.interface import Camera
from deltact_fab.shapes import SensorDimensions
from deltact_fab.virtual.clock import VirtualClock

W, H = 64, 48


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder of eleven images, numbered so that 10.png sorts before 2.png, beside film.avi."""
    (tmp_path / "pictures").mkdir()
    writer = cv2.VideoWriter(
        str(tmp_path / "film.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25, (W, H)
    )
    for k in range(11):
        image = np.full((H, W, 3), 20 * k, np.uint8)
        cv2.imwrite(str(tmp_path / "pictures" / f"{k}.png"), image)
        writer.write(image)
    writer.release()
    return tmp_path


def seen(camera: Camera) -> list[tuple[int, float, int | None]]:
    """Grey, time and number of every image, to the end."""
    frames, why = to_the_end(camera)
    assert "has no more images after 11" in why
    assert not any(f.dropped or f.repeated for f in frames)
    return [(round(float(f.image.mean()) / 20), f.t_s, f.number) for f in frames]


@pytest.mark.parametrize(
    ("source", "options", "period_s"),
    [("pictures", {}, 1 / 30), ("film.avi", {}, 1 / 25), ("film.avi", {"rate_hz": 4.0}, 1 / 4)],
)
def test_every_image_of_a_file_comes_at_its_rate(
    source: str, options: dict[str, Any], period_s: float, folder: Path
) -> None:
    """Also beside a press that begins amid them: a file has no buffer to flush."""
    clock = VirtualClock()
    camera = open_camera(CameraConfig(source=source, **options), folder, clock)
    first = camera.capture()
    camera.begin("press")
    rest = seen(camera)
    assert [grey for grey, _, _ in rest] == list(range(1, 11))
    assert [number for _, _, number in rest] == list(range(1, 11))
    assert np.diff([first.t_s] + [t_s for _, t_s, _ in rest]) == pytest.approx(period_s)


def test_a_slow_consumer_of_a_file_misses_nothing(folder: Path) -> None:
    clock = VirtualClock()
    camera = open_camera(CameraConfig(source="film.avi"), folder, clock)
    for k in range(11):
        clock.sleep_s(1.0)
        assert camera.capture().number == k
    assert camera.identity()["counts"] == {"images": 11}
    camera.close()


def test_what_is_no_camera_is_one_line(folder: Path) -> None:
    def refusal(**options: Any) -> str:
        with pytest.raises(InputError) as why:
            open_camera(CameraConfig(**options), folder, WallClock())
        assert "\n" not in str(why.value)
        return str(why.value)

    (folder / "text.mp4").write_text("no film")
    (folder / "empty").mkdir()
    assert "film.mpg: no such file or folder" in refusal(source="film.mpg")
    assert "text.mp4: not a video" in refusal(source="text.mp4")
    assert "no image in this folder" in refusal(source="empty")
    assert "/dev/video63: no camera that can be opened" in refusal(source=63)
    assert "/dev/no-camera: no camera" in refusal(source="/dev/no-camera")
    assert "no stream of images" in refusal(source="http://127.0.0.1:9/video")


def test_images_of_another_size_are_told(folder: Path) -> None:
    cv2.imwrite(str(folder / "pictures" / "1.png"), np.zeros((H, W + 8, 3), np.uint8))
    options: dict[str, Any]
    for options, says in (
        ({"width_px": 80, "height_px": 60}, "image 0 is of 64 x 48 px; 80 x 60 px were asked for"),
        ({}, "image 1 is of 72 x 48 px; 64 x 48 px were asked for"),
    ):
        config = CameraConfig(source="pictures", **options)
        assert says in to_the_end(open_camera(config, folder, VirtualClock()))[1]


class Mjpeg(http.server.BaseHTTPRequestHandler):
    """A network camera as many are: JPEG after JPEG in one answer, then the cable is pulled."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        rng = np.random.default_rng(3)
        for _ in range(12):
            image = rng.integers(0, 256, (H, W, 3), np.uint8)
            data = bytes(cv2.imencode(".jpg", image)[1])
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


def test_a_network_camera_is_read_until_it_is_gone(network_camera: str, tmp_path: Path) -> None:
    camera = open_camera(CameraConfig(source=network_camera), tmp_path, WallClock())
    taken, why = to_the_end(camera)
    identity = camera.identity()
    assert "gives no more images; check its address" in why
    assert taken[0].image.shape == (H, W, 3)
    assert np.all(np.diff([f.t_s for f in taken]) > 0)
    assert (identity["kind"], identity["stamped_by"]) == ("url", "arrival")
    assert len(taken) + sum(f.dropped for f in taken) >= 10


def test_a_camera_file_gives_the_view_the_size_and_the_light(tmp_path: Path) -> None:
    lens = Fisheye(width_px=W, height_px=H, cx_px=31.5, cy_px=23.5, f_px=20.0)
    share = np.full((H, W, 3), 0.5, np.float32)
    (tmp_path / "light.png").write_bytes(FlatField(share).png())
    (tmp_path / "lens.toml").write_text(as_toml(lens, {"flat": {"file": "light.png"}}))
    (tmp_path / "pinhole.toml").write_text(as_toml(Pinhole(0.1, W, H, 12.85)))
    sensor, rig = SensorDimensions(), tmp_path / "bench.toml"

    def config(**options: Any) -> CameraConfig:
        return CameraConfig(source=0, **options)

    view = tracked_view(config(model="lens.toml", width_px=W, height_px=H), sensor, rig)
    assert view == Rectified.of(sensor, lens)
    light = flat_field("lens.toml", rig)
    assert light is not None
    assert light.share.shape == (H, W, 3)
    assert flat_field(None, rig) is None
    assert tracked_view(config(model="pinhole.toml"), sensor, rig) == Pinhole(0.1, W, H, 12.85)
    assert tracked_view(config(), sensor, rig) is None
    assert "not calibrated" in view_notes(None, None)[0]
    with pytest.raises(InputError, match=r"1280 x 720 px, and .*lens\.toml is of .* 64 x 48 px"):
        tracked_view(config(model="lens.toml", width_px=1280, height_px=720), sensor, rig)
    with pytest.raises(InputError, match=r"camera\.model: .*none\.toml: no such file"):
        tracked_view(config(model="none.toml"), sensor, rig)


def test_a_camera_without_a_size_is_asked_for_that_of_its_calibration(folder: Path) -> None:
    (folder / "lens.toml").write_text(as_toml(Pinhole(0.1, 80, 60, 12.85)))
    config = CameraConfig(source="pictures", model="lens.toml")
    camera = open_camera(config, folder, VirtualClock())
    with pytest.raises(SensorError, match="64 x 48 px; 80 x 60 px were asked for"):
        camera.capture()
    camera.close()


@pytest.mark.slow
def test_what_is_wrong_with_a_camera_is_said_and_how_to_put_it_right(folder: Path) -> None:
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
        found = list(probe(config, folder, seconds=0.5))
        return {
            ok: " | ".join(f.text for f in found if (f.verdict == "pass") is ok)
            for ok in (True, False)
        }

    (folder / "camera.toml").write_text(as_toml(Pinhole(0.1, W, H, 12.85)))
    good = lines("k", rate_hz=20.0, model="camera.toml")
    assert good[False] == ""
    assert "images of 64 x 48 px, stamped by arrival, 0 ms after its exposure" in good[True]
    assert "camera.model: not calibrated" in lines("k")[False]
    assert "of 200; what sends them is slow" in lines("k", rate_hz=200.0)[False]
    assert "over-exposed" in lines("k[:99] + b'\\xff' * (len(k) - 99)")[False]
    assert "the image is dark" in lines("k[:99] + bytes(len(k) - 99)")[False]
    assert "the same image over and over" in lines("bytes(len(k))")[False]
    absent = list(probe(CameraConfig(source=63, model="none.toml"), folder, 0.5))
    assert [f.verdict for f in absent] == ["FAIL", "FAIL"]


def test_photographs_are_exposed_when_they_are_asked_for(folder: Path) -> None:
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

    out = folder / "photos"
    files = photograph(config, folder, out, 2, ask)
    assert asked == [1, 2]
    assert files == [out / "contact" / "1.png", out / "contact" / "2.png"]
    first, second = (cv2.imread(str(file))[0, 0, 0] for file in files)
    assert int(second) - int(first) >= 3
    with pytest.raises(InputError, match="is there already"):
        photograph(config, folder, out, 1)


def test_cameras_are_found_by_their_nodes(tmp_path: Path) -> None:
    """A second node of a camera gives metadata."""
    sysfs, dev = tmp_path / "sys", tmp_path / "dev"
    (dev / "v4l" / "by-id").mkdir(parents=True)
    for number, name, index in ((10, "Arducam", 0), (2, "See3CAM", 0), (3, "See3CAM", 1)):
        node = sysfs / f"video{number}"
        node.mkdir(parents=True)
        (node / "name").write_text(f"{name}\n")
        (node / "index").write_text(f"{index}\n")
    (dev / "v4l" / "by-id" / "usb-See3CAM-index0").symlink_to(dev / "video2")
    found = cameras(sysfs, dev)
    assert found == [
        FoundDevice(str(dev / "v4l" / "by-id" / "usb-See3CAM-index0"), "See3CAM"),
        FoundDevice(str(dev / "video10"), "Arducam"),
    ]
    assert cameras(tmp_path / "none", dev) == []
