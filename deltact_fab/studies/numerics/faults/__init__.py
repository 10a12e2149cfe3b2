"""What a fault does to a run, at each moment of it: the real host, runner and record in lockstep.

`simulate.FaultBench` is what they drive, `kinds` the faults, `rehearsal` each at each moment.
"""
