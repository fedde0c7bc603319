"""Parameters over recordings: spread, slope, steps, and recordings that disagree."""
