"""What runs inside a worker process: one FMU, loaded and stepped over its candidates. Knows no search."""
