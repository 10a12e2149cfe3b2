"""What a lab buys, weighs and waits for: bill of materials, recipes, and the paper's gaps.

None of it needs the CAD kernel.
"""
