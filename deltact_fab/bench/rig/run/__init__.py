"""Carrying out the steps of a protocol: runner, its streams, signals."""
