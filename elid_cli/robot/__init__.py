"""What a robot is, and how it is written down: YAML, URDF, MJCF."""
