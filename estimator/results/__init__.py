"""The outcome of an estimation, and what is made of it: reports, figures, files for other tools. Simulates nothing."""
