"""One file a format: a solid or its mesh to bytes, the same bytes every time.

step.py and dxf.py read the exact solid; stl.py, threemf.py and glb.py its one closed mesh.
"""
