"""Experiments: simulation, excitation and what a planned motion will show."""
