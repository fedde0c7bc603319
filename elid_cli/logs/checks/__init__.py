"""Whether a log is what the robot needs: required signals, units, signs."""
