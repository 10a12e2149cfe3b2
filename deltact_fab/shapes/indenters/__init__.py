"""Indenters by name: a file each family, found by its SHAPES (a factor to an `Indenter`)."""
