"""Trees are taken apart as JAX takes them apart."""

from typing import NamedTuple

import jax
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.numbers import paths, tree
from ravenjax.numbers.setup import Setup
from ravenjax.numbers.vec import Vec, record


@record
class Pair:
    """Two of anything."""

    first: object
    second: object


class Named(NamedTuple):
    """As robots have them beside records."""

    one: object
    other: object


TREES = st.recursive(
    st.integers(0, 9) | st.none(),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.lists(inner, max_size=3).map(tuple),
        st.lists(inner, max_size=3).map(Vec),
        st.dictionaries(st.sampled_from("abc"), inner, max_size=3),
        st.builds(Pair, inner, inner),
        st.builds(Named, inner, inner),
    ),
    max_leaves=12,
)


@given(TREES)
def test_leaves_and_maps_are_those_of_jax(value):
    leaves, structure = jax.tree.flatten(value)
    assert tree.tree_leaves(value) == leaves
    assert tree.map_leaves(lambda x: x + 1, value) == jax.tree.map(lambda x: x + 1, value)
    assert jax.tree.structure(tree.map_leaves(lambda x: x, value)) == structure
    assert tree.fill_tree(value, [x * 2 for x in leaves]) == jax.tree.map(lambda x: x * 2, value)
    assert tree.map_leaves(lambda x, y: (x, y), value, value) == jax.tree.map(
        lambda x, y: (x, y), value, value
    )


@given(st.dictionaries(st.sampled_from("abcdef"), st.integers(0, 9), min_size=1), st.data())
def test_a_path_names_an_entry_of_a_dict_like_a_field(numbers, data):
    name = data.draw(st.sampled_from(sorted(numbers)))
    whole = Pair({key: Pair(number, -number) for key, number in numbers.items()}, 5)
    assigned = paths.assign_numbers(whole, Setup(), f"{name}.second", 10)
    assert assigned == Pair({**whole.first, name: Pair(numbers[name], 10)}, 5)
