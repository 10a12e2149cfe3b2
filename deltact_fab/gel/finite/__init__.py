"""The finite-strain level: hexahedra, near-incompressible neo-Hooke, frictional contact.

Reading order: `mesh`, `material`, `assembly`, `linear`, `distance`, `surface`, `newton`, `press`.
"""

from .mesh import HexMesh, block_mesh
from .press import FinitePress, FiniteState
