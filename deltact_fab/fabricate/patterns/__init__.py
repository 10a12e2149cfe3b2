"""Patterns: from a recipe to patches, dots, the printer's file and a virtual sticker."""
