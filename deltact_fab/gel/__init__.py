"""Gel mechanics: how the skin deforms and pushes back when a rigid indenter moves in it.

Level one is the linear bonded layer: `BondedLayer` (tractions to displacement) and `LayerContact`
(one indenter, state to state). `reference` holds the solutions they are measured against.
"""
