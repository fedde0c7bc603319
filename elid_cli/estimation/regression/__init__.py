"""The linear problem: rows, triangles, least squares, covariance."""
