"""A command's images, from a real child process: every one that is missing, doubled, late or broken
off is counted or named, and the child is gone when the camera is closed."""

from __future__ import annotations

import itertools
import json
import random
import re
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from looked import to_the_end

from deltact_fab.bench.rig.camera import stream
from deltact_fab.bench.rig.camera.model import open_camera
from deltact_fab.bench.rig.interface import CameraFrame, WallClock
from deltact_fab.bench.rig.tables import CameraConfig
from deltact_fab.common.aliases import Image
from deltact_fab.common.errors import InputError, SensorError

W, H = 32, 24
# Carries out a list: send [number, what the image is drawn from], or wait, die, write rubbish.
SENDER = """
import json, os, random, struct, sys, time
plan, stamped, size = json.loads(sys.argv[1]), sys.argv[2] == "True", int(sys.argv[3])
ahead_ns = 0
out = sys.stdout.buffer
for what, *values in plan:
    if what == "send":
        number, seed = values
        at_ns = time.monotonic_ns() + ahead_ns
        stamp = struct.pack("<qII", at_ns, number, 0) if stamped else b""
        out.write(stamp + random.Random(seed).randbytes(size))
        out.flush()
    elif what == "ahead":
        ahead_ns = round(values[0] * 1e9)
    elif what == "many":
        plan += [["wait", 0.015], ["send", number + 1, number + 1], ["many"]]
    elif what == "wait":
        time.sleep(values[0])
    elif what == "write":
        out.write(bytes(values[0]))
        out.flush()
    elif what == "say":
        print(values[0], file=sys.stderr, flush=True)
    elif what == "exit":
        sys.exit(values[0])
    elif what == "abort":
        os.kill(os.getpid(), 9)
    elif what == "fork":
        if os.fork() == 0:
            time.sleep(60)
time.sleep(60)
"""

OPEN = ExitStack()


@pytest.fixture(autouse=True)
def _closed_afterwards() -> Iterator[None]:
    with OPEN:
        yield


def command(plan: list[Any], stamped: bool = True, size: int = W * H * 3) -> tuple[str, ...]:
    return (sys.executable, "-c", SENDER, json.dumps(plan), str(stamped), str(size))


def opened(plan: list[Any], stamped: bool = True, **options: Any) -> stream.StreamCamera:
    config = CameraConfig(
        command=command(plan, stamped), width_px=W, height_px=H, stamped=stamped,
        **{"rate_hz": 60.0, **options},
    )  # fmt: skip
    camera = open_camera(config, Path(), WallClock())
    assert isinstance(camera, stream.StreamCamera)
    OPEN.callback(camera.close)
    return camera


def sent(*numbers: int) -> list[Any]:
    return [["send", k, k] for k in numbers]


def told(frame: CameraFrame) -> tuple[int | None, int, int]:
    return frame.number, frame.dropped, frame.repeated


def test_images_in_order_with_loss_counts() -> None:
    plan = [*sent(0, 1, 2, 5, 6), ["send", 6, 99], ["send", 7, 99], *sent(8), ["exit", 0]]
    camera = opened(plan)
    assert [told(f) for f in to_the_end(camera)[0]] == [
        (0, 0, 0), (1, 0, 0), (2, 0, 0), (5, 2, 0), (6, 0, 0),
        (8, 0, 2),  # number 6 came twice, and 7 was that image once more
    ]  # fmt: skip
    assert camera.identity()["counts"] == {
        "images": 6, "dropped": 2, "damaged": 0, "repeated": 2, "stale": 0
    }  # fmt: skip
    assert camera.identity()["losses_by"] == "numbers"


def test_images_are_complete_and_not_shared() -> None:
    frames = to_the_end(opened([*sent(0, 1, 2), ["exit", 0]], stamped=False))[0]
    assert [frame.number for frame in frames] == [None] * 3
    for k, frame in enumerate(frames):
        drawn = np.frombuffer(random.Random(k).randbytes(W * H * 3), np.uint8)
        assert np.array_equal(frame.image, drawn.reshape(H, W, 3))


def test_32_bit_number_wraps_around() -> None:
    camera = opened([*sent(2**32 - 1, 0, 2), ["exit", 0]])
    assert [told(f) for f in to_the_end(camera)[0]] == [(2**32 - 1, 0, 0), (0, 0, 0), (2, 1, 0)]


def test_slow_consumer_gets_newest_and_losses() -> None:
    n = 5 * stream.QUEUE_DEPTH
    camera = opened([*sent(*range(n)), ["exit", 0]])
    while camera._failure is None:  # until all have come
        time.sleep(0.01)
    frames = to_the_end(camera)[0]
    first = n - stream.QUEUE_DEPTH
    assert [told(f) for f in frames] == [
        (first, first, 0), *[(k, 0, 0) for k in range(first + 1, n)]
    ]  # fmt: skip
    counts = camera.identity()["counts"]
    assert counts["images"] + counts["dropped"] == n


