"""From a fit to its verdict: what is not identified, standard errors, reasons to doubt. Knows no search."""
