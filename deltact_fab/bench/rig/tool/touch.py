"""Touch-off by force: approach until contact, back off, and approach again by steps.

Only short jogs are sent: if the host dies, the tip moves by DESCENT_STRIDE_MM at most. The first
approach locates the face roughly. The second one goes down from just above by TOUCH_STEP_MM, rests,
and takes the mean force; the height of the face is fitted to these, independent of threshold and
delays. Only the fitted approach is repeated and compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from deltact_fab.common import DeltactFabError, Field, Point, SensorError, StageError
from deltact_fab.sensor import EllipsoidTip, Indenter, SphereTip

from ...protocols.motion import WALL_CLOCK_PACE, StageConfig, move_duration_s
from ..interface import move_to
from ..run.contact import eased, end_contact
from ..tables import TouchConfig
from .feeler import PROBE_TARE_S, ForceProbe, rest_duration_s

# Decision 0033; by hand: finer steps and more poses fit better, and take longer and go deeper.
DESCENT_STRIDE_MM = 0.5
TOUCH_STEP_MM = 0.01
BACK_OFF_MM = 0.2  # one step back from the face
MAX_BACK_OFFS = 10
STEP_START_MM = 0.1  # above the face, where the steps begin
LOWERING_RATIO = 4.0  # feed above the approach, relative to its feed
TRAVEL_FEED_MM_MIN = 300.0
MIN_NOISE_RATIO = 5.0  # threshold over the noise
MIN_CONTACT_POSES = 3  # below the face
MAX_FORCE_RATIO = 5.0  # largest force over the threshold, however few the poses
MAX_UNSEEN_MM = 0.3  # from a contact to its stop
CANDIDATE_COUNT = 200
SEARCH_ROUNDS = 4


@dataclass(frozen=True)
class FaceTouch:
    """Result of a touch-off with its uncertainty.

    z_mm: height of the face at at_mm, in the stage's frame of then. spread_mm: between repeats.
    """

    by: str
    at_mm: tuple[float, float]
    z_mm: float
    spread_mm: float
    repeats: int
    noise_n: float | None = None
    residual_n: float | None = None
    most_n: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {key: value for key, value in asdict(self).items() if value is not None}

    def line(self) -> str:
        """Return a summary for the operator."""
        peak = "" if self.most_n is None else f", peak force {self.most_n:.2f} N"
        return f"{self.z_mm:+.3f} mm from the expected height, {self.repeats} touches within " + (
            f"{self.spread_mm:.3f} mm, by {self.by}{peak}"
        )


def tool_change_s(
    stage: StageConfig, touch: TouchConfig | None, park_mm: float, sample_s: float
) -> float:
    """Duration of `ForceTouch.find` from the height of a change and back; 0 without [touch].

    Assumes the face at its expected height. sample_s: period of the force sensor.
    """
    if touch is None:
        return 0.0
    feed, high_mm = touch.feed_mm_min, max(park_mm, touch.clear_mm)
    stride_mm, low_mm = DESCENT_STRIDE_MM, touch.clear_mm
    steps = round((BACK_OFF_MM + STEP_START_MM) / TOUCH_STEP_MM) + MIN_CONTACT_POSES
    moves = (  # how many, how far, how fast, period of looks
        ((high_mm - low_mm) / stride_mm, stride_mm, LOWERING_RATIO * feed, sample_s),
        (low_mm / stride_mm, stride_mm, feed, sample_s),
        (touch.repeats, BACK_OFF_MM, TRAVEL_FEED_MM_MIN, 0.0),
        (touch.repeats, STEP_START_MM, TRAVEL_FEED_MM_MIN, 0.0),
        (touch.repeats * steps, TOUCH_STEP_MM, feed, sample_s),
        (1, high_mm, TRAVEL_FEED_MM_MIN, 0.0),
    )
    limits = stage.max_feed_mm_min, stage.acceleration_mm_s2
    moving_s = 0.0
    for n, length_mm, feed_mm_min, look_s in moves:  # a look waits for a sample, the last at rest
        move_s = move_duration_s((0, 0, length_mm), feed_mm_min, *limits) + WALL_CLOCK_PACE.move_s
        moving_s += n * (max(move_s, look_s) + look_s)
    return PROBE_TARE_S + moving_s + touch.repeats * (steps + 1) * rest_duration_s(sample_s)


class ForceTouch:
    """Finds the height of the face at one point with the mounted indenter."""

    def __init__(self, feeler: ForceProbe, config: TouchConfig) -> None:
        self._feeler, self._stage = feeler, feeler.stage
        self._config = config

    def find(self, indenter: Indenter, at_mm: tuple[float, float]) -> FaceTouch:
        """Go to the point, touch as often as configured, and return to the initial height.

        Heights are in the stage's frame, z = 0 at the expected face. Raises SensorError, one line,
        for no contact, contact too early, or heights that differ; the tip is lifted then too,
        unless the stage failed.
        """
        x, y, start_mm = self._stage.position_mm()
        high_mm = max(start_mm, self._config.clear_mm)
        feeler = self._feeler
        try:
            noise_n = self._tare((x, y), at_mm, high_mm)
            contacts = self._touch_face(indenter, at_mm)
        except StageError:
            raise
        except BaseException as error:
            lifted = self._retreat(high_mm)
            if isinstance(error, DeltactFabError):
                raise type(error)(f"touch-off of {indenter.name}: {error}; {lifted}") from error
            raise
        finally:
            with suppress(DeltactFabError):  # keep the first error
                feeler.release()
        self._go((*at_mm, high_mm))
        heights = [contact.z_mm for contact in contacts]
        spread_mm = max(heights) - min(heights)
        if spread_mm > self._config.spread_mm:
            raise SensorError(
                f"touch-off of {indenter.name}: {len(heights)} touches differ by {spread_mm:.3f} "
                f"mm, more than touch.spread_mm = {self._config.spread_mm:g}: check for a loose "
                "indenter or sensor"
            )
        return FaceTouch(
            "force", at_mm, round(sum(heights) / len(heights), 4), round(spread_mm, 4),
            len(heights), round(noise_n, 5), round(max(c.residual_n for c in contacts), 5),
            round(feeler.peak_n, 3),
        )  # fmt: skip

    def _tare(
        self, start: tuple[float, float], at_mm: tuple[float, float], high_mm: float
    ) -> float:
        """Go above the point and tare; return the noise (N)."""
        self._go((*start, high_mm))
        self._go((*at_mm, high_mm))
        noise_n = self._feeler.tare()
        if noise_n * MIN_NOISE_RATIO > self._config.force_n:
            raise SensorError(
                f"the sensor's noise is {noise_n:.3f} N (1 sigma), too much for touch.force_n = "
                f"{self._config.force_n:g} N; set at least {noise_n * MIN_NOISE_RATIO:.2g} N, or "
                "remove vibrations"
            )
        delay_s, feed = self._feeler.delay_s(), self._config.feed_mm_min
        if (unseen_mm := delay_s * feed / 60) > MAX_UNSEEN_MM:
            raise SensorError(
                f"the link is too slow: a stop comes {delay_s:.2f} s after the contact, "
                f"{unseen_mm:.2f} mm deeper at touch.feed_mm_min = {feed:g}; set at most "
                f"{int(MAX_UNSEEN_MM / delay_s * 60)}, or use a quicker cable or force sensor"
            )
        return noise_n

    def _touch_face(self, indenter: Indenter, at_mm: tuple[float, float]) -> list[ContactFit]:
        config = self._config
        if self._descend(at_mm, config.clear_mm, config.feed_mm_min * LOWERING_RATIO):
            self._raise_too_early()
        if self._descend(at_mm, config.search_mm, config.feed_mm_min):
            self._raise_too_early()
        if not self._descend(at_mm, -config.search_mm, config.feed_mm_min):
            raise SensorError(
                f"no contact down to {config.search_mm:g} mm below the expected height "
                f"(touch.search_mm), peak force {self._feeler.peak_n:.3f} N; is the indenter "
                "shorter than in [tools], or the sensor missing?"
            )
        self._require_a_press()
        contacts = []
        for _ in range(config.repeats):
            self._back_off()
            contacts.append(self._step_down(powers_of(indenter)))
        return contacts

    def _descend(self, at_mm: tuple[float, float], to_mm: float, feed_mm_min: float) -> bool:
        """Go down by strides; return True at the first contact."""
        z = self._stage.position_mm()[2]
        while z > to_mm + 1e-3:
            z = max(z - DESCENT_STRIDE_MM, to_mm)
            if self._feeler.move((*at_mm, z), feed_mm_min, self._config.force_n):
                return True
        return False

    def _raise_too_early(self) -> None:
        z = self._stage.position_mm()[2]
        raise SensorError(
            f"contact {z:.2f} mm above the expected height, more than touch.search_mm = "
            f"{self._config.search_mm:g}; is the indenter longer than in [tools], or something "
            "in the way?"
        )

    def _require_a_press(self) -> None:
        force = self._feeler.at_rest()
        if -force[2] < 0.5 * float((force**2).sum()) ** 0.5:
            raise SensorError(
                "the contact does not press along -z, force ({:.2f}, {:.2f}, {:.2f}) N: the "
                "sensor's axes differ, or the indenter touched something else".format(*force)
            )

    def _back_off(self) -> None:
        """Go up until there is no force, and a little more."""
        for _ in range(MAX_BACK_OFFS):
            x, y, z = self._stage.position_mm()
            self._go((x, y, z + BACK_OFF_MM))
            if abs(self._feeler.at_rest()[2]) < 0.1 * self._config.force_n:
                self._go((x, y, z + BACK_OFF_MM + STEP_START_MM))
                return
        force = self._feeler.at_rest()[2]
        raise SensorError(
            f"the force is still {-force:.3f} N {MAX_BACK_OFFS * BACK_OFF_MM:g} mm above the "
            "contact: the sensor drifts, or the gel sticks to the indenter"
        )

    def _step_down(self, powers: tuple[float, ...]) -> ContactFit:
        """Go down by steps through the face; return its fitted height."""
        config = self._config
        heights: list[float] = []
        forces: list[float] = []
        n_deep = 0
        while True:
            x, y, z = self._stage.position_mm()
            heights.append(z)
            forces.append(-float(self._feeler.at_rest()[2]))
            n_deep += forces[-1] > 0.2 * config.force_n
            contact = forces[-1] > config.force_n
            if contact and (n_deep >= MIN_CONTACT_POSES or self._next_step_exceeds_limit(forces)):
                return fit_contact(heights, forces, powers)
            if z - TOUCH_STEP_MM < -config.search_mm - TOUCH_STEP_MM / 2:
                raise SensorError(
                    f"{forces[-1]:.3f} N at the lowest height (touch.search_mm = "
                    f"{config.search_mm:g}), where {config.force_n:g} N was measured before"
                )
            max_n = MAX_FORCE_RATIO * config.force_n
            self._feeler.move((x, y, z - TOUCH_STEP_MM), config.feed_mm_min, max_n)

    def _next_step_exceeds_limit(self, forces: list[float]) -> bool:
        """True if another step as stiff as the last would exceed the force limit."""
        return 2 * forces[-1] - forces[-2] > MAX_FORCE_RATIO * self._config.force_n

    def _go(self, target_mm: Point) -> None:
        move_to(self._stage, target_mm, TRAVEL_FEED_MM_MIN)

    def _retreat(self, high_mm: float) -> str:
        """End the contact; return the outcome."""
        with eased(self._feeler.guard), self._feeler.restarted_force() as felt_n:
            return end_contact(self._stage, felt_n, self._config.force_n, high_mm)


@dataclass(frozen=True)
class ContactFit:
    """Height of the face (mm), exponent of the force over depth, and RMS residual (N)."""

    z_mm: float
    power: float
    residual_n: float


def powers_of(indenter: Indenter) -> tuple[float, ...]:
    """Candidate exponents of the force over depth for an indenter.

    1.5 for a ball (Hertz), 1 for a flat one, and between for one that touches by an edge first.
    """
    if all(isinstance(tip, SphereTip | EllipsoidTip) for tip in indenter.tips):
        return (1.5,)
    return (1.0, 1.25, 1.5)


def fit_contact(
    z_mm: Sequence[float], force_n: Sequence[float], powers: Sequence[float]
) -> ContactFit:
    """Fit the height z0 of the face: force b + a (z0 - z)^power below z0, b above.

    z_mm, force_n: (n,) going down, the first ones clear of the face. a and b follow from z0 by
    least squares, so that only z0 is searched. With a single pose below the face only the interval
    above it is known, and its middle is returned.
    """
    z, force = np.asarray(z_mm, float), np.asarray(force_n, float)
    fits = [_fit_power(z, force, power) for power in powers]
    return min(fits, key=lambda contact: contact.residual_n)


def _fit_power(z: Field, force: Field, power: float) -> ContactFit:
    low, high = float(z.min()), float(z.max())
    z_mm, residual = high, np.inf
    for _ in range(SEARCH_ROUNDS):
        candidates = np.linspace(low, high, CANDIDATE_COUNT)
        residual_n2 = _residual_n2(z, force, power, candidates)
        k = int(np.argmin(residual_n2))
        # The residual is constant over an interval without a pose.
        best = candidates[residual_n2 <= residual_n2[k] * (1 + 1e-9)]
        z_mm, residual = float(best.mean()), float(residual_n2[k])
        step = candidates[1] - candidates[0]
        low, high = float(best[0] - step), float(best[-1] + step)
    return ContactFit(z_mm, power, float(np.sqrt(residual / len(z))))


def _residual_n2(z: Field, force: Field, power: float, candidates: Field) -> Field:
    """Residual sum of squares for each candidate height (m,) of the face."""
    shape = np.maximum(candidates[:, None] - z, 0.0) ** power  # (m, n)
    shape = shape - shape.mean(axis=1, keepdims=True)
    about = force - force.mean()
    size = (shape**2).sum(axis=1)
    along = np.maximum(shape @ about, 0.0)  # tension is no contact
    gain = np.divide(along**2, size, out=np.zeros_like(size), where=size > 0)
    return np.asarray(np.maximum((about**2).sum() - gain, 0.0))
