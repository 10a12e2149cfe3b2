"""The motion stage: hosts of controllers behind `bench.rig.interface.Stage`."""
