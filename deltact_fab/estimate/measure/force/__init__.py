"""Force on the sensor from the flow: sets of features, and the model that is linear in them.

A new set is a module with a class that meets `Features` and is made of a `SensorModel`, and one
line in FEATURES.
"""

from __future__ import annotations

from deltact_fab.common import InputError, did_you_mean

from ..sensor_id import SensorModel
from .inverse import Inverse
from .model import Features, ForceModel
from .paper import Paper, Signed, Sums

FORCE_FEATURES = {"sums": Sums, "paper": Paper, "inverse-placed": Inverse}
FORCE_READINGS = {"paper-signed": Signed}
"""Another reading of what the paper says, looked at by studies; no model is made of it."""


def make_features(name: str, view: SensorModel) -> Features:
    """Make the named feature set for a sensor. Raises InputError for an unknown name."""
    if name not in FORCE_FEATURES | FORCE_READINGS:
        raise InputError(f"force features {name!r}: unknown; {did_you_mean(name, FORCE_FEATURES)}")
    return (FORCE_FEATURES | FORCE_READINGS)[name](view)


def load_features(model: ForceModel, view: SensorModel, source: str) -> Features:
    """The set that a model was fitted to.

    Raises InputError, `source` in front, where this version has no such set or other labels.
    """
    try:
        features = make_features(model.features, view)
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    if model.names != tuple(features.names):
        raise InputError(
            f"{source}: not of this version's features {features.name!r}; calibrate again"
        )
    return features
