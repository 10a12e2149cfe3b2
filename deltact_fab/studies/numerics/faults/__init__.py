"""Faults at each moment of a run: the real host, runner and record, in lockstep simulation.

`simulate.FaultBench` is the simulated bench, `kinds` the faults, `rehearsal` the matrix.
"""
