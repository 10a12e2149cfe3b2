"""Patterns: a recipe becomes patches, dots, a printer's file and a virtual sticker's colours."""
