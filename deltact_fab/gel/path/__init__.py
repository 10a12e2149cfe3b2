"""The one way in which a press is solved: block, path, what is observed, tolerance -> knots.

Reading order: `knots` (poses in, solved knots out, mirror images), `solver`, `open`.
"""
