"""Subcommands of elid: one file each, found by themselves."""