def test_stream_starts_with_later_exposures() -> None:
    clock = WallClock()
    camera = opened([*sent(0, 1, 2), ["wait", 0.4], *sent(3, 4), ["exit", 0]])
    camera.capture()
    time.sleep(0.1)
    camera.begin("press")
    began_s = clock.now_s()
    frames = to_the_end(camera)[0]
    assert [told(f) for f in frames] == [(3, 0, 0), (4, 0, 0)]
    assert all(f.t_s > began_s for f in frames)
    assert camera.identity()["counts"]["stale"] == 2


@pytest.mark.parametrize("stamped", [True, False])
def test_image_time_is_stamp_minus_latency(stamped: bool) -> None:
    before_s = time.monotonic()
    camera = opened([*sent(0), ["exit", 0]], stamped, latency_ms=200.0)
    frame = camera.capture()
    assert before_s - 0.2 < frame.t_s < time.monotonic() - 0.2


def test_stalled_camera_is_reported_in_time() -> None:
    camera = opened([*sent(0, 1)])
    camera.capture()
    started_s = time.monotonic()
    assert (
        "stalled: no image within 0.5 s; check the command and its camera" in to_the_end(camera)[1]
    )
    assert 0.4 < time.monotonic() - started_s < 5


def test_constant_image_is_a_hung_camera() -> None:
    plan: list[Any] = sent(0)
    for k in range(1, 100):
        plan += [["wait", 0.01], ["send", k, 0]]
    text = to_the_end(opened(plan))[1]
    assert "the same image " in text


@pytest.mark.parametrize(
    ("after_s", "ahead_s"),
    [
        (0.1, -0.9),
        pytest.param(1.5, -0.9, marks=pytest.mark.slow),
        pytest.param(1.5, -0.1, marks=pytest.mark.slow),
    ],
)
def test_constant_lag_told_with_size(after_s: float, ahead_s: float) -> None:
    """Not as a stall, also by one who asks for new images before the lag has been measured."""
    camera = opened([["ahead", ahead_s], *sent(0), ["many"]])
    camera.capture()
    time.sleep(after_s)
    camera.begin("press")
    if ahead_s == -0.9:
        text = (
            r"images arrive 0\.9\d s after their stamps, more than 0\.25 s: the clock of its sender"
        )
        assert re.search(text, to_the_end(camera)[1])
    else:
        camera.capture()
        assert 100 <= camera.identity()["lag_ms"] < 200


def test_missing_first_image_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "FIRST_IMAGE_S", 0.3)
    assert "no first image" in to_the_end(opened([]))[1]


@pytest.mark.parametrize(
    ("end", "says"),
    [
        ([["say", "hum"], ["say", "no lens"], ["exit", 3]], "ended with status 3; .*: no lens$"),
        ([["exit", 0]], "ended with status 0; no message on stderr"),
        ([["say", "zap"], ["abort"]], "ended by signal 9; stderr: zap"),
        ([["write", 100], ["exit", 0]], "ended with status 0"),  # amid an image
        ([["write", 16], ["write", W * H * 3]], r"arrive \d+\.\d\d s after .* clock of its sender"),
        ([["ahead", 0.3], *sent(2)], r"a stamp 0\.[23]\d+ s later than its arrival: .* is ahead"),
    ],
)
def test_dead_or_garbled_child_is_reported(end: list[Any], says: str) -> None:
    camera = opened([*sent(0, 1), *end])
    assert camera.capture().number == 0
    assert re.search(says, to_the_end(camera)[1])


def test_decreasing_number_is_a_restarted_camera() -> None:
    assert "image 1 after 7: it restarted its numbering" in to_the_end(opened(sent(7, 1)))[1]


def test_missing_program_is_reported_before_motion(tmp_path: Path) -> None:
    config = CameraConfig(command=("no-such-camera",), width_px=W, height_px=H)
    with pytest.raises(InputError, match=r"camera\.command: no-such-camera: cannot be started"):
        open_camera(config, tmp_path, WallClock())


def test_closed_camera_leaves_no_process(tmp_path: Path) -> None:
    """Nor what the command started. Closed once more it stays closed."""
    camera = opened([["fork"], *sent(0)])
    camera.capture()
    group = camera._feed._child.pid  # type: ignore[attr-defined]
    started_s = time.monotonic()
    camera.close()
    camera.close()
    assert time.monotonic() - started_s < 5
    deadline_s = time.monotonic() + 5
    while time.monotonic() < deadline_s:  # orphans are reaped by whoever adopts them
        if not _alive(group):
            break
        time.sleep(0.02)
    assert not _alive(group)


def _alive(group: int) -> bool:
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, found = stat.read_text().rpartition(")")[2].split()[:3]
        except OSError:
            continue
        if int(found) == group and state not in "ZX":
            return True
    return False


