"""Candidates to residuals, and their least squares. Knows no effect and no search."""
