"""Check of the installation: what is missing, its purpose and how to install it."""

from __future__ import annotations

import ctypes
import platform
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from typing import Literal

ItemState = Literal["ok", "missing", "broken"]
DISTRIBUTION_NAME = "deltact-fab"
CORE_GROUP = "core"
EXTRA_PURPOSES = {
    "cad": "parts, drawings and checks of the built solids",
    "report": "pages and figures",
    "fast": "faster solves of large gels",
    "images": "frames as JPEG XL: smaller, and two to three times as fast to write as PNG",
    "export": "runs as Parquet, MCAP and LeRobot",
    "cluster": "studies on a Dask cluster",
}
"""Purpose of each user extra of pyproject.toml."""
SYSTEM_LIBRARIES = {"libGL.so.1": "libgl1", "libEGL.so.1": "libegl1", "libX11.so.6": "libx11-6"}


@dataclass(frozen=True)
class InstalledItem:
    """Installed or missing item.

    group: `core`, an extra or `system`. brings, get: its purpose and the command that installs it,
    if it is missing or broken.
    """

    group: str
    name: str
    state: ItemState
    text: str
    brings: str = ""
    get: str = ""


def inspect_installation() -> list[InstalledItem]:
    """Return all items. Fast: no large package is imported."""
    interpreter = f"{platform.python_version()} {sys.executable}"
    python = InstalledItem(CORE_GROUP, "python", "ok", interpreter)
    return [python, *_packages(), *_system()]


def is_broken(findings: list[InstalledItem]) -> bool:
    """True if a core item is missing or broken."""
    return any(f.group == CORE_GROUP and f.state != "ok" for f in findings)


def _packages() -> Iterator[InstalledItem]:
    try:
        version = metadata.version(DISTRIBUTION_NAME)
        requirements = metadata.requires(DISTRIBUTION_NAME) or []
    except metadata.PackageNotFoundError:
        yield InstalledItem(CORE_GROUP, DISTRIBUTION_NAME, "broken", "running, but not installed",
                            "its requirements", "pip install -e .")  # fmt: skip
        return
    yield InstalledItem(CORE_GROUP, DISTRIBUTION_NAME, "ok", version)
    for line in requirements:
        name, group = parse_requirement(line)
        if group == CORE_GROUP or group in EXTRA_PURPOSES:
            yield _package(name, group, line)


def parse_requirement(line: str) -> tuple[str, str]:
    """Parse a requirement of package metadata: name and extra; `core` without an extra."""
    name = re.match(r"[A-Za-z0-9._-]+", line)
    extra = re.search(r"extra == ['\"]([\w-]+)['\"]", line)
    assert name is not None
    return name[0], extra[1] if extra else CORE_GROUP


def _package(name: str, group: str, line: str) -> InstalledItem:
    brings = "" if group == CORE_GROUP else EXTRA_PURPOSES[group]
    get = "pip install " + (name if group == CORE_GROUP else f"'{DISTRIBUTION_NAME}[{group}]'")
    if "platform_machine" in line and platform.machine() not in line:
        return InstalledItem(
            group, name, "ok", f"not available for {platform.machine()}, not needed"
        )
    try:
        version = metadata.version(name)
    except metadata.PackageNotFoundError:
        return InstalledItem(group, name, "missing", "not installed", brings, get)
    return InstalledItem(group, name, "ok", version)


def _system() -> Iterator[InstalledItem]:
    if not sys.platform.startswith("linux"):
        return
    for library, package in SYSTEM_LIBRARIES.items():
        try:
            ctypes.CDLL(library)
        except OSError:
            yield InstalledItem("system", library, "missing", "not found", EXTRA_PURPOSES["cad"],
                          f"apt-get install {package}")  # fmt: skip
        else:
            yield InstalledItem("system", library, "ok", "found")
