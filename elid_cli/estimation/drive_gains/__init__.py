"""Absolute gains of drives from a pair of logs, one of them with a known payload."""
