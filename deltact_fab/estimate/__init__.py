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
    from .analysis.flows import open_follower
    from .analysis.force.calibrate import calibrate, carry_over_calibration, fit_best_model
    from .analysis.force.dataset import force_points, join_points
    from .analysis.force.judge import (
        EvaluatedModel, FORCE_COMPONENTS, FORCE_SPLITS, cross_validated, fit_force,
        force_component, force_figures, judge, presses_needed, root_mean_square,
    )
    from .analysis.force.result import (
        ForceResult, PAPER_CONDITIONS, PAPER_FORCE_TABLE, calibrated_errors,
        write_force_calibration,
    )
    from .analysis.measured import (
        DeepestPress, FORCE_COLUMNS, MeasuredRun, calibrations_of_run, measure_run,
    )
    from .analysis.relaxation import (
        ForceRest, RelaxationFit, find_rests, fit_relaxation, settling_time_s,
    )
    from .analysis.runs import recorded_frames, view_of_run, write_results
    from .analysis.shape.ball import calibrate_depth
    from .analysis.shape.press import PressShape, ShapeMaps, press_shape
    from .analysis.shape.run import (
        SHAPE_GOALS, ShapeResult, add_traction, analyse_shape, deepest_maps,
    )
    from .analysis.tracking_error.follow import (
        DOTS_ONLY_METHODS, Follower, TrackingPlan, analyse_press, analyse_tracking,
        tracking_plan_of,
    )
    from .analysis.tracking_error.result import (
        PAPER_BEST_MM, TRACKING_RULE, TrackingResult, percent_of,
    )
    from .analysis.tracking_error.tally import (
        ErrorTally, PrintedDots, TrueFrame, WRONG_FLOW_MM, imaged_pixels,
    )
    from .measure.face import FACE_SPACING_PX, FaceFlow
    from .measure.flow.fused import Plane
    from .measure.flow.renewed import FLOW_METHODS, FlowMethod, PAPER_METHOD, RENEW_SHARE
    from .measure.flow.tracker import FlowReference, FlowTracker, named_tracker
    from .measure.force import FORCE_FEATURES, FORCE_READINGS, make_features
    from .measure.force.calibration import ForceCalibration, load_force
    from .measure.force.model import ForceModel
    from .measure.health import MAX_DEFORMATION_MM, SeenPattern, check_health, recognise_pattern
    from .measure.hodge import Hodge
    from .measure.lens.calibration import LensCalibration, calibrate_lens, fit_flat_field
    from .measure.pipeline.measurement import MarkerMeasurement, Measurement, Pipeline, Rectifier
    from .measure.pipeline.outputs import MEASURED_OUTPUTS, MeasurementResult
    from .measure.regression import least_squares
    from .measure.sensor_id import (
        CalibrationHead, CalibrationSource, SensorId, SensorModel, read_calibration, read_rest,
        require_same_sensor, rest_table,
    )
    from .measure.shape.density import SIGMA_PX, jacobian_density
    from .measure.shape.depth import ContactRegion, DepthModel
    # fmt: on
else:
    __getattr__, __dir__ = open_door(__name__)
