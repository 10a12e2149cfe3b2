"""Linear elasticity of the gel's face: tractions in, displacements out, whatever presses.

`layer.BondedLayer` is the periodic bonded layer in closed form, `block.FreeBlock` the block with
free sides. `gel` solves contacts with them; `measure` inverts them.
"""

from .material import GelMaterial

__all__ = ["GelMaterial"]
