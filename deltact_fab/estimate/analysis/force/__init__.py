"""Force calibration by regression, and its cross-validation.

Points are the settled frames of runs: features of the flow (`estimate.measure.force`) against the
measured wrench. Models are ranked by their error on unseen positions and indenters, which a random
split hides (decision 0026).
"""
