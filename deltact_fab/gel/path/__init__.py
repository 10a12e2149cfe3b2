"""The one way in which a press is solved: block, path, what is observed, tolerance -> trajectory.

Reading order: `knots` (poses in, solved knots out), `mirror`, `store`, `solver`, `open`.
"""
