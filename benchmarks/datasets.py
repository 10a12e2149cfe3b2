"""A LeRobot dataset of a thousand frames, opened by LeRobot's own loader.

python -m benchmarks.datasets FOLDER PYTHON

Makes a run of 1000 small frames in FOLDER, exports it and reads it again; a FOLDER that is there
already is only read. PYTHON: of an environment that has lerobot, which brings torch and has no
place beside this one. The loader must give every number to float32, every frame at its time and the
motion to its levels; how far the lossy image is off is printed.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from deltact_fab.bench.protocols.plan import Step
from deltact_fab.bench.record.export import export_run
from deltact_fab.bench.record.export.lerobot import (
    FEATURE_COLUMNS,
    MOTION_KEY,
    RAW_KEY,
    episodes,
    levels,
    values_of,
)
from deltact_fab.bench.record.run import open_run
from deltact_fab.bench.record.streams import Chunk
from deltact_fab.bench.record.writer import RunWriter
from deltact_fab.estimate.analysis.flows import open_follower

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
    parser.add_argument("lerobot", type=Path, help="python of an environment with lerobot")
    asked = parser.parse_args()
    dataset, out = asked.folder / "lerobot", asked.folder / "read.npz"
    if not asked.folder.exists():
        asked.folder.mkdir(parents=True)
        make_run(asked.folder / "run")
        made = open_run(asked.folder / "run")
        print(export_run([made], "lerobot", dataset, None, open_follower))
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"peak memory {peak_mb:.0f} MB")
    keys = [*FEATURE_COLUMNS, "timestamp", "frame_index", "episode_index"]
    words = [dataset, out, json.dumps(keys), json.dumps([RAW_KEY, MOTION_KEY])]
    subprocess.run([asked.lerobot, "-c", READ, *map(str, words)], check=True)
    read = dict(np.load(out))  # at once: each look-up would read the file again
    at, off = 0, []
    run = open_run(asked.folder / "run")
    for number, episode in enumerate(episodes([run], open_follower, lambda *told: None)):
        here = slice(at, at + len(episode.table))
        for key, columns in FEATURE_COLUMNS.items():
            wanted = values_of(episode.table, columns)
            single = wanted.astype(np.float32) if wanted.dtype == np.float64 else wanted
            assert np.array_equal(read[key][here], single, equal_nan=True), key
        assert (read["episode_index"][here] == number).all()
        for image, motion in episode.images():
            assert np.array_equal(read[MOTION_KEY][at], levels(motion)), at
            off.append(np.mean((read[RAW_KEY][at].astype(float) - image) ** 2))
            at += 1
    assert np.array_equal(read["timestamp"], np.float32(read["frame_index"] / RATE_HZ))
    psnr_db = 10 * np.log10(255**2 / np.mean(off))
    print(f"{at} frames of {int(read['episodes'])} episodes; numbers exact to float32, motion to "
          f"its levels, image {psnr_db:.1f} dB")  # fmt: skip


if __name__ == "__main__":
    main()
