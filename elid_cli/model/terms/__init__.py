"""The base terms: 14 parameters per joint, one file per term."""
