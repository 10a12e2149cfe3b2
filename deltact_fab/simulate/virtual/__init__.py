"""The virtual rig: controller, gel, camera and force box simulated below the wire."""
