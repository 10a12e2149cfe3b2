"""`rig new` writes a file that loads, with every key that a rig file can have."""

from __future__ import annotations

import re
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from click.testing import CliRunner
from pydantic import BaseModel
from serial.tools import list_ports

from deltact_fab.app import lab
from deltact_fab.app.cli.main import main
from deltact_fab.app.lab import rig_text
from deltact_fab.bench.rig import config, devices
from deltact_fab.bench.rig.devices import HostDevice
from deltact_fab.common.errors import InputError
from deltact_fab.paths import shipped_folder

EXAMPLE = re.compile(r"#(\[.*\]|[a-z0-9_]+ = .*)")
OTHER = re.compile(r"#or (\[.*\]|[a-z0-9_]+ = .*)")


def loaded(folder: Path, text: str) -> config.GrblConfig:
    file = folder / "bench.toml"
    file.write_text(text)
    found, _ = config.load_rig(str(file))
    assert isinstance(found, config.GrblConfig)
    return found


def models(kind: Any) -> Iterator[type[BaseModel]]:
    """All tables that stand in an annotation."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        yield kind
    for part in get_args(kind):
        if not isinstance(part, str | types.NoneType):
            yield from models(part)


def keys(model: type[BaseModel], at: str = "") -> Iterator[str]:
    """Every key of a table and of those in it, as `force.netft.host`."""
    for name, field in model.model_fields.items():
        inner = list(models(field.annotation))
        yield from (key for table in inner for key in keys(table, f"{at}{name}."))
        if not inner:
            yield at + name


def named(text: str) -> set[str]:
    """Every key that a text has, set or in a comment, with its table."""
    found, table = set(), ""
    for line in text.splitlines():
        plain = re.sub(r"^#(or )?(?=\[|[a-z0-9_]+ = )", "", line)
        if head := re.fullmatch(r"\[+(.*?)\]+", plain):
            table = head[1].replace('tools."sphere:10"', "tools") + "."
        elif key := re.match(r"([a-z0-9_]+) = ", plain):
            found.add(table + key[1])
    return found


def test_file_has_every_key_of_models() -> None:
    assert named(rig_text()) == set(keys(config.GrblConfig))


def test_shipped_bench_equals_rig_new_output() -> None:
    assert (shipped_folder("protocols/rigs") / "grbl-bench.toml").read_text() == rig_text()


def test_new_file_loads_with_any_devices(tmp_path: Path) -> None:
    ports = [HostDevice("/dev/ttyUSB3", "CH340"), HostDevice('/dev/serial/by-id/a "b"')]
    cameras = [HostDevice("/dev/video2", "UVC"), HostDevice("/dev/video4", "another")]
    bare = loaded(tmp_path, rig_text())
    assert bare.stage.port == "/dev/ttyACM0"
    assert (bare.force, bare.camera, bare.guard, bare.touch, bare.tools) == (None,) * 4 + ({},)
    text = rig_text(ports, cameras)
    full = loaded(tmp_path, text)
    assert full.stage.port == "/dev/ttyUSB3"
    assert full.camera is not None
    assert full.camera.source == "/dev/video2"
    assert '#or port = "/dev/serial/by-id/a \\"b\\""' in text
    assert '#or source = "/dev/video4"  # another' in text


def test_examples_in_comments_are_valid_together(tmp_path: Path) -> None:
    text = "\n".join(EXAMPLE.sub(r"\1", line) for line in rig_text().splitlines())
    found = loaded(tmp_path, text)
    assert found.force is not None
    assert found.force.netft is not None
    assert found.guard is not None
    assert found.touch is not None
    assert found.tools["sphere:10"].length_mm == 0.0
    # What is called a default is one: a file without the line means the same.
    for key in ("angle_deg", "tilt_deg", "baud", "direction_mask", "homing_direction_mask"):
        assert getattr(found.stage, key) == config.StageConfig.model_fields[key].default, key
    touch = type(found.touch).model_fields
    assert all(getattr(found.touch, key) == touch[key].default for key in touch)


def test_alternatives_in_comments_are_valid(tmp_path: Path) -> None:
    lines = rig_text().splitlines()
    lines = lines[lines.index("#or [force.serial]") : lines.index("#[camera]")]
    scale = [line for line in (OTHER.sub(r"\1", line) for line in lines) if line[:1] != "#"]
    found = loaded(tmp_path, rig_text() + "\n[force]\n" + "\n".join(scale))
    assert found.force is not None
    assert found.force.serial is not None
    assert found.force.serial.ask == "SIR\r\n"


def test_boards_are_listed_first_stable_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def port(device: str, vid: int | None, text: str) -> types.SimpleNamespace:
        return types.SimpleNamespace(device=device, vid=vid, description=text)

    node = tmp_path / "ttyUSB1"
    node.touch()
    (tmp_path / "by-id").mkdir()
    (tmp_path / "by-id" / "usb-board").symlink_to(node)
    listed = [
        port("/dev/ttyS0", None, "n/a"),
        port("/dev/ttyUSB0", 0x0557, "a converter"),
        port(str(node), 0x1A86, "USB Serial"),
    ]
    monkeypatch.setattr(list_ports, "comports", lambda: listed)
    found = devices.list_ports(tmp_path / "by-id")
    assert found == [
        HostDevice(str(tmp_path / "by-id" / "usb-board"), "USB Serial (CH340)"),
        HostDevice("/dev/ttyUSB0", "a converter"),
    ]


def test_rig_new_never_overwrites(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    done = CliRunner().invoke(main, ["rig", "new", "bench", "-o", str(file)])
    assert done.exit_code == 0, done.output
    assert f"then run `deltact-fab rig check {file}`" in done.output
    shown = CliRunner().invoke(main, ["rig", "show", str(file)])
    assert shown.exit_code == 0
    assert "stage.port" in shown.output
    file.write_text("mine")
    with pytest.raises(InputError, match="already exists"):
        lab.rig("bench", file)
    assert file.read_text() == "mine"
