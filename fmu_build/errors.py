"""What can go wrong while an FMU is built. Knows only sentences."""


class BuildError(ValueError):
    """An FMU or a library cannot be built; the message is one sentence with the place and the remedy."""
