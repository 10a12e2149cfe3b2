"""Run by freecadcmd: the volume that each pair of pieces shares, by FreeCAD's own booleans.

The folder in $PIECES holds STEP files and pieces.json: [name, file, shift] of each piece in its
place. Writes common.json: what each shape is, and [name, name, mm3] of every pair whose boxes meet.
"""

import json
import os
from itertools import combinations
from pathlib import Path

import FreeCAD
import Part

folder = Path(os.environ["PIECES"])
placed = []
for name, file, shift in json.loads((folder / "pieces.json").read_text()):
    shape = Part.Shape()
    shape.read(str(folder / file))
    shape.translate(FreeCAD.Vector(*shift))
    placed.append((name, shape))
common = [
    (a, b, one.common(other).Volume)
    for (a, one), (b, other) in combinations(placed, 2)
    if one.BoundBox.intersect(other.BoundBox)
]
box = placed[0][1].BoundBox
for _, shape in placed:
    box.add(shape.BoundBox)
shapes = [(name, shape.isValid(), len(shape.Solids), shape.Volume) for name, shape in placed]
size = (box.XLength, box.YLength, box.ZLength)
found = {"shapes": shapes, "common": common, "size": size, "pairs": len(common)}
(folder / "common.json").write_text(json.dumps(found))
