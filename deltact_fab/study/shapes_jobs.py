"""The jobs of the study of shapes: the gel of a press, calibrations, presses of an object.

Each runs its protocol on the virtual rig into a folder of its own that ends with the job, and keeps
what the page draws and counts. Protocols, rig and calibrations come as data, so that no job depends
on a file of who asks.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from .. import catalog, experiment, jobs, record
from ..analysis.force.calibrate import calibrate
from ..analysis.shape import calibrate_depth, press_shape
from ..analysis.shape.run import UNCALIBRATED
from ..cad.design import load_design
from ..measure.force.calibration import load_force
from ..measure.shape import DepthModel
from ..protocols.plan import Protocol
from ..rig.config import RigConfig
from ..rig.interface import presses_of
from ..virtual.presses import Presses, path_of

FORCE_MODEL = "inverse-placed"
"""That `analyze force` picks on every run so far, and the only kind that says where (with
`inverse`): decision 0024."""
