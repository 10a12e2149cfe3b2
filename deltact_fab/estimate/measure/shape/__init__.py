"""Shape of the contact from the flow: density, relative depth, depth in mm, separate contacts."""
