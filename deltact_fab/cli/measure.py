"""`deltact-fab measure`: shape, force and contact from a camera, a file, a run or a rig, live."""

from __future__ import annotations

import os
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..errors import INTERRUPTED
from .options import SEED

if TYPE_CHECKING:
    from ..live.outputs import Output
    from ..live.session import Session

VIEW_HZ = 10.0


@click.command()
@click.argument("source", required=False)
@click.option("--camera", type=click.Path(path_type=Path), help="Camera file, of `calibrate`.")
@click.option("--calibration", "calibrations", multiple=True, type=click.Path(path_type=Path),
              help="Calibration of depth or force; repeatable.")  # fmt: skip
@click.option("--show", metavar="LIST", help="As force,shape; default: all that can be shown.")
@click.option("--design", help="Design of the sensor, where the source does not say it.")
@click.option("--serial", help="The sensor's serial, where the source does not say it.")
@click.option("--seed", type=SEED, default=0, show_default=True, help="Of a virtual rig.")
@click.option("--hz", type=click.FloatRange(min=0.01), help="Images a second at most, of what is "
              "not a camera. Default: as fast as it goes; with --view 10.")  # fmt: skip
@click.option("--jsonl", is_flag=True, help="One JSON object an image on stdout.")
@click.option("--view", is_flag=True, help="Show all of it on a page on this computer.")
@click.option("--port", type=click.IntRange(0, 65535), default=0,
              help="Of that page. Default: a free one.")  # fmt: skip
@click.option("--benchmark", is_flag=True, help="Rate, latency and error on this machine.")
@click.option("--json", "as_json", is_flag=True, help="Print the benchmark as JSON.")
def measure(
    source: str | None,
    camera: Path | None,
    calibrations: tuple[Path, ...],
    show: str | None,
    design: str | None,
    serial: str | None,
    seed: int,
    hz: float | None,
    jsonl: bool,
    view: bool,
    port: int,
    benchmark: bool,
    as_json: bool,
) -> None:
    """Measure the images of SOURCE as they come; the first one is the face at rest.

    SOURCE: a camera's number, as 0, its device file or its address; a video; a folder of images; a
    run; a rig: of a real one, as bench.toml, the camera is opened and nothing else; a virtual one,
    as virtual or virtual:PROTOCOL, simulates its images. Of a camera the newest image is measured
    and what comes meanwhile is dropped and counted; of all else every image is. Ctrl-C ends it.
    """
    # Every BLAS reads it, when numpy is imported. The stages have the cores already.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if benchmark:
        _benchmark(as_json)
        return
    if source is None:
        raise click.UsageError("SOURCE: missing: a camera's number, a video, folder, run or rig")
    import cv2

    from ..live import open_source
    from ..live.calibrated import measurement_of
    from ..live.outputs import Check, JsonLines, Lines, PageOutput, about
    from ..live.page import Page
    from ..live.session import Session

    cv2.setNumThreads(1)  # the flow depends on their number, and more bring nothing
    opened = open_source(source, camera, design, serial, seed)
    with ExitStack() as stack:
        stack.callback(opened.close)
        wanted = None if show is None else [part.strip() for part in show.split(",")]
        measurement = measurement_of(opened.known, calibrations, wanted)
        page = (
            Page(about(opened, "force" in measurement.include), measurement.reset, port)
            if view
            else None
        )
        session = Session(
            opened, measurement,
            most_hz=hz or (VIEW_HZ if view else None),
            going=None if page is None else page.going,
        )  # fmt: skip
        outputs: list[Output] = [JsonLines(sys.stdout, opened.known.simulated)] if jsonl else []
        if not jsonl or sys.stderr.isatty():
            outputs.append(Lines(sys.stderr if jsonl else sys.stdout, opened.known.simulated))
        if page is not None:
            stack.callback(page.close)
            outputs.append(PageOutput(session, page))
            click.echo(f"view: {page.url}", err=True)

        def tell(health: str) -> None:
            click.echo(health, err=True)
            if page is not None:
                page.tell(health)

        outputs.append(Check(tell))
        status = _run(session, outputs, stay=page is not None)
    raise click.exceptions.Exit(status)


def _run(session: Session, outputs: list[Output], stay: bool) -> int:
    """Until the source ends, Ctrl-C, or nobody reads what is printed; the exit code."""
    status = INTERRUPTED
    try:
        for measured in session.results():
            for output in outputs:
                output.show(measured)
        status = 0
        for output in outputs:
            output.end("ended")
        while stay:  # the page, with the last result
            time.sleep(1)
    except KeyboardInterrupt:
        if status:
            for output in outputs:
                output.end("stopped")
    except BrokenPipeError:
        # Who read it has enough; what is still in the buffer goes nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 0
    return status


def _benchmark(as_json: bool) -> None:
    from ..numerics.benchmark import run_benchmark
    from .output import echo_json, echo_table, progress

    with progress("benchmark") as report:
        found = run_benchmark(progress=report)
    if as_json:
        echo_json(found)
        return
    rows = [
        (pattern, case, row["hz"], row["latency_ms"]["p50"], row["latency_ms"]["p95"],
         row["cpu_ms"], row["mean_error_mm"], row["coverage"])
        for pattern, cases in found.items() if pattern not in ("about", "load_average")
        for case, row in cases.items()
    ]  # fmt: skip
    echo_table(("pattern", "case", "hz", "latency p50, ms", "p95", "CPU, ms", "mean error, mm",
                "coverage"), rows)  # fmt: skip
    load = found["load_average"]
    click.echo(f"\n{found['about']}; load average {load['before']} before, {load['after']} after")
