"""Benchmark of the numerical engines: error against run time, and stiff and extreme cases.

An engine is a module in `engines` with a frozen `ENGINE`, and a name in `harness.ENGINE_MODULES`.
"""
