"""Open this file in CQ-editor to look at the sensor with your own dimensions.

Change DESIGN, CHANGES, EXPLODE, PARTS or BENCH and run it again. Outside CQ-editor it prints the
volumes.
"""

from deltact_fab.cad.assembly import assemble, bench
from deltact_fab.cad.build import build_part
from deltact_fab.cad.design import load_design
from deltact_fab.cad.registry import find

DESIGN = "deltact"  # a name under cad/ or a path to your own TOML file
CHANGES = []  # as after --set: ["skin.width_mm=44", "mount.kind=plate"]
EXPLODE = 1.0  # 0 puts the sensor together
PARTS = []  # names of `deltact-fab cad list`; none: the whole sensor
BENCH = ""  # an indenter, as "star" or "sphere:10": the test bench with it, its tip on the face

if "show_object" not in globals():

    def show_object(solid, name, options):
        """What CQ-editor brings along; here it prints."""
        print(f"{name:<28}{solid.Volume():12.2f} mm3")


def view():
    """Hand every solid with its name and colour to the viewer."""
    design = load_design(DESIGN, CHANGES)
    if PARTS:
        shown = [(name, build_part(find(name), design)[0], find(name)) for name in PARTS]
    else:
        pieces = bench(design, find(BENCH)) if BENCH else assemble(design, EXPLODE)
        shown = [
            (f"{placed.part.name}-{placed.index}", placed.solid, placed.part) for placed in pieces
        ]
    for name, solid, part in shown:
        red, green, blue, opacity = part.colour
        colour = tuple(round(255 * c) for c in (red, green, blue))
        show_object(solid, name=name, options={"color": colour, "alpha": 1 - opacity})


view()
