"""Candidates to residuals, least squares, and what the measurement chain adds to a fit. Knows no search."""
