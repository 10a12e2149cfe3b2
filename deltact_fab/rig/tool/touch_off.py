"""One touch-off, by the force sensor or by hand: a feeler gauge drags between tip and face."""

from __future__ import annotations

import math
from contextlib import suppress

from ...aliases import Vector
from ...errors import DeltactFabError, InputError, RunFailed
from ...shapes import Indenter
from ..interface import go, rise
from .config import TouchConfig
from .feeler import ForceProbe
from .operator import Operator
from .touch import LOWERING, MOST, FaceTouch, ForceTouch

STEPS_MM = (1.0, 0.1, 0.01)
HELP = (
    "d: down by one step, u: up, 1 / 0.1 / 0.01: the step in mm, ok: it drags, quit: give it up; "
    "nothing goes below the range that is searched"
)


class HandTouch:
    """Finds the face below a point of it by an operator's jogs, each of a step and no more.

    feeler: ends a jog at MOST times the force of a contact; the guard is armed in it.
    """

    def __init__(self, feeler: ForceProbe, operator: Operator, config: TouchConfig) -> None:
        self._feeler, self._stage = feeler, feeler.stage
        self._operator = operator
        self._config = config

    def find(self, indenter: Indenter, at_mm: tuple[float, float]) -> FaceTouch:
        """Go above the point, let the operator step down, and up again to the height of the start.

        Heights are those of the stage's frame. Raises RunFailed when the operator gives up; the tip
        is lifted then too.
        """
        config = self._config
        x, y, start_mm = self._stage.position_mm()
        high_mm = max(start_mm, config.clear_mm)
        for target_mm in ((x, y, high_mm), (*at_mm, high_mm)):
            go(self._stage, target_mm, self._feed_mm_min)
        self._feeler.tare()
        self._feeler.release()
        self._go((*at_mm, config.clear_mm))
        self._operator.tell(
            f"{indenter.name}: {config.clear_mm:g} mm above the height expected; step down until a "
            f"gauge of {config.gauge_mm:g} mm drags. {HELP}"
        )
        try:
            found = [self._once(indenter, at_mm) for _ in range(config.repeats)]
        finally:
            with suppress(DeltactFabError):  # the first error is the one to tell
                self._feeler.release()
            with suppress(DeltactFabError):
                rise(self._stage, high_mm, self._feed_mm_min)
        spread_mm = max(found) - min(found)
        if spread_mm > max(config.spread_mm, STEPS_MM[-1]):
            raise RunFailed(
                f"touch-off of {indenter.name}: {len(found)} touches lie {spread_mm:.3f} mm apart, "
                f"at most {config.spread_mm:g} (touch.spread_mm); begin again"
            )
        z_mm = sum(found) / len(found) - config.gauge_mm
        return FaceTouch("hand", at_mm, round(z_mm, 4), round(spread_mm, 4), len(found))

    def _once(self, indenter: Indenter, at_mm: tuple[float, float]) -> float:
        """One touch; height of the tip when the operator says that it drags."""
        step_mm = STEPS_MM[0]
        while True:
            z = self._stage.position_mm()[2]
            answer = self._operator.ask(f"{indenter.name} at {z:+.3f} mm, step {step_mm:g} mm")
            if answer == "ok":
                if z > self._config.search_mm + self._config.gauge_mm:
                    self._operator.tell(
                        f"{z:.2f} mm is above the range of {self._config.search_mm:g} mm that is "
                        "searched: another indenter, or [tools] is wrong"
                    )
                    continue
                self._go((*at_mm, z + STEPS_MM[0]), up=True)
                return z
            if answer == "quit":
                raise RunFailed(f"touch-off of {indenter.name}: given up by the operator")
            if answer in ("d", "u"):
                to_mm = z + step_mm * (1 if answer == "u" else -1)
                if to_mm < -self._config.search_mm:
                    self._operator.tell(
                        f"not below -{self._config.search_mm:g} mm: touch.search_mm"
                    )
                elif to_mm <= self._config.clear_mm + STEPS_MM[0]:
                    self._go((*at_mm, to_mm), up=answer == "u")
                continue
            if answer in [f"{s:g}" for s in STEPS_MM]:
                step_mm = float(answer)
                continue
            self._operator.tell(HELP)

    @property
    def _feed_mm_min(self) -> float:
        return self._config.feed_mm_min * LOWERING

    def _go(self, target_mm: Vector, up: bool = False) -> None:
        """A jog; on the way up only the guard may end it."""
        limit_n = math.inf if up else MOST * self._config.force_n
        self._feeler.resume()  # nobody reads it while the operator thinks
        if self._feeler.move(target_mm, self._feed_mm_min, limit_n):
            self._operator.tell(f"stopped by a force of more than {limit_n:g} N")
        self._feeler.release()


def find_face(
    feeler: ForceProbe,
    config: TouchConfig,
    operator: Operator | None,
    indenter: Indenter,
    at_mm: tuple[float, float],
) -> FaceTouch:
    """Where the face is below a point of it (mm, the stage's frame). operator: None is nobody.

    Raises InputError, RunFailed, SensorError, StageError.
    """
    if config.by == "force":
        return ForceTouch(feeler, config).find(indenter, at_mm)
    if operator is None:
        raise InputError("touch.by = 'hand' needs somebody there: not with --unattended")
    return HandTouch(feeler, operator, config).find(indenter, at_mm)
