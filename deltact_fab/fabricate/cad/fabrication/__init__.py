"""Bill of materials, batches and cure, and the paper's gaps; without the CAD kernel."""
