"""Stage, camera and force sensor behind small interfaces, and the runner that drives them."""
