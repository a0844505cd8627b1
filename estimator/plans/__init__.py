"""A case made concrete: what is compared with what, what is free, and where to begin. Simulates nothing."""
