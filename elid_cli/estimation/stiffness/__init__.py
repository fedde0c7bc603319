"""Stiffness when the deflection is noisy: errors in variables."""
