"""What the noise of residuals is, told by them, and made white. Knows no FMU and no fit."""
