"""`deltact-fab protocol`: new, list, plan, check, show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from deltact_fab.common import catalogue_names, find_file, format_duration, read_toml

from .group import CommandGroup
from .old_keys import of_protocol
from .options import NAME_OR_PATH, NEW_FILE, RIG_OPTION, out_folder
from .output import Answer, answers, check_lines, columns_of, file_note, listing, progress
from .plan import plan, try_

PAPER_REMARK = (
    "the paper's depth of 10 mm needs about 271 N with a sphere of 15 mm (predicted, at 0.56 MPa "
    "and friction 0.5)"
)


@click.group(cls=CommandGroup)
def protocol() -> None:
    """Indentation experiments: write, plan, check, show.

    A PROTOCOL is a name of `protocol list` or a path.
    """


PROTOCOL_ARGUMENT = click.argument("name", metavar="PROTOCOL", type=NAME_OR_PATH)


@protocol.command("list")
@answers
def list_() -> Answer:
    """List protocols: your own and the shipped ones."""
    names = catalogue_names("protocols")
    rows = [(n, read_toml(find_file("protocols", n)).get("description", "")) for n in names]
    return listing(("protocol", "description"), rows)


@protocol.command(epilog="Example: deltact-fab protocol new mine --from smoke")
@click.argument("name")
@click.option("--from", "source", default="smoke", type=NAME_OR_PATH,
              metavar="PROTOCOL", help="Protocol to start from.")  # fmt: skip
@click.option("--design", type=NAME_OR_PATH, metavar="DESIGN",
              help="Fit positions, indenters, depths and drags to its face.")  # fmt: skip
@NEW_FILE
@answers
def new(name: str, source: str, design: str | None, out: Path | None) -> Answer:
    """Write a new protocol with every key explained.

    Its values are those of --from; `protocol check NAME` then finds it by name.
    """
    from ..lab import protocol as write

    file, changes = write(name, source, out, design)
    answer = file_note(file, f"protocol check {name}")
    lines = [*(f"fitted: {line}" for line in changes), *answer.lines]
    return Answer({**answer.data, "fitted": changes}, lines)


protocol.add_command(plan)
protocol.add_command(try_)


@protocol.command(epilog="Example: deltact-fab protocol check smoke --rig virtual")
@PROTOCOL_ARGUMENT
@RIG_OPTION
@click.option("--air", is_flag=True, help="As for `run --air`: touch nothing.")
@click.option("--unattended", is_flag=True, help="As for `run --unattended`: no prompts.")
@out_folder("As for `run --out`: check its disk space.", default=Path(),
            show_default="here")  # fmt: skip
@answers
def check(name: str, rig_name: str, air: bool, unattended: bool, out: Path) -> Answer:
    """Check whether `run` would start; exit code 1 if not.

    For a real rig, missing peak forces are solved once, which takes minutes.
    """
    from deltact_fab.simulate import RunRequest

    with progress("check") as report:
        request = RunRequest(name, rig_name, out, progress=report, air=air, unattended=unattended)
        rows = request.checks()
    data = [{**row.as_dict(), **of_protocol(row)} for row in rows]
    return Answer(data, check_lines(rows), "" if any(row.failed for row in rows) else None)


@protocol.command()
@PROTOCOL_ARGUMENT
@RIG_OPTION
@click.option("--forces", is_flag=True, help="Solve missing peak forces (minutes).")
@answers
def show(name: str, rig_name: str, forces: bool) -> Answer:
    """Show the steps, frames, time, disk space and peak forces of PROTOCOL.

    Peak forces of deep presses need a solve at finite strain, done once with --forces.
    """
    from deltact_fab.simulate import RunRequest

    with progress("peak forces") as report:
        request = RunRequest(name, rig_name, progress=report)
        specimen, steps, estimate = request.protocol.specimen, request.steps, request.estimate()
        predicted = request.forces(solve=forces)
    peaks, findings = None, None
    if predicted is not None:
        peaks = [peak.as_dict() for peak in predicted[0]]
        findings = [row.reason for row in predicted[1] if row.status in ("warn", "fail")]
    data: dict[str, Any] = {
        "specimen": specimen.model_dump(mode="json"),
        "steps": [asdict(s) for s in steps],
        "estimate": asdict(estimate),
        "peaks": peaks,
        "force_findings": findings,
    }
    serial = f", serial number {specimen.serial}" if specimen.serial else ""
    lines = [
        f"specimen: design {specimen.design}, pattern {specimen.pattern}{serial}\n",
        *columns_of(("id", "kind", "target_mm", "feed_mm_min", "frames"), data["steps"]),
        f"\n{estimate.steps} steps, {estimate.presses} presses, {estimate.frames} frames "
        f"({estimate.settled} settled; tip moves at most {estimate.between_frames_mm:.2g} mm "
        f"between frames), {format_duration(estimate.seconds)} of motion and settling, "
        f"about {estimate.disk_mb:.0f} MB",
    ]
    if peaks is None or findings is None:
        lines.append("peak forces: --forces solves the deep presses, once (minutes)")
        return Answer(data, [*lines, PAPER_REMARK])
    return Answer(data, [*lines, *_peak_lines(peaks, findings)])


def _peak_lines(peaks: Sequence[dict[str, Any]], findings: Sequence[str]) -> Iterator[str]:
    """Format the peaks, then the rig's findings."""
    loads = ("normal_n", "normal_high_n", "tangential_n", "tangential_high_n")
    yield "\npeak forces: predicted, and (high) for twice the gel's modulus:"
    names = ("indenter", "position", "depth_mm", *loads, "level")
    yield from columns_of(names, peaks)
    for reason in dict.fromkeys(f"{p['indenter']}: {p['reason']}" for p in peaks if p["reason"]):
        yield f"upper estimate, {reason}"
    yield from (f"over limit: {line}" for line in findings)
