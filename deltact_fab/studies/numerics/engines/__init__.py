"""The engines: a module with `ENGINE`, and its name in `harness.REGISTRY`."""
