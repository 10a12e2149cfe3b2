"""One sensor drawn from the population of a virtual rig: what it has other than its design.

It is what the rig solves and renders. The record has the design; `truth/sensor.json` has this.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from deltact_fab.bench import Protocol, VirtualConfig
from deltact_fab.common import InputError, Point2
from deltact_fab.physics import poisson_limit
from deltact_fab.sensor import Fisheye, Pinhole, Printer, SkinDimensions

MAX_DEVIATIONS = 3.0  # by hand: a sensor further off is not accepted


@dataclass(frozen=True)
class SensorDraw:
    """Deviations of a sensor from its design, by the keys of `[virtual.population]`.

    modulus, light: factors. The camera's tilt is about x, then about y.
    """

    number: int | None = None
    modulus: float = 1.0
    poisson: float = 0.0
    thickness_mm: float = 0.0
    sticker_mm: Point2 = (0.0, 0.0)
    sticker_deg: float = 0.0
    spread_um: float = 0.0
    light: float = 1.0
    camera_mm: Point2 = (0.0, 0.0)
    camera_height_mm: float = 0.0
    camera_roll_deg: float = 0.0
    camera_tilt_deg: Point2 = (0.0, 0.0)

    @classmethod
    def from_population(cls, config: VirtualConfig, number: int | None, source: str) -> SensorDraw:
        """Draw a sensor of a rig; None: the nominal one. The number alone decides its deviations.

        source: of the rig file. Raises InputError without a population.
        """
        population = config.virtual.population
        if number is None:
            return cls()
        if population is None:
            raise InputError(f"--sensor: {number}; {source} has no [virtual.population]")
        values: dict[str, Any] = {}
        for key, deviation in population.model_dump().items():
            # A stream per key: another key more changes no value.
            rng = np.random.default_rng(np.random.SeedSequence([number, zlib.crc32(key.encode())]))
            normal = np.clip(rng.standard_normal(2), -MAX_DEVIATIONS, MAX_DEVIATIONS)
            x, y = (deviation * normal).tolist()
            nominal = cls.__dataclass_fields__[key].default
            values[key] = (x, y) if isinstance(nominal, tuple) else math.exp(x) if nominal else x
        return cls(number, **values)

    def truth(self, protocol: Protocol, skin: SkinDimensions) -> dict[str, Any]:
        """Return the deviations, and the gel that results from them, as plain data."""
        gel = self.protocol(protocol).specimen.model_dump(include={"modulus_mpa", "poisson"})
        gel["thickness_mm"] = self.skin(skin).thickness_mm
        deviations = asdict(self)
        return {"number": deviations.pop("number"), "deviations": deviations, "gel": gel}

    def protocol(self, protocol: Protocol) -> Protocol:
        """Return the protocol with the gel of this sensor."""
        specimen = protocol.specimen
        limit = poisson_limit(specimen.gel_model)
        gel = {
            "modulus_mpa": specimen.modulus_mpa * self.modulus,
            "poisson": min(max(specimen.poisson + self.poisson, 0.0), max(limit, specimen.poisson)),
        }
        return protocol.model_copy(update={"specimen": specimen.model_copy(update=gel)})

    def skin(self, skin: SkinDimensions) -> SkinDimensions:
        """Return the skin of this sensor, at least as thick as it protrudes."""
        thickness_mm = max(skin.thickness_mm + self.thickness_mm, skin.protrusion_mm)
        return replace(skin, thickness_mm=thickness_mm)

    def printer(self, printer: Printer) -> Printer:
        """Return the printer that made this sensor's sticker."""
        return replace(printer, spread_um=max(printer.spread_um + self.spread_um, 0.0))

    def camera(self, nominal: Fisheye | Pinhole) -> Fisheye | Pinhole:
        """Return the camera of this sensor. Raises InputError for one that cannot be."""
        (x, y), (tilt_x, tilt_y), roll = self.camera_mm, self.camera_tilt_deg, self.camera_roll_deg
        air_mm, gel_mm = self.camera_height_mm, self.thickness_mm
        if not any((x, y, tilt_x, tilt_y, roll, air_mm, gel_mm)):
            return nominal
        try:
            if isinstance(nominal, Pinhole):
                return nominal.with_pose((x, y), air_mm, gel_mm, roll)
            return replace(
                nominal, x0_mm=nominal.x0_mm + x, y0_mm=nominal.y0_mm + y,
                roll_deg=nominal.roll_deg + roll, tilt_x_deg=nominal.tilt_x_deg + tilt_x,
                tilt_y_deg=nominal.tilt_y_deg + tilt_y, air_gap_mm=nominal.air_gap_mm + air_mm,
                gel_mm=nominal.gel_mm + gel_mm,
            )  # fmt: skip
        except ValueError as error:
            raise InputError(f"virtual.population: sensor {self.number}: {error}") from error


NOMINAL_SENSOR = SensorDraw()
