"""The one way in which a press is solved: block, path, what is observed, tolerance -> knots."""
