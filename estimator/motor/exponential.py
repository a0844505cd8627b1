"""The exponential of a small matrix. Knows numbers only.

SciPy's ``expm`` is the same, in a package whose import takes a tenth of a second. By scaling and squaring with the
Padé approximant of degree 13 (Higham 2005, The scaling and squaring method for the matrix exponential revisited).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

LARGEST = 5.371920351148152  # one-norm up to which the approximant is as exact as the arithmetic (Higham's table 2.3)
PADE = (
    *(64764752532480000.0, 32382376266240000.0, 7771770303897600.0, 1187353796428800.0, 129060195264000.0),
    *(10559470521600.0, 670442572800.0, 33522128640.0, 1323241920.0, 40840800.0, 960960.0, 16380.0, 182.0, 1.0),
)


def exponential(a: FloatArray) -> FloatArray:
    """Return exp(a), (n, n), of an (n, n) matrix."""
    norm = float(np.abs(a).sum(axis=0).max())
    halvings = max(0, int(np.ceil(np.log2(norm / LARGEST)))) if 0 < norm < np.inf else 0
    a = a / 2.0**halvings
    b, one = PADE, np.eye(len(a))
    a2 = a @ a
    a4 = a2 @ a2
    a6 = a4 @ a2
    odd = a @ (a6 @ (b[13] * a6 + b[11] * a4 + b[9] * a2) + b[7] * a6 + b[5] * a4 + b[3] * a2 + b[1] * one)
    even = a6 @ (b[12] * a6 + b[10] * a4 + b[8] * a2) + b[6] * a6 + b[4] * a4 + b[2] * a2 + b[0] * one
    result = np.linalg.solve(even - odd, even + odd)
    for _ in range(halvings):
        result = result @ result
    return np.asarray(result)
