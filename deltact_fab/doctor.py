"""What is installed, what is not, what it would bring, and how to get it. Nothing is changed."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import platform
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

from . import cache
from .errors import DeltactFabError
from .extras import EXTRAS
from .rig.new import Device, cameras, ports

State = Literal["ok", "missing", "broken"]
PACKAGE = "deltact-fab"
NEEDED = "core"
LIBRARIES = {"libGL.so.1": "libgl1", "libEGL.so.1": "libegl1", "libX11.so.6": "libx11-6"}
LEAST_FREE_GB = 6.0
"""Of the folder: the paper's force calibration takes 5.5 GB."""


@dataclass(frozen=True)
class Finding:
    """One thing that is there or is not.

    group: `core`, an extra, `system`, `device` or `disk`. brings, get: what it is for, and the
    command that installs it, where it is missing or broken.
    """

    group: str
    name: str
    state: State
    text: str
    brings: str = ""
    get: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return asdict(self)

    def line(self) -> str:
        """As a person reads it."""
        tail = f"; for {self.brings}" if self.brings else ""
        tail += f"; {self.get}" if self.get else ""
        return f"{self.state:<8}{self.group:<9}{self.name:<32}{self.text}{tail}"


def look(deep: bool = False, folder: Path = Path()) -> list[Finding]:
    """Everything, in order. Fast: no large package is imported, unless deep asks for it."""
    return [
        *_python(),
        *_packages(deep),
        *_system(),
        *_devices(),
        *_disk(folder),
    ]


def is_broken(findings: list[Finding]) -> bool:
    """Whether the core cannot work as it is."""
    return any(f.group == NEEDED and f.state != "ok" for f in findings)


def _python() -> Iterator[Finding]:
    found = platform.python_version()
    good = sys.version_info >= (3, 11)
    get = "" if good else "install Python 3.11 or newer"
    yield Finding(
        NEEDED, "python", "ok" if good else "broken", f"{found} {sys.executable}", get=get
    )


def _packages(deep: bool) -> Iterator[Finding]:
    try:
        version, wanted = metadata.version(PACKAGE), metadata.requires(PACKAGE) or []
    except metadata.PackageNotFoundError:
        yield Finding(NEEDED, PACKAGE, "broken", "runs, and is not installed", "its requirements",
                      "pip install -e .")  # fmt: skip
        return
    yield Finding(NEEDED, PACKAGE, "ok", version)
    for line in wanted:
        name, group = required(line)
        if group == NEEDED or group in EXTRAS:
            yield _package(name, group, line, deep)


def required(line: str) -> tuple[str, str]:
    """Name and extra of a requirement as package metadata has it; `core` without an extra."""
    name = re.match(r"[A-Za-z0-9._-]+", line)
    extra = re.search(r"extra == ['\"]([\w-]+)['\"]", line)
    assert name is not None
    return name[0], extra[1] if extra else NEEDED


def _package(name: str, group: str, line: str, deep: bool) -> Finding:
    brings = "" if group == NEEDED else EXTRAS[group]
    what = name if group == NEEDED else f"'{PACKAGE}[{group}]'"
    get = f"pip install {what}"
    if "platform_machine" in line and platform.machine() not in line:
        return Finding(group, name, "ok", f"not made for {platform.machine()}, and not needed")
    try:
        distribution = metadata.distribution(name)
    except metadata.PackageNotFoundError:
        return Finding(group, name, "missing", "not installed", brings, get)
    version, module = distribution.version, module_of(distribution)
    try:
        there = importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        there = False
    if not there:
        again = f"pip install --force-reinstall {name}"
        return Finding(group, name, "broken", f"{version}, without {module}", brings, again)
    if deep:
        try:
            _import(module)
        except DeltactFabError as why:
            return Finding(group, name, "broken", f"{version}: {why}", brings)
        except Exception as why:  # whatever a broken package raises
            fault = " ".join(f"{version}: {type(why).__name__}: {why}".split())
            again = f"pip install --force-reinstall {name}"
            return Finding(group, name, "broken", fault, brings, again)
    return Finding(group, name, "ok", version)


def module_of(distribution: metadata.Distribution) -> str:
    """What it is imported as, from its own list of modules or of files."""
    named = (distribution.read_text("top_level.txt") or "").split()
    if not named:
        paths = [path.parts for path in distribution.files or ()]
        named = [parts[0] for parts in paths if len(parts) == 2 and parts[1] == "__init__.py"]
    own = [name for name in named if not name.startswith("_")]
    return own[0] if own else distribution.name.replace("-", "_")


def _import(module: str) -> None:
    """Raises what the import raises; MissingLibrary with advice for the CAD kernel."""
    if module == "cadquery":
        from .cad.kernel import require

        require()
    else:
        importlib.import_module(module)


def _system() -> Iterator[Finding]:
    if not sys.platform.startswith("linux"):
        return
    for library, package in LIBRARIES.items():
        try:
            ctypes.CDLL(library)
        except OSError:
            yield Finding("system", library, "missing", "not found", EXTRAS["cad"],
                          f"apt-get install {package}")  # fmt: skip
        else:
            yield Finding("system", library, "ok", "found")


def _devices() -> Iterator[Finding]:
    yield from _plugged("serial port", ports, "a stage or a scale", _may_use)
    yield from _plugged("camera", cameras, "`measure`, `rig photograph`", _may_use)


def _plugged(
    what: str, find: Callable[[], list[Device]], brings: str, may: Callable[[str], bool]
) -> Iterator[Finding]:
    try:
        devices = find()
    except ImportError:
        return  # the package's own row says that it is missing
    if not devices:
        yield Finding("device", what, "missing", "none is plugged in", brings)
    for device in devices:
        if may(device.name):
            yield Finding("device", device.name, "ok", device.text or what)
        else:
            group = "dialout" if what == "serial port" else "video"
            yield Finding("device", device.name, "broken", "no permission", brings,
                          f"sudo usermod -aG {group} $USER, then log in again")  # fmt: skip


def _may_use(name: str) -> bool:
    return os.access(name, os.R_OK | os.W_OK)


def _disk(folder: Path) -> Iterator[Finding]:
    free_gb = shutil.disk_usage(folder).free / 1e9
    low = free_gb < LEAST_FREE_GB
    yield Finding("disk", "this folder", "missing" if low else "ok", f"{free_gb:.1f} GB free",
                  f"runs of up to {LEAST_FREE_GB:g} GB" if low else "")  # fmt: skip
    kept = cache.user_folder()
    size_mb = sum(_bytes(path) for path in kept.rglob("*")) / 1e6 if kept.is_dir() else 0.0
    yield Finding(
        "disk", "cache", "ok", f"{size_mb:.0f} MB in {kept}; may be deleted, which costs time"
    )


def _bytes(path: Path) -> int:
    try:
        return path.lstat().st_size
    except OSError:  # gone since it was listed
        return 0
