"""A known stage step, measured by the camera: the face sticks to the tip and moves with it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from deltact_fab.bench import open_run
from deltact_fab.common import Check, InputError, graded
from deltact_fab.estimate import FaceFlow, FlowTracker

STUCK_MM = 0.5  # radius about the centre, which slips last; by hand: larger ones slip
MAX_STEP_ERROR_MM = 0.01  # by hand: less refuses good cameras, more a wrong scale


def check_known_step(folder: Path) -> list[Check]:
    """Compare the step of a recorded press with the camera's, one row for x and one for y.

    The step is from one end of the first press's shear to the other. The image of a step is larger
    where the face is pressed in; the camera model and the stage's depth correct that. Raises
    InputError for a run without such steps.
    """
    run = open_run(folder)
    camera = run.camera
    frames = run.frames().dropna(subset=["file"])
    frames = frames[frames["press"] == frames["press"].iloc[0]] if len(frames) else frames
    names = [str(step_id).rpartition("/")[2] for step_id in frames["step_id"]]
    if not {"rest", "shear-x+", "shear-x-"} <= set(names):
        raise InputError(f"{folder}: no known step; record a run of the protocol known-step")
    tracker = FlowTracker(full=False)
    flows, at_mm = {}, {}
    for name, (_, row) in zip(names, frames.iterrows(), strict=True):
        flows[name] = FaceFlow.from_flow(tracker.update(run.image(str(row["file"]))), camera, 2)
        at_mm[name] = row[["x_mm", "y_mm", "z_mm"]].to_numpy(float)
    x, y = np.meshgrid(flows["rest"].x_mm, flows["rest"].y_mm)
    rest = at_mm["rest"]
    near = np.hypot(x - rest[0], y - rest[1]) < STUCK_MM
    rows, origin = [], ", simulated" if run.simulated else ""
    for k, axis in enumerate("xy"):
        plus, minus = f"shear-{axis}+", f"shear-{axis}-"
        if plus not in flows or minus not in flows:
            continue
        a, b = flows[plus], flows[minus]
        valid = near & a.known & b.known
        shifts_mm = (a.shift_mm - b.shift_mm)[valid][:, k]
        pictured = camera.project_px(np.stack((at_mm[plus], at_mm[minus])))
        larger = (pictured[0] - pictured[1])[k] * camera.mm_per_px
        made_mm = float((at_mm[plus] - at_mm[minus])[k])
        seen_mm = made_mm * float(shifts_mm.mean()) / larger if len(shifts_mm) else math.nan
        rows.append(Check(
            f"known-step.{axis}", f"known step, {axis}", "",
            f"{seen_mm:.3f} of {made_mm:.3f} mm{origin}", f"within {MAX_STEP_ERROR_MM:g} mm",
            graded(abs(seen_mm - made_mm) <= MAX_STEP_ERROR_MM),
            remedy="calibrate the camera on this skin: `calibrate lens`; or the tip slips",
        ))  # fmt: skip
    return rows
