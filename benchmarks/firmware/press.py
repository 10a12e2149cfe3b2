"""One press and its retract on a controller, as a host of its own: `... press URL [whole]`."""

from __future__ import annotations

import sys
import time
from contextlib import suppress

from deltact_fab.bench.rig.interface import WallClock
from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.common.errors import StageError
from deltact_fab.sensor.optics.camera import StageFrame

FACE_MM = -6.0  # of the machine's z
FEED_MM_MIN = 60.0
ABOVE_MM, DEEP_MM, CLEAR_MM = 0.5, -2.0, 3.0


def main() -> None:
    """Say what it does, a line each; "end WORDS" is the last."""
    stage = GrblStage(sys.argv[1], WallClock(), StageFrame((-10.0, -10.0, FACE_MM)))
    stage.whole_moves = sys.argv[2:] == ["whole"]
    stage.connect()
    stage.home()
    try:
        for name, z_mm, feed in (
            ("over the face", CLEAR_MM, 600.0),  # grblHAL's simulator is slow at first
            ("approach", ABOVE_MM, 600.0),
            ("press", DEEP_MM, FEED_MM_MIN),
            ("retract", CLEAR_MM, 600.0),
        ):
            print(name, flush=True)
            time.sleep(0.05)  # whoever reads this makes the next answer get lost
            begun_s = time.monotonic()
            planned_s = stage.start_move((0.0, 0.0, z_mm), feed)
            stage.wait()
            print(f"took {time.monotonic() - begun_s - planned_s:.4f}", flush=True)
        print("end done", flush=True)
    except StageError as why:
        lifted = False
        with suppress(StageError), stage.recovery() as at_mm:
            lifted = at_mm is not None and stage.lift(CLEAR_MM - at_mm[2], 600.0) is not None
        print(f"end {'lifted' if lifted else 'in the gel'}: {why}", flush=True)


if __name__ == "__main__":
    main()
