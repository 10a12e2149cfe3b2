"""Checks before motion, then the run of a protocol on a rig and its record."""

__all__ = ["RunRequest", "dry_run", "kind_of", "run", "versions"]
