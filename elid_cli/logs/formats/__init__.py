"""One file per log format: a module that defines `FORMAT` is found by itself."""
