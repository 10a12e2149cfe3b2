"""The force guard: it stops the stage itself, and asks nobody."""

from __future__ import annotations

from ..interface import ForceSamples, Stage
from .config import GuardConfig


class ForceGuard:
    """Looks at every sample before anyone else does; may live in any thread, for it only writes.

    tripped: why it stopped the stage, "" while it has not.
    """

    def __init__(self, stage: Stage, limits: GuardConfig) -> None:
        self._stage = stage
        self._limits = limits
        self.tripped = ""

    def watch(self, samples: ForceSamples) -> None:
        """Write the stop byte if a sample is over the limit or saturated."""
        peak_n = float(abs(samples.force_n).max(initial=0.0))
        if samples.saturated.any() or peak_n > self._limits.force_n:
            self._stage.cancel()
            if not self.tripped:
                what = "saturated" if samples.saturated.any() else f"{peak_n:.2f} N"
                self.tripped = f"force {what}, over the guard's {self._limits.force_n:g} N"
