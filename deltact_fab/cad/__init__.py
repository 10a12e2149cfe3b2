"""Parts as solids: sensor, mold, bench and indenters, checked, drawn and written to files.

dimensions/ and rules/ say what may be built, registry.py names the parts, parts/ builds one each,
build.py gates what the kernel returned, assembly.py puts the sensor together. check/ holds the
solids against what the sensor needs; export/ writes them, drafting/ draws them, making/ says what
to buy, weigh and wait for. cadquery is imported on the first build.
"""
