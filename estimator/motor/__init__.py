"""The DC motor in equations: its matrices, steady state, first guesses, winding. Knows no FMU, no case, no file."""
