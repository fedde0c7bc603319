"""Long logs, many logs, reduced logs: triangles that grow, merge and are stored."""
