"""Measurements from images alone, and what recorded runs tell of their errors.

Nothing here may import `physics`, `simulate` or `fabricate`, not even indirectly: what a simulation
knows cannot leak into an estimate.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltact_fab.door import open_door

if TYPE_CHECKING:
    # isort: off
    # fmt: off
    from .analysis.comparison import Comparison
    from .analysis.difference import UnitDifference
    from .analysis.flows import open_follower
    from .analysis.force.calibrate import (
        calibrate as calibrate_force, fit_best_model, transfer_calibration, validate_partly,
    )
    from .analysis.force.dataset import gather_points, measure_force_points
    from .analysis.force.judge import fit_model
    from .analysis.force.result import ForceResult, write_force_calibration
    from .analysis.intervals import MIN_GROUPS, Interval
    from .analysis.measured import DeepestPress, RunMeasurement, find_calibrations, measure_run
    from .analysis.relaxation import ForceRest, StraightPress, RelaxationFit
    from .analysis.runs import write_results
    from .analysis.shape.ball import calibrate_depth
    from .analysis.shape.press import PressShape, ShapeMaps, measure_press
    from .analysis.shape.run import ShapeResult, analyse_shape
    from .analysis.tracking_error.follow import (
        Follower, TrackingPlan, analyse_tracking,
    )
    from .analysis.tracking_error.result import TrackingResult
    from .analysis.tracking_error.tally import PatternDots, TrueFrame
    from .measure.face import FaceFlow
    from .measure.flow.renewed import FlowMethod
    from .measure.flow.tracker import FlowTracker
    from .measure.force import make_features
    from .measure.force.calibration import ForceCalibration
    from .measure.force.model import ForceModel
    from .measure.health import Health, RestPattern
    from .measure.hodge import Hodge
    from .measure.lens.calibration import LensCalibration, calibrate_lens, fit_flat_field
    from .measure.pipeline.measurement import Measurement, Pipeline, Rectifier
    from .measure.pipeline.outputs import MeasurementResult
    from .measure.regression import least_squares
    from .measure.sensor_id import SensorModel, format_acceptance, read_acceptance
    from .measure.shape.density import SIGMA_PX, jacobian_density
    from .measure.shape.depth import ContactRegion, DepthFinder, DepthModel
    # fmt: on
else:
    __getattr__, __dir__ = open_door(__name__)
