"""Measured signals: files, units, columns and clocks, the sensors that show them. Knows no FMU and no case."""