class Listed:
    """A feed of what is in a list; an empty image stands for a damaged one."""

    name, stamps, check = "list", "driver", "nothing"

    def __init__(
        self, arrivals: list[stream.FeedImage], pauses_s: Iterable[float] = (0.0,) * 99
    ) -> None:
        self._left, self._pauses_s = iter(arrivals), iter(pauses_s)

    def next(self, timeout_s: float) -> stream.FeedImage | None:
        time.sleep(next(self._pauses_s))
        if (arrived := next(self._left, None)) is None:
            raise SensorError("over")
        if arrived.image.size == 0:
            raise stream.LostImage("damaged JPEG: test")
        return arrived

    def identity(self) -> dict[str, Any]:
        return {}

    def close(self) -> None: ...


def noise(draw: random.Random) -> Image:
    return np.frombuffer(draw.randbytes(48), np.uint8).reshape(4, 4, 3)


def test_losses_without_numbers_from_stamp_gaps() -> None:
    """Of stamps as a driver gives them: one comes late, and two are missing."""
    draw, start_s = random.Random(1), time.monotonic() - 0.2
    stamps = [start_s + k / 50 for k in (0, 1, 2.2, 3, 6, 7)]
    feed = Listed([stream.FeedImage(noise(draw), t_s) for t_s in stamps])
    camera = stream.StreamCamera(feed, WallClock(), rate_hz=50.0)
    assert [f.dropped for f in to_the_end(camera)[0]] == [0, 0, 0, 0, 2, 0]
    assert "inferred" in camera.identity()["losses_by"]


@pytest.mark.parametrize("numbered", [True, False])
@pytest.mark.parametrize("rate_hz", [None, 50.0])
def test_damaged_and_odd_images_are_lost(numbered: bool, rate_hz: float | None) -> None:
    """Of six images the first is damaged, the fourth has another size."""
    draw, start_s = random.Random(1), time.monotonic() - 0.12
    images = [noise(draw) for _ in range(6)]
    images[0], images[3] = images[0][:0], images[3][:2]
    arrivals = [
        stream.FeedImage(image, start_s + k / 50, k if numbered else None)
        for k, image in enumerate(images)
    ]
    camera = stream.StreamCamera(Listed(arrivals), WallClock(), size_px=(4, 4), rate_hz=rate_hz)
    assert [f.dropped for f in to_the_end(camera)[0]] == [1, 0, 1, 0]
    counts = camera.identity()["counts"]
    assert (counts["images"], counts["dropped"], counts["damaged"]) == (4, 2, 2)


@pytest.mark.parametrize(("size", "why"), [(2, "4 x 2 px; 4 x 4 px expected"), (0, "JPEG: test")])
def test_steadily_lost_images_are_refused(size: int, why: str) -> None:
    draw, n = random.Random(1), stream.MAX_LOST_IMAGES
    arrivals = [stream.FeedImage(noise(draw)[:size], time.monotonic(), k) for k in range(n)]
    camera = stream.StreamCamera(Listed(arrivals), WallClock(), size_px=(4, 4))
    told = rf"^camera list: {n} images in a row lost: .*{why}; check"
    assert re.search(told, to_the_end(camera)[1])


@pytest.mark.slow
def test_stalled_camera_names_its_lost_images() -> None:
    images = [noise(random.Random(1)), noise(random.Random(2))[:2]]
    arrivals = [stream.FeedImage(image, time.monotonic()) for image in images]
    feed = Listed(arrivals, itertools.chain([0.0, 0.0], itertools.repeat(3.0)))
    camera = stream.StreamCamera(feed, WallClock())
    assert "no image within 0.5 s, 1 lost: 4 x 2 px; 4 x 4 px expected" in to_the_end(camera)[1]


@pytest.mark.parametrize("seed", range(2))
def test_lost_images_are_always_counted(seed: int) -> None:
    """Whatever the sender skips and repeats, and however slow it is or who listens."""
    draw = random.Random(seed)
    number, image, arrivals = draw.randrange(2**32), noise(draw), []
    for _ in range(60):
        if draw.random() < 0.8:
            image = noise(draw)
        arrivals.append(stream.FeedImage(image, time.monotonic(), number))
        number = (number + draw.choice([1, 1, 1, 1, 2, 5])) % 2**32
    pauses_s = (draw.choice([0.0, 0.0, 5e-4]) for _ in itertools.count())
    camera = stream.StreamCamera(Listed(arrivals, pauses_s), WallClock())
    frames: list[CameraFrame] = []
    last_image = next(a for a in arrivals if np.array_equal(a.image, arrivals[-1].image))
    while not frames or not np.array_equal(frames[-1].image, last_image.image):
        frames.append(camera.capture())
        time.sleep(random.choice([0.0, 0.0, 2e-3]))
    camera.close()
    counted = len(frames) + sum(f.dropped + f.repeated for f in frames)
    assert frames[-1].number == last_image.number
    assert counted == (last_image.number - arrivals[0].number) % 2**32 + 1  # type: ignore[operator]
