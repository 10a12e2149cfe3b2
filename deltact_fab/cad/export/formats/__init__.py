"""One file a format: a solid or its mesh to bytes, the same bytes every time.

step.py and dxf.py read the exact solid, meshes.py (STL, 3MF, GLB) its one closed mesh.
"""
