"""What a protocol will ask of stage and force sensor, before anything moves.

Reading order: `peaks` (normal force of one press, or a bound of it; then every indenter, position
and depth, with shear and moments), `rule` (what a rig and the acrylic behind the gel bear; time,
disk, frames a second).
"""
