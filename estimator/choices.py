"""Words that a case, an option and an argument choose from, each set once. Knows what none of them does."""

FMI_KINDS = ("co-simulation", "model-exchange")
LOSSES = ("linear", "huber")
