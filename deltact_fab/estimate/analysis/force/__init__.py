"""The regression that calibrates the force, and what it may be trusted to.

Points are the settled frames of runs: features of the flow (`estimate.measure.force`) against the
wrench that was measured. Models are ranked by how they predict positions and indenters that they
never saw, for a random split hides that (decision 0026).
"""
