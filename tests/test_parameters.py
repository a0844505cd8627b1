import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.plans.parameters import Box


def box():
    return Box(np.array([1e-7, -2.0]), np.array([0.5, 3.0]), np.array([True, False]))


@given(st.lists(st.floats(0, 1), min_size=2, max_size=2))
def test_the_cube_maps_to_the_box_and_back(u):
    values = box().from_cube(np.array(u))
    assert np.all(values >= box().lower) and np.all(values <= box().upper)
    assert np.allclose(box().to_cube(values), u, atol=1e-12)


def test_the_middle_of_a_log_scale_is_the_geometric_mean():
    assert box().from_cube(np.array([0.5, 0.5])) == pytest.approx([np.sqrt(1e-7 * 0.5), 0.5])


def test_values_outside_come_to_the_faces():
    assert np.array_equal(box().to_cube(np.array([10.0, -5.0])), [1.0, 0.0])


def test_a_box_without_width_stays_where_it_is():
    flat = Box(np.array([2.0]), np.array([2.0]), np.array([False]))
    assert flat.from_cube(np.array([0.7]))[0] == 2.0
    assert flat.to_cube(np.array([2.0]))[0] == 0.0
