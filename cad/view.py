"""Open this file in CQ-editor to look at the sensor with your own dimensions.

Change DESIGN, CHANGES, EXPLODE, PARTS or BENCH and run it again. Outside CQ-editor it prints the
volumes.
"""

import deltact_fab as dt

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
    design = dt.load_design(DESIGN, CHANGES)
    if PARTS:
        built = {name: dt.build_part(name, DESIGN, CHANGES) for name in PARTS}
        shown = [(name, part.solid, part.part) for name, part in built.items()]
    else:
        if BENCH:
            tip = dt.build_part(BENCH, DESIGN, CHANGES)
            pieces = dt.assemble_bench(design, tip.part, {tip.part.name: tip.solid})
        else:
            pieces = dt.assemble_sensor(design, EXPLODE)
        shown = [
            (f"{placed.part.name}-{placed.index}", placed.solid, placed.part) for placed in pieces
        ]
    for name, solid, part in shown:
        red, green, blue, opacity = part.colour
        colour = tuple(round(255 * c) for c in (red, green, blue))
        show_object(solid, name=name, options={"color": colour, "alpha": 1 - opacity})


view()
