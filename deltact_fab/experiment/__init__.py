"""Where protocol, sensor and rig meet: checks before motion, then the run and its record."""

from ..aliases import Progress
from .kinds import kind_of
from .meta import versions
from .preview import checks, forces, show
from .session import dry_run, run

__all__ = ["Progress", "checks", "dry_run", "forces", "kind_of", "run", "show", "versions"]
