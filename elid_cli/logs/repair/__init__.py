"""Every signal onto one even time base; what was repaired is said."""
