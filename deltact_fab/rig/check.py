"""What is wrong with a bench, and how to put it right: each device is talked to, nothing moves."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ..errors import DeltactFabError
from .config import GrblConfig
from .interface import DeviceRow, WallClock


def check(config: GrblConfig, folder: Path, seconds: float) -> Iterator[DeviceRow]:
    """Look at stage, force sensor, guard, camera and at what a press needs besides.

    folder: of the rig file. seconds: how long camera and sensor are watched. Raises nothing that a
    device can cause: that is a row.
    """
    yield from _stage(config)
    if config.force is not None and config.force.reachable:
        from .force.probe import probe as listen

        yield from listen(config.force, config.guard, seconds)
    if config.camera is not None:
        from .camera.probe import probe as look

        yield from look(config.camera, folder, seconds)
    else:
        text = "no [camera]: a protocol with the channel image is refused"
        yield DeviceRow("camera", "WARN", text)
    yield from _presses(config)


def _stage(config: GrblConfig) -> Iterator[DeviceRow]:
    from .stage.grbl import GrblStage

    stage = GrblStage.of(config.stage, WallClock())
    refused = ""
    try:
        stage.connect()
    except DeltactFabError as why:
        refused = str(why)
    finally:
        stage.close()
    read = len(stage.identity()["settings"])
    if read:
        banner = stage.banner or "no banner: the board does not restart when opened"
        text = f"{config.stage.port} answers: {banner}; {read} settings were read"
        yield DeviceRow("stage", "pass", text)
    yield from stage.judged
    if refused and not any(row.verdict == "FAIL" for row in stage.judged):
        yield DeviceRow(
            "stage",
            "FAIL",
            f"{refused}; check its power and cable, [stage] port and baud, and that no other "
            "program has the port",
        )


def _presses(config: GrblConfig) -> Iterator[DeviceRow]:
    """What a press needs of the rig file; without it a run goes in air only."""
    force, missing = config.force, []
    if force is None or not force.reachable:
        missing.append(
            "no way to a force sensor, so only --air runs: add [force] with its ranges and "
            "[force.netft] or [force.serial]"
        )
    elif "range_n" not in force.model_fields_set:
        missing.append("[force] range_n is not declared: write it from the calibration sheet")
    if config.stage.max_force_n is None:
        missing.append(
            "[stage] max_force_n is not declared: measure what the axes push without losing steps"
        )
    if config.touch is None:
        missing.append("no [touch], so it is not known where the face is: add one")
    for text in missing:
        yield DeviceRow("presses", "FAIL", text)
    if not missing:
        yield DeviceRow("presses", "pass", "the rig file has all that a press needs")
