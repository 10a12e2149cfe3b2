"""Versions of the package and its libraries, for files and results."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

PACKAGE_VERSION = "0.3.0"
VERSIONED_PACKAGES = ("numpy", "scipy", "opencv-contrib-python-headless", "cadquery")


def library_versions(packages: Iterable[str] = VERSIONED_PACKAGES) -> dict[str, str]:
    """Versions that can change results: of this package, Python and `packages`."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    versions = {"deltact-fab": PACKAGE_VERSION, "python": platform.python_version()}
    for name in packages:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    return versions
