"""What a lab buys, weighs and waits for, and the paper's gaps; none needs the CAD kernel."""
