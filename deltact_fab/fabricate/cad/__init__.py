"""Parts as solids: sensor, mold, bench and indenters, checked, drawn and written to files.

Each part is defined in one file of parts/: solid, inequalities, drawing callouts, manufacture (see
part.py). registry.py picks the files up. dimensions.py holds a design and shared lengths,
feasibility.py all inequalities; kernel.py gates the kernel's solids, assembly.py positions the
parts. check/ compares the solids with the sensor's requirements; export/ writes files, drafting/
makes drawings, fabrication/ the bill of materials and batches. cadquery is imported on the first
build.
"""
