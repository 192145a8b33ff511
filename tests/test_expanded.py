"""Proves sums of products: what is left without some symbols is what multiplying out leaves, at a fraction of its time."""

from __future__ import annotations

import random

import pytest
import sympy as sp

from kfgen.model.symbols.expanded import part_without, products

KNOWN, UNKNOWN = sp.symbols("a b c", real=True), sp.symbols("u v", real=True)


def drawn(rng: random.Random, depth: int) -> sp.Expr:
    """A random expression of sums, products, squares and roots."""
    if depth == 0:
        return rng.choice([*KNOWN, *UNKNOWN, sp.Integer(2)])
    parts = [drawn(rng, depth - 1) for _ in range(2)]
    made = rng.choice([sp.Add, sp.Mul, lambda x, _: x**2, lambda x, _: sp.sqrt(x**2 + 1)])
    return made(*parts)


@pytest.mark.parametrize("seed", range(40))
def test_a_part_without_symbols_is_that_of_the_expanded_sum(seed: int) -> None:
    e = drawn(random.Random(seed), 4)
    terms = sp.Add.make_args(sp.expand(e))
    wanted = sp.Add(*(t for t in terms if not t.free_symbols & set(UNKNOWN)))
    assert sp.expand(part_without(e, set(UNKNOWN)) - wanted) == 0


def test_a_product_of_many_sums_is_not_multiplied_out() -> None:
    """Fifty factors of two terms are 2^50 products."""
    a, _, _ = KNOWN
    u, _ = UNKNOWN
    e = sp.Mul(*(a + k + u for k in range(50)))
    assert products(e) == 3**49 * 2  # a, a number and u; the first has no number
    assert part_without(e, {u}) == sp.Mul(*(a + k for k in range(50)))
