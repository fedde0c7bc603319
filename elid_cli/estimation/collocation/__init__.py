"""Maximum likelihood over trajectory and parameters (``--accurate``)."""
