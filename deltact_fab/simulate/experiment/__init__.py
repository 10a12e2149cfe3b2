"""Where protocol, sensor and rig meet: checks before motion, then the run and its record."""

__all__ = ["RunRequest", "dry_run", "kind_of", "run", "versions"]
