"""What is installed, what is not, what it would bring, and how to get it. Nothing is changed."""

from __future__ import annotations

import ctypes
import platform
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from typing import Literal

State = Literal["ok", "missing", "broken"]
PACKAGE = "deltact-fab"
NEEDED = "core"
EXTRAS = {
    "cad": "parts, drawings and checks of the built solids",
    "report": "pages and figures",
    "fast": "faster solves of large gels",
    "images": "frames as JPEG XL: smaller, and two to three times as fast to write as PNG",
    "export": "runs as Parquet, MCAP and LeRobot",
    "cluster": "studies on a Dask cluster",
}
"""What each extra of pyproject.toml brings to one who uses the program."""
LIBRARIES = {"libGL.so.1": "libgl1", "libEGL.so.1": "libegl1", "libX11.so.6": "libx11-6"}


@dataclass(frozen=True)
class InstalledItem:
    """One thing that is there or is not.

    group: `core`, an extra or `system`. brings, get: what it is for, and the command that installs
    it, where it is missing or broken.
    """

    group: str
    name: str
    state: State
    text: str
    brings: str = ""
    get: str = ""


def inspect_installation() -> list[InstalledItem]:
    """Everything, in order. Fast: no large package is imported."""
    interpreter = f"{platform.python_version()} {sys.executable}"
    python = InstalledItem(NEEDED, "python", "ok", interpreter)
    return [python, *_packages(), *_system()]


def is_broken(findings: list[InstalledItem]) -> bool:
    """Whether the core cannot work as it is."""
    return any(f.group == NEEDED and f.state != "ok" for f in findings)


def _packages() -> Iterator[InstalledItem]:
    try:
        version, requirements = metadata.version(PACKAGE), metadata.requires(PACKAGE) or []
    except metadata.PackageNotFoundError:
        yield InstalledItem(NEEDED, PACKAGE, "broken", "runs, and is not installed",
                            "its requirements", "pip install -e .")  # fmt: skip
        return
    yield InstalledItem(NEEDED, PACKAGE, "ok", version)
    for line in requirements:
        name, group = parse_requirement(line)
        if group == NEEDED or group in EXTRAS:
            yield _package(name, group, line)


def parse_requirement(line: str) -> tuple[str, str]:
    """Name and extra of a requirement as package metadata has it; `core` without an extra."""
    name = re.match(r"[A-Za-z0-9._-]+", line)
    extra = re.search(r"extra == ['\"]([\w-]+)['\"]", line)
    assert name is not None
    return name[0], extra[1] if extra else NEEDED


def _package(name: str, group: str, line: str) -> InstalledItem:
    brings = "" if group == NEEDED else EXTRAS[group]
    get = "pip install " + (name if group == NEEDED else f"'{PACKAGE}[{group}]'")
    if "platform_machine" in line and platform.machine() not in line:
        return InstalledItem(
            group, name, "ok", f"not made for {platform.machine()}, and not needed"
        )
    try:
        version = metadata.version(name)
    except metadata.PackageNotFoundError:
        return InstalledItem(group, name, "missing", "not installed", brings, get)
    return InstalledItem(group, name, "ok", version)


def _system() -> Iterator[InstalledItem]:
    if not sys.platform.startswith("linux"):
        return
    for library, package in LIBRARIES.items():
        try:
            ctypes.CDLL(library)
        except OSError:
            yield InstalledItem("system", library, "missing", "not found", EXTRAS["cad"],
                          f"apt-get install {package}")  # fmt: skip
        else:
            yield InstalledItem("system", library, "ok", "found")
