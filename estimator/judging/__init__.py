"""What a fit is worth: what cannot be told, how sure the rest is, the verdict. Knows no search."""
