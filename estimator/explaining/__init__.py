"""What a bench adds to a fit: effects selected, compared with their rivals, averaged, checked. Knows no search."""
