"""The datasets of a thousand frames, opened by the loaders of their formats.

python -m benchmarks.datasets FOLDER [--lerobot PYTHON]

Makes a run of 1000 small frames in FOLDER, exports it as Zarr and LeRobot, and reads both again;
a FOLDER that is there already is only read.
PYTHON: of an environment that has lerobot, which brings torch and has no place beside this one.
Zarr must give every number and pixel back; LeRobot every number to float32, every frame at its time
and the motion to its levels; how far the lossy image is off is printed.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import zarr

from deltact_fab import record
from deltact_fab.analysis.flows import follower
from deltact_fab.protocols.plan import Step
from deltact_fab.record import Chunk, RunWriter
from deltact_fab.record.export import export
from deltact_fab.record.export.episodes import FIELDS
from deltact_fab.record.export.lerobot import MOTION, RAW, levels

PRESSES, FRAMES = 20, 50
SIZE_PX = (320, 240)
RATE_HZ = 10.0
FORCE = ("fx_n", "fy_n", "fz_n", "tx_nmm", "ty_nmm", "tz_nmm")

READ = """
import json, sys
import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset
root, out, keys, videos = sys.argv[1], sys.argv[2], *map(json.loads, sys.argv[3:])
data = LeRobotDataset("local/run", root=root, video_backend="pyav")
items = [data[i] for i in range(len(data))]
found = {key: np.stack([item[key].numpy() for item in items]) for key in keys}
for key in videos:
    found[key] = np.stack(
        [np.rint(item[key].numpy() * 255).astype(np.uint8).transpose(1, 2, 0) for item in items])
np.savez(out, episodes=data.num_episodes, **found)
"""


def make_run(folder: Path) -> None:
    """Presses of a random pattern that moves by known pixels, with force and pose at 1 kHz."""
    rng = np.random.default_rng(0)
    width, height = SIZE_PX
    tile = rng.integers(0, 256, (height // 4 + 8, width // 4 + 8, 3), dtype=np.uint8)
    wide = cv2.resize(tile, None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
    camera = {"model": "pinhole", "width_px": width, "height_px": height, "mm_per_px": 0.05,
              "eye_distance_mm": 13.0}  # fmt: skip
    meta: dict[str, Any] = {
        "name": "thousand", "simulated": False, "seed": 0, "camera": camera,
        "rig": {"kind": "none", "camera": {"format": "png"}},
        "protocol": {"name": "thousand", "capture": {"mode": "sweep", "rate_hz": RATE_HZ}},
    }  # fmt: skip
    steps = [
        Step(f"ball/p{n}/press", f"ball/p{n}", "sphere:10", "press", (0, 0, -1.0), 30.0, FRAMES)
        for n in range(PRESSES)
    ]
    writer = RunWriter.create(folder, meta, b"", {}, steps)
    for n, step in enumerate(steps):
        begun_s = 100.0 * n
        for k in range(FRAMES):
            dx, dy = 3 * np.sin(k / 8), 2 * np.sin(k / 5)
            move = np.array([[1, 0, dx - 16], [0, 1, dy - 16]], np.float64)
            image = cv2.warpAffine(wide, move, SIZE_PX, flags=cv2.INTER_LINEAR)
            noisy = np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)
            t_s = k / RATE_HZ
            writer.frame(step, k + 1, noisy, begun_s + t_s, t_s, t_s)
        t_ns = np.arange(0, int(FRAMES / RATE_HZ * 1e9), 1_000_000, dtype=np.int64)
        felt = {name: rng.normal(0, 1, len(t_ns)) for name in FORCE}
        felt["fz_n"] = np.minimum(0.0, -t_ns / 1e9 + 0.5)
        saturated = np.zeros(len(t_ns), bool)
        pose = {name: rng.normal(0, 1, len(t_ns)) for name in ("x_mm", "y_mm", "z_mm")}
        chunks = [
            Chunk("force", begun_s, {"t_ns": t_ns, **felt, "saturated": saturated}),
            Chunk("pose", begun_s, {"t_ns": t_ns, **pose}),
        ]
        writer.step(step, FRAMES / RATE_HZ, begun_s, begun_s + FRAMES / RATE_HZ, chunks)
    writer.close({})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--lerobot", type=Path, help="python of an environment with lerobot")
    asked = parser.parse_args()
    if not asked.folder.exists():
        asked.folder.mkdir(parents=True)
        make_run(asked.folder / "run")
        for form in ("zarr", "lerobot"):
            made = record.open(asked.folder / "run")
            print(form, export([made], form, asked.folder / form, None, follower))
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"peak memory {peak_mb:.0f} MB")
    run = record.open(asked.folder / "run")
    held: Any = zarr.open_group(asked.folder / "zarr", mode="r")
    frames = run.frames()
    images, shifts = held["image"], held["shift_mm"]
    for at, file in enumerate(frames["file"]):
        assert np.array_equal(images[at][..., ::-1], run.raw(file)), file
    for name, (_, columns) in FIELDS.items():
        if set(columns) <= set(frames):
            wanted = frames[list(columns)].to_numpy().reshape(held[name].shape)
            assert np.array_equal(held[name][:], wanted, equal_nan=True), name
    assert np.array_equal(held["force/wrench"][:], run.force()[list(FORCE)].to_numpy())
    print(f"zarr: {images.shape[0]} frames, {held['force/wrench'].shape[0]} samples, all exact")
    if asked.lerobot is None:
        print("lerobot: not read, no --lerobot")
        return
    out = asked.folder / "read.npz"
    keys = [key for key, _ in FIELDS.values()] + ["timestamp", "frame_index", "episode_index"]
    words = [asked.folder / "lerobot", out, json.dumps(keys), json.dumps([RAW, MOTION])]
    subprocess.run([asked.lerobot, "-c", READ, *map(str, words)], check=True)
    read = dict(np.load(out))  # at once: each look-up would read the file again
    for name, (key, _) in FIELDS.items():
        wanted = held[name][:]
        single = wanted.astype(np.float32) if wanted.dtype == np.float64 else wanted
        assert np.array_equal(read[key], single, equal_nan=True), key
    assert np.array_equal(read["timestamp"], np.float32(read["frame_index"] / RATE_HZ))
    assert np.array_equal(read["episode_index"], held["press_index"][:])
    off = 0.0
    for at in range(images.shape[0]):
        motion = SimpleNamespace(shift_mm=shifts[at], known=held["known"][at])
        assert np.array_equal(read[MOTION][at], levels(motion)), at
        off += float(np.mean((read[RAW][at].astype(float) - images[at]) ** 2)) / images.shape[0]
    psnr_db = 10 * np.log10(255**2 / off)
    print(f"lerobot: {len(read['timestamp'])} frames of {int(read['episodes'])} episodes; numbers "
          f"exact to float32, motion to its levels, image {psnr_db:.1f} dB")  # fmt: skip


if __name__ == "__main__":
    main()
