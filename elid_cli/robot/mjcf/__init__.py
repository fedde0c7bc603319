"""MJCF: MuJoCo's models read and written back."""
