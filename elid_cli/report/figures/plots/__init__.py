"""One file per kind of figure: a module with ``draw(figure, paper)``, found by itself."""
