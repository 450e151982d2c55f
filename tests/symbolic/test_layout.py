"""Named parts of a stacked vector."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc


@pytest.fixture
def layout():
    """Three parts: a vector, a vector bounded entry by entry, a scalar."""
    return cc.Layout(
        (
            cc.Part("position", 3, "m"),
            cc.Part("rate", 2, "rad/s", np.array([-1.0, -2.0]), 3.0),
            cc.Part("speed", 1, "m/s", 0.0),
        )
    )


def test_split_cuts_a_vector_into_its_parts(layout, evaluate):
    vector = np.arange(6.0)
    for name, expected in (("position", [0, 1, 2]), ("rate", [3, 4]), ("speed", [5])):
        part = evaluate(lambda v, name=name: layout.split(v)[name], vector)
        assert_allclose(part, np.reshape(expected, (-1, 1)), rtol=0)  # copies


def test_slices_say_where_the_parts_stand(layout):
    assert layout.slices == {
        "position": slice(0, 3),
        "rate": slice(3, 5),
        "speed": slice(5, 6),
    }


def test_join_undoes_split_in_any_order_of_names(layout, evaluate):
    vector = np.random.default_rng(0).normal(size=6)

    def there_and_back(v):
        return layout.join(dict(reversed(layout.split(v).items())))

    assert_allclose(evaluate(there_and_back, vector), vector[:, None], rtol=0)  # copies


def test_bounds_stand_in_the_order_of_the_entries(layout):
    lower, upper = layout.bounds
    inf = np.inf
    assert_allclose(lower, [-inf, -inf, -inf, -1, -2, 0], rtol=0)
    assert_allclose(upper, [inf, inf, inf, 3, 3, inf], rtol=0)


def test_labels_name_every_entry_with_its_unit(layout):
    assert layout.size == 6
    assert layout.labels[3:] == ("rate[0], rad/s", "rate[1], rad/s", "speed[0], m/s")


def test_a_layout_without_parts_is_an_empty_vector():
    empty = cc.Layout(())
    assert (empty.size, empty.labels) == (0, ())
    assert empty.split(ca.DM(0, 1)) == {}
    assert all(side.shape == (0,) for side in empty.bounds)


def test_two_parts_of_one_name_are_refused():
    with pytest.raises(ValueError, match=r"Layout\.parts: expected different names, found"):
        cc.Layout((cc.Part("q", 1, "1"), cc.Part("q", 2, "1")))


@pytest.mark.parametrize("vector", [np.zeros(5), np.zeros((1, 6)), 1.0], ids=np.shape)
def test_split_refuses_vectors_of_another_shape(layout, vector):
    with pytest.raises(ValueError, match=r"vector: expected shape \(6, 1\), found"):
        layout.split(vector)


def test_join_refuses_missing_unknown_and_wrongly_sized_parts(layout):
    parts = {"position": np.zeros(3), "rate": np.zeros(2), "speed": 0.0}
    with pytest.raises(ValueError, match=r"parts: expected \['position', 'rate', 'speed'\], found"):
        layout.join({key: parts[key] for key in ("position", "rate")})
    with pytest.raises(ValueError, match=r"parts: expected .*found .*'spin'"):
        layout.join({**parts, "spin": 0.0})
    with pytest.raises(ValueError, match=r"rate: expected shape \(2, 1\), found \(3, 1\)"):
        layout.join({**parts, "rate": np.zeros(3)})


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"name": ""}, "Part.name: expected a name"),
        ({"size": -1}, "speed.size: expected a whole number of at least 0, found -1"),
        ({"size": 1.5}, "speed.size: expected a whole number"),
        ({"lower": 2.0, "upper": 1.0}, "speed: expected lower ≤ upper, found 2.0 and 1.0"),
        ({"lower": np.nan}, "speed.lower: expected numbers, found NaN"),
        ({"upper": [1.0, 2.0, 3.0]}, "speed.upper: expected one number or 2"),
        ({"nominal": np.nan}, "speed.nominal: expected numbers, found NaN"),
        ({"nominal": np.inf}, "speed.nominal: expected finite numbers within"),
        ({"nominal": "calm"}, "speed.nominal: expected one number or 2, found 'calm'"),
        ({"upper": 1.0, "nominal": [0.5, 2.0]}, "speed.nominal: expected finite numbers within"),
        ({"attitude": True}, "speed: expected the 4 entries of a quaternion"),
    ],
)
def test_parts_that_contradict_themselves_are_named(fields, words):
    with pytest.raises(ValueError, match=words):
        cc.Part(**{"name": "speed", "size": 2, "unit": "m/s", **fields})
