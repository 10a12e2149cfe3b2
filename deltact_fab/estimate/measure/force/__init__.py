"""Force on the sensor from the flow: sets of features, and the model that is linear in them.

A new set is a module with a subclass of `Features` that takes a `SensorModel`, and one line in
FORCE_FEATURES.
"""

from __future__ import annotations

from deltact_fab.common import InputError, did_you_mean

from ..sensor_id import SensorModel
from .inverse import Inverse
from .model import Features, ForceModel
from .paper import Paper, Signed, Sums

FORCE_FEATURES = {"sums": Sums, "paper": Paper, "inverse-placed": Inverse}
FORCE_READINGS = {"paper-signed": Signed}
"""Another reading of the paper, evaluated by studies; never used for a calibration."""


def make_features(name: str, view: SensorModel) -> Features:
    """Make the named feature set for a sensor. Raises InputError for an unknown name."""
    if name not in FORCE_FEATURES | FORCE_READINGS:
        raise InputError(f"force features {name!r}: unknown; {did_you_mean(name, FORCE_FEATURES)}")
    return (FORCE_FEATURES | FORCE_READINGS)[name](view)


def load_features(model: ForceModel, view: SensorModel, source: str) -> Features:
    """Make the feature set that a model was fitted to.

    Raises InputError, prefixed by `source`, if this version has no such set or other labels.
    """
    try:
        features = make_features(model.features, view)
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    if model.names != tuple(features.names):
        raise InputError(f"{source}: features {features.name!r} have changed; calibrate again")
    return features
