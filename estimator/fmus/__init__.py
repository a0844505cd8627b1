"""FMUs as files and behind worker processes, where a crash stays: described, probed, simulated. Loads none itself."""
