"""Linear elasticity of the gel's face: tractions in, displacements out, whatever presses.

`layer.BondedLayer` is the periodic bonded layer in closed form, `block.FreeBlock` the block with
free sides, on top of it. `gel` solves contacts with the block; `measure` inverts it
(`block.FaceCells`).
"""
