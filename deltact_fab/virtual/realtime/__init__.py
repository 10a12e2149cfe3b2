"""The virtual bench on the wall clock, in a process of its own, reached through real wires only."""
