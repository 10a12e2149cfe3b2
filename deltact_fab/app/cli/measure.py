"""`deltact-fab measure`: shape, force and contact from a camera, a file, a run or a rig, live."""

from __future__ import annotations

import os
import signal
from functools import partial
from pathlib import Path

import click

from deltact_fab.common import InputError, Stopped

from .options import NAME_OR_PATH, PATH_TYPE, Finite, out_folder, seed
from .output import echo_json

VIEW_HZ = 10.0  # by hand: smooth to the eye at a low load


@click.command(epilog="Example: deltact-fab measure smoke-run --view")
@click.argument("source", type=NAME_OR_PATH)
@click.option("--camera", type=PATH_TYPE, metavar="FILE", help="Camera file of `calibrate lens`.")
@click.option("--calibration", "calibrations", multiple=True, type=PATH_TYPE, metavar="FILE",
              help="Calibration of depth or force; repeatable.")  # fmt: skip
@click.option("--mm-per-px", type=Finite(min=1e-4, max=100), metavar="MM",
              help="Scale of the resting face, if there is no camera file.")  # fmt: skip
@click.option("--show", metavar="LIST", show_default="all that the calibrations allow",
              help="flow, observation, shape, contacts, force, traction; separated by commas."
              )  # fmt: skip
@click.option("--design", type=NAME_OR_PATH, metavar="DESIGN",
              help="Design of the sensor, if the source does not state it.")  # fmt: skip
@click.option("--serial", metavar="TEXT",
              help="Serial number of the sensor, if the source does not state it.")  # fmt: skip
@seed("Seed of a virtual rig.")
@click.option("--hz", type=Finite(min=0.01), metavar="HZ",
              show_default="as fast as possible; with --view 10",
              help="Largest rate in images per second, except for a camera.")  # fmt: skip
@click.option("--jsonl", is_flag=True, help="Print one JSON object per image, without delay.")
@click.option("--follow", type=Finite(min=0.1), metavar="S",
              help="Wait for new images in folder SOURCE, until none arrives for S s.")  # fmt: skip
@out_folder("New folder for a table of the results and each image's arrays.")
@click.option("--pictures", is_flag=True, help="With --out: save each tracked image too.")
@click.option("--view", is_flag=True, help="Show the results live on a local page.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, metavar="N",
              show_default="a free one", help="Port of the live page.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print JSON at the end.")
def measure(
    source: str, camera: Path | None, calibrations: tuple[Path, ...], mm_per_px: float | None,
    show: str | None, design: str | None, serial: str | None, seed: int, hz: float | None,
    jsonl: bool, follow: float | None, out: Path | None, pictures: bool, view: bool, port: int,
    as_json: bool,
) -> None:  # fmt: skip
    """Measure the images of SOURCE; the first must show the face at rest.

    SOURCE is the number of a camera, such as 0, its device file or its address; a video; a folder
    of images; a run; or a rig. Of a real rig, such as bench.toml, only the camera is opened; a
    virtual one, virtual or virtual:PROTOCOL, simulates its images. From a camera the newest image
    is measured, and those in between are dropped and counted; otherwise every image is measured.
    Ctrl-C stops it. Without a camera file lengths are in pixels. A skin of markers is recognised in
    the first image. `schema measured` lists the columns written by --out.
    """
    # Read by every BLAS when numpy is imported. The pipeline uses the cores already.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if pictures and out is None:
        raise click.UsageError("--pictures needs --out")
    if jsonl and as_json:
        raise click.UsageError("give --jsonl or --json, not both: each writes to stdout")
    import cv2

    from deltact_fab.present import deliver_results, open_session

    cv2.setNumThreads(1)  # the flow depends on their number; more are no faster
    if out is not None and out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"--out {out}: must be a new or empty folder")
    # As Ctrl-C, so that output is complete when a supervisor ends the process.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    session = open_session(
        source, camera, calibrations,
        None if show is None else [part.strip() for part in show.split(",")],
        design=design, serial=serial, seed=seed, mm_per_px=mm_per_px,
        follow_s=follow, most_hz=hz or (VIEW_HZ if view else None),
    )  # fmt: skip
    ended = deliver_results(
        session, partial(click.echo, err=True), jsonl=jsonl, summary=echo_json if as_json else None,
        folder=out, pictures=pictures, page_port=port if view else None,
    )  # fmt: skip
    raise click.exceptions.Exit(0 if ended else Stopped.exit_code)
