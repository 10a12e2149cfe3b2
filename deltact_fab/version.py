"""The version of the package and of what it stands on, which files and results carry."""

from __future__ import annotations

import platform
from collections.abc import Iterable

VERSION = "0.3.0"
PACKAGES = ("numpy", "scipy", "opencv-contrib-python-headless", "cadquery")


def library_versions(packages: Iterable[str] = PACKAGES) -> dict[str, str]:
    """Versions that can change a number: ours, Python's and those of packages."""
    from importlib.metadata import PackageNotFoundError, version

    found = {"deltact-fab": VERSION, "python": platform.python_version()}
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found
