"""Tests of the stiffness from motor positions and torques alone."""
