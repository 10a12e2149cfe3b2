"""Force sensors behind `bench.rig.interface.ForceSensor`, and the guard that stops the stage."""
