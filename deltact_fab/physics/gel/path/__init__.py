"""Solution of a press along its path: block, path, observed channels, tolerance -> knots."""
