"""The measurement as a robot calls it: images in; flow, shape, force and contact out."""

from .measurement import MarkerMeasurement, Measurement, Pipeline
from .outputs import OUTPUTS, Result
