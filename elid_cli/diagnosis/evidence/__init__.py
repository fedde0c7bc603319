"""What was not searched in judges what was found: held-out stretches, quarters, moments."""
