"""Parameters of a robot that could be built (``--physical``)."""
