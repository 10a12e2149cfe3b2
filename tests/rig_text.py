"""What the rig files that tests write have in common."""

VIRTUAL_STAGE = """
kind = "virtual"
[stage]
origin_machine_mm = [-60.0, -60.0, -40.0]
travel_mm = [120.0, 120.0, 60.0]
max_feed_mm_min = [1500.0, 1500.0, 1200.0]
acceleration_mm_s2 = [50.0, 50.0, 50.0]
max_force_n = [60.0, 60.0, 60.0]
"""
