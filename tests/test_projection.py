"""Triangular factors: by the Gram matrix where that loses few digits, by Householder's method elsewhere."""

import numpy as np
import pytest

from estimator.fitting import projection
from estimator.fitting.projection import triangle


@pytest.mark.parametrize("alike", [0.0, 0.9, 1 - 1e-4, 1 - 1e-9, 1.0])
def test_a_triangle_has_the_columns_products_however_alike_they_are(alike):
    rng = np.random.default_rng(1)
    columns = rng.standard_normal((500, 4)) * [1.0, 1e-8, 1e6, 3.0]
    columns[:, 3] = (1 - alike) * columns[:, 3] + alike * columns[:, 0]
    r = triangle(columns)
    right = np.linalg.qr(columns, mode="r")
    signs = np.sign(np.diag(r)) * np.sign(np.diag(right))
    assert r.shape == (4, 4) and np.allclose(r, np.triu(r))
    lengths = np.linalg.norm(columns, axis=0)
    assert np.allclose(signs[:, None] * r / lengths, right / lengths, rtol=0, atol=1e-9)


def test_householders_method_is_kept_for_columns_that_depend_or_vanish_or_are_no_numbers(monkeypatch):
    asked = []
    qr = np.linalg.qr
    monkeypatch.setattr(projection.np.linalg, "qr", lambda *a, **k: (asked.append(a), qr(*a, **k))[1])
    columns = np.random.default_rng(2).standard_normal((50, 3))
    triangle(columns)
    assert not asked
    vanishing, dependent, broken = columns.copy(), columns.copy(), columns.copy()
    vanishing[:, 1], dependent[:, 1], broken[3, 1] = 0.0, 2 * columns[:, 0], np.nan
    for bad in (vanishing, dependent, broken, columns[:2]):
        assert triangle(bad).shape == (min(bad.shape), 3)
    assert len(asked) == 4
