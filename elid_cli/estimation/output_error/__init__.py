"""Simulated motion under logged torques brought near the measured one, in windows with states of their own."""
