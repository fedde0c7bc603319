"""Candidates, their scores, and what is accepted."""
