"""Tests that the new engine does not pass yet: each runs, and is told as an expected failure, until it is settled.

Most name what an earlier engine said in other words or by another effect; some are real. A test that passes again is to
be taken out of this table.
"""

OPEN: tuple[str, ...] = ()
