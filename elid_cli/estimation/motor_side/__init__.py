"""Transmission stiffness from motor positions and motor torques alone: the link's position is an unknown."""
