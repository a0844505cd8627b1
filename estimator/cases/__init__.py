"""What to estimate, from what, through which FMU: case files and the names in them. Simulates nothing."""
