"""A rig as a source. Of a real one only the camera is opened; nothing moves.

A virtual one runs a protocol and its camera delivers the images. Nothing is recorded, and no force
is measured: the images come through the camera interface of any driver, and the measurement has no
access to the rig.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

from deltact_fab.bench import (
    CameraFrame,
    Devices,
    Step,
    VirtualConfig,
    check_limits,
    load_rig,
    load_view,
)
from deltact_fab.common import Check, InputError
from deltact_fab.estimate import SensorModel
from deltact_fab.fabricate import load_design
from deltact_fab.sensor import FlatField
from deltact_fab.simulate import RunRequest

from .source import Source, camera_source

DEFAULT_PROTOCOL = "smoke"


def rig_source(rig_name: str, protocol: str, design: str | None, seed: int) -> Source:
    """Open the camera of a rig, with the sensor model of the rig's file.

    protocol: of a virtual rig, "" for the default. design: of the sensor at a real camera.
    Raises InputError for a real rig without a camera, or with a protocol.
    """
    bench, path = load_rig(rig_name)
    if isinstance(bench, VirtualConfig):
        return virtual_source(rig_name, protocol or DEFAULT_PROTOCOL, seed)
    if protocol:
        raise InputError(
            f"{path}: kind: {bench.kind!r} has a real stage, which `measure` does not move: give "
            "the rig without a protocol for its camera, or `run` the protocol"
        )
    if bench.camera is None:
        raise InputError(f"{path}: camera: missing table; `measure` needs a camera")
    sensor = load_design(design or "deltact")
    view = load_view(bench.camera, sensor, path)
    camera_file = bench.camera.model
    flat = None if camera_file is None else FlatField.from_camera_file(path.parent / camera_file)
    view_flat = None if view is None or flat is None else flat.for_view(view)
    simulated = "simulated devices" if bench.served else None
    model = SensorModel(view, sensor.skin, flat=view_flat, simulated=simulated)
    return camera_source(bench.camera, path.parent, model)


def virtual_source(rig_name: str, protocol_name: str, seed: int) -> Source:
    """Open the images of a protocol on a virtual rig, in order; those at rest never end.

    Time is virtual: images come as fast as they are rendered. Raises InputError for a protocol
    without images or that does not fit.
    """
    request = RunRequest(protocol_name, rig_name, seed=seed)
    protocol, source = request.protocol, str(request.source)
    if "image" not in protocol.channels:
        raise InputError(f"{source}: channels: `measure` needs 'image'")
    # Solve only the channels that the measurement needs.
    channels = protocol.channels & {"image", "shear"}
    request.protocol = protocol = protocol.model_copy(update={"channels": channels})
    sensor, kind = request.design, request.kind
    rows = check_limits(protocol, sensor, request.rig.stage, request.steps)
    rows.append(Check.refusal("rig", kind.part, kind.refusals(protocol, sensor, source)))
    Check.require(rows, source)
    view, flat = request.view, kind.flat(protocol)
    model = SensorModel(
        view, sensor.skin, flat=None if view is None or flat is None else flat.for_view(view),
        recipe=request.recipe.model_dump(mode="json"), design=protocol.specimen.design,
        serial=protocol.specimen.serial, simulated=f"simulated, seed {seed}",
    )  # fmt: skip

    def frames(rest_only: bool) -> Iterator[CameraFrame]:
        from deltact_fab.simulate import VirtualRig

        with TemporaryDirectory() as name, closing(kind.build(request.setup(Path(name)))) as rig:
            assert isinstance(rig, VirtualRig), "a real rig has another source"
            yield from _run_steps(request.steps, rig, rest_only)

    return Source(f"{rig_name}:{protocol_name}", model, frames)


def _run_steps(steps: Sequence[Step], devices: Devices, at_rest: bool) -> Iterator[CameraFrame]:
    """Yield the images of the steps, timed as in a run; at_rest: of the first rest, endlessly."""
    stage, camera, clock = devices.stage, devices.camera, devices.clock
    assert camera is not None, "the protocol asks for images"
    stage.connect()
    stage.home()
    for step in steps:
        start_s = clock.now_s()
        filmed_s = stage.start_move(step.target_mm, step.feed_mm_min) + step.hold_s
        for k in range(1, step.frames):
            stage.listen(max(start_s + filmed_s * k / step.frames - clock.now_s(), 0.0))
            yield camera.capture()
        if step.hold_s:
            stage.listen(max(start_s + filmed_s - clock.now_s(), 0.0))
        stage.wait()
        if step.kind == "change":
            devices.change_indenter(step.indenter)
        elif step.id.endswith("/rest"):
            camera.begin(step.press)
        if step.frames:
            clock.sleep_s(step.settle_s)
            yield camera.capture()
            while at_rest:
                yield camera.capture()
