"""Technical drawing: the sheet, dimensions around a view, and what is dimensioned on each part."""
