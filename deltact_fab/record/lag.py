"""How much later than the images a force record is stamped: told by the two moving together.

For each lag the force is fitted by a few sums of the picture's flow, as the simplest force model
does it, and the lag of the best fit is taken: one that is off leaves a loop between in and out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..aliases import Array, Image

_REACH_S, _REACH_FRAMES = 0.6, 5
"""How far is looked: so long, or so many frames where they are farther apart."""
_PER_FRAME, _MOST = 10, 400  # steps of the search between two frames, and in all
_LIMIT = 3.84  # of twice the log likelihood ratio: 95 % of its interval
_LEAST_R2, _FEWEST = 0.5, 40  # of the force told by the motion, of images
_SMALL_PX = 320  # wide: enough for the mean motion of an image


@dataclass(frozen=True)
class Lag:
    """lag_s: of the force behind the images; between_s: interval of 95 %; frame_s: a frame's time.

    None where it is not told, for the reason why. r2: of the force, told by the motion at its best.
    """

    lag_s: float | None = None
    between_s: tuple[float, float] | None = None
    frame_s: float = 0.0
    r2: float | None = None
    why: str = ""

    @property
    def line(self) -> str:
        """In a sentence."""
        if self.lag_s is None or self.between_s is None:
            return f"how long the force lags behind the images is not told: {self.why}"
        low, high = self.between_s
        words = "less than a frame"
        if abs(self.lag_s) > self.frame_s:
            words = f"{self.lag_s / self.frame_s:.1f} frames; `lag_s` under [force] takes it off"
        return (
            f"the force lags {1e3 * self.lag_s:.0f} ms behind the images "
            f"({1e3 * low:.0f} to {1e3 * high:.0f} ms): {words}"
        )


def motion() -> Callable[[Image], Array]:
    """What gives the motion of the picture since the first image that it was given, (4,) px.

    Means over the picture: to the right, down, of its size, and outwards from the middle.
    """
    import cv2

    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    first: list[Array] = []

    def moved_px(image: Image) -> Array:
        scale = min(1.0, _SMALL_PX / image.shape[1])
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        first.append(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
        small = first[0] if len(first) == 1 else first.pop()
        way = dis.calc(first[0], small, np.zeros((*small.shape, 2), np.float32)) / scale
        u, v = way[..., 0], way[..., 1]
        x, y = (np.linspace(-1, 1, n) for n in reversed(small.shape))
        outwards = (u * x + v * y[:, None]).mean()
        return np.array([u.mean(), v.mean(), np.hypot(u, v).mean(), outwards], float)

    return moved_px


def lag_of(t_s: Array, moved_px: Array, force_t_s: Array, force_n: Array) -> Lag:
    """Of images at t_s (n,) with their motion (n, 4), and force_n (m, k) at force_t_s (m,)."""
    every_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 1.0
    reach_s = max(_REACH_S, _REACH_FRAMES * every_s)
    inside = (t_s - reach_s >= force_t_s[0]) & (t_s + reach_s <= force_t_s[-1])
    at, moved = t_s[inside], moved_px[inside]
    if len(at) < _FEWEST:
        why = f"{len(at)} images have force {reach_s:.1f} s before and after; {_FEWEST} are needed"
        return Lag(why=why)
    most = min(_MOST // 2, round(_PER_FRAME * reach_s / every_s))
    lags, step_s = np.linspace(-reach_s, reach_s, 2 * most + 1, retstep=True)
    force = np.array([[np.interp(at + lag, force_t_s, f) for f in force_n.T] for lag in lags])
    force -= force.mean(axis=-1, keepdims=True)
    basis, _ = np.linalg.qr(moved - moved.mean(axis=0))
    off = force - (force @ basis) @ basis.T
    left = (off**2).sum(axis=(1, 2)) / np.maximum((force**2).sum(axis=(1, 2)), 1e-12)
    best = int(left.argmin())
    # Errors that follow each other make fewer of the images news.
    e = off[best]
    follow = float(np.clip((e[:, 1:] * e[:, :-1]).sum() / max((e**2).sum(), 1e-12), 0, 0.99))
    news = len(at) * (1 - follow) / (1 + follow)
    near = lags[news * np.log(left / max(left[best], 1e-12)) <= _LIMIT]
    r2, low, high = 1 - float(left[best]), float(near[0]), float(near[-1])
    if r2 < _LEAST_R2:
        return Lag(r2=r2, why=f"the picture's motion tells {r2:.0%} of the force, not half of it")
    if low <= lags[0] or high >= lags[-1]:
        return Lag(r2=r2, why=f"any within {reach_s:.1f} s fits: both change too slowly")
    return Lag(float(lags[best]), (low - float(step_s) / 2, high + float(step_s) / 2), every_s, r2)
