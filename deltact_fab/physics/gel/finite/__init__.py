"""The finite-strain level: hexahedra, near-incompressible neo-Hooke, frictional contact.

Reading order: `mesh`, `material`, `assembly`, `linear`, `distance`, `surface`, `newton`, `press`.
"""
