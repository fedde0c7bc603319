"""The trajectory fit: drive parameters by which the simulated motion comes nearest to the measured one."""
