"""The motion stage: hosts of controllers behind `rig.interface.Stage`."""
