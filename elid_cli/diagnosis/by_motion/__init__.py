"""Diagnosis of logs that hold commands: effects judged by the motion that the robot simulates under them."""
