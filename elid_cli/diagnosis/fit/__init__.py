"""The model during a search, its whitened problem, and the division of the log."""
