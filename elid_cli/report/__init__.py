"""Everything said to a user is one `Report`."""
