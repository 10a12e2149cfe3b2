"""Parts as solids: the skin, its frame and the indenters, checked and written as STEP and STL.

design.py reads the tables, registry.py names the parts, parts/ builds one each, checks.py gates
what the kernel returned, mesh.py and export.py write it. cadquery is imported on the first build.
"""
