"""One file and nothing else: what is dropped into a listed folder of the package is found everywhere."""
