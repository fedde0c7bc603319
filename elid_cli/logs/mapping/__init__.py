"""Where each signal of a log is: the mapping language, its resolution, proposals."""
