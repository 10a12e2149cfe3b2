"""Where protocol, sensor and rig meet: checks before motion, then the run and its record."""

from .request import RunRequest, kind_of
from .session import dry_run, run, versions

__all__ = ["RunRequest", "dry_run", "kind_of", "run", "versions"]
