"""Estimation: from signals and model to parameters and their uncertainty."""
