"""The lens from images of boards: corners, fit, own uncertainty; and the flat field."""
