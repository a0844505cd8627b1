"""What is simulated in each phase of an estimate, in words."""

PHASES = {  # of those whose name does not say it; short, as 80 columns hold a line of progress
    "nuisances": "bench effects",
    "rivals": "alternatives",
    "profile": "cost profiles",
    "budget": "uncertainty",
}
