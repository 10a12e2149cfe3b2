"""`study run shapes`: the paper's Shape Reconstruction and its figure of the force distribution.

Sphere, cylinder, ring and toy hat, pressed on the virtual rig: the paper's gallery, the depth's
error against truth, and the force field of a sheared press. `analyze shape` draws a recorded run.
"""

from __future__ import annotations

from ..report.result import StudyResult
from . import gel_remarks
from .request import StudyRequest, share_of

STUDY = "shapes"
TWIST = (
    "A stage of three axes does not turn: the twist is a ball sheared far from the centre, which "
    "gives torque about the face's middle; a turn about the ball's own axis would show as a whirl."
)


def run(asked: StudyRequest) -> StudyResult:
    """The study. Raises InputError, RunFailed."""
    from ..analysis.shape import deepest, with_traction
    from .scene import left_out
    from .shape import summary
    from .shape.simulated import settings, simulate

    made = simulate(asked)
    twist = made.twist
    modulus_mpa = next(iter(made.scene.protocols.values())).specimen.modulus_mpa
    pictures = deepest(seen.deepest for seen in made.objects.values())
    return summary.result(
        made.objects,
        pictures,
        with_traction([twist.twisted if twist else None, *pictures]),
        f"simulated on {made.scene.rig_name}, seed {asked.seed}",
        made.force_error_n.get("normal"),
        (made.depth_line, TWIST, gel_remarks.remark(STUDY, modulus_mpa)),
        simulated=True,
        seed=asked.seed,
        scale=share_of(asked.scale),
        settings=settings(made),
        left_out=left_out(made.gel),
        more={"twist": twist.rows if twist else []},
    )
