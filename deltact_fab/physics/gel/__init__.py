"""Gel mechanics: how the skin deforms and pushes back when a rigid indenter moves in it.

`linear` is the small-strain level, `finite` that of finite strain; `level_selection` picks one.
"""
