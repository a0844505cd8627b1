"""One estimation: its methods, the searches below them, and how it runs from a case to its result."""
