"""Parts as solids: sensor, mold, bench and indenters, checked, drawn and written to files.

A part stands in one file of parts/, alone or beside what it goes with: its solid, its inequalities,
its drawing's callouts, how it is made (part.py says what that takes). registry.py finds it there.
dimensions.py collects a design and the lengths that parts share, feasibility.py all inequalities;
kernel.py gates what the kernel returned, assembly.py puts the sensor together. check/ holds the
solids against what the sensor needs; export/ writes them, drafting/ draws them, fabrication/ says
what to buy, weigh and wait for. cadquery is imported on the first build.
"""
