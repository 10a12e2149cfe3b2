"""Force sensors behind `rig.interface.ForceSensor`, and the guard that stops the stage."""
