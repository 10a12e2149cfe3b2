"""The paper's experiments, and better ones: grids of pure jobs whose results become one page."""
