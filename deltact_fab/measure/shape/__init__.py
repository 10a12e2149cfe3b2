"""Shape of the contact from the flow: density, relative depth, depth in mm, separate contacts."""

from .density import Density, by_jacobian, relative_depth
from .depth import ContactRegion, Depth, DepthFinder, DepthModel, contact_labels, contacts
