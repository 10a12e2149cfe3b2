"""Tracking error of flow: at the dots as in the paper, and off the dots against truth.

The paper's error (Eq. 7) compares the flow with the white dots, which are features themselves and
flatter the flow; on a virtual rig the truth is known everywhere, so the error of the pattern
between the dots is given too. Definitions: docs/decisions/0004-tracking-error.md.
"""
