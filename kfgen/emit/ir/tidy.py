"""Straight-line code without repetition: values that are already there are not worked out again.

Value numbering on locals, and removal of what nobody reads. The order of every sum stays, so the bits of a
result do not change.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from kfgen.emit.ir.ir import (
    All,
    Bin,
    Cell,
    Compare,
    Condition,
    Expr,
    For,
    FunctionCall,
    Let,
    Num,
    Ref,
    Stmt,
    Store,
    Una,
    When,
    comparisons,
    neg,
)


def tidy(body: Sequence[Stmt]) -> tuple[Stmt, ...]:
    """The same statements, each value worked out once, unread locals left out."""
    once = _Numbering({}, {}).run(body)
    return _read(once, set())


Key = Expr | tuple[str, frozenset[Expr]]


class _Numbering:
    """What each local stands for, which local holds an expression, and which expressions read an element."""

    def __init__(self, known: dict[str, Expr], held: dict[Key, Ref]) -> None:
        self.known = known
        self.held = held
        self.readers: dict[str, dict[Ref, list[Key]]] = {}
        self.loose: set[str] = set()

    def run(self, body: Sequence[Stmt]) -> list[Stmt]:
        """The statements with what is known put in."""
        out: list[Stmt] = []
        for s in body:
            if isinstance(s, Let):
                out += self._let(s)
            elif isinstance(s, Store):
                value = self._seen(s.value)
                if value != s.target:
                    out.append(Store(s.target, value))
                self._forget(s.target)
            elif isinstance(s, When):
                inner = [tuple(self._branch(b)) for b in (s.body, s.orelse)]
                out.append(When(self._condition(s.condition), *inner))
                self._forget_all(s)
            elif isinstance(s, For):
                self._forget_all(s)
                out.append(replace(s, body=tuple(self._branch(s.body))))
            elif isinstance(s, FunctionCall):
                out.append(replace(s, arguments=tuple(self._seen(a) for a in s.arguments)))
                self._forget(Ref("", "any"))
            else:
                out.append(s)
        return out

    def _condition(self, condition: Condition) -> Condition:
        seen = tuple(Compare(c.op, self._seen(c.a), self._seen(c.b)) for c in comparisons(condition))
        return All(seen) if isinstance(condition, All) else seen[0]

    def _branch(self, body: Sequence[Stmt]) -> list[Stmt]:
        inner = _Numbering(dict(self.known), dict(self.held))
        inner.readers = {a: {r: list(keys) for r, keys in of.items()} for a, of in self.readers.items()}
        inner.loose = set(self.loose)
        return inner.run(body)

    def _let(self, s: Let) -> list[Stmt]:
        value = self._seen(s.value)
        core = value.a if isinstance(value, Una) and value.op == "neg" else value
        if isinstance(core, Num) or (isinstance(core, Ref) and core.index is None):
            self.known[s.name] = value
            return []
        key = _key(value)
        if key in self.held:
            self.known[s.name] = self.held[key]
            return []
        self.held[key] = Ref(s.name)
        for element in _elements(value):
            self.readers.setdefault(element.name, {}).setdefault(element, []).append(key)
            if not _fixed(element):
                self.loose.add(element.name)
        return [Let(s.name, value)]

    def _seen(self, e: Expr) -> Expr:
        if isinstance(e, Ref):
            return self.known.get(e.name, e) if e.index is None else e
        if isinstance(e, Bin):
            e = Bin(e.op, self._seen(e.a), self._seen(e.b))
            return self.held.get(_key(e), e)
        if isinstance(e, Una):
            a = self._seen(e.a)
            return neg(a) if e.op == "neg" else Una(e.op, a)
        return e

    def _forget(self, target: Ref) -> None:
        """An element changes, and what was worked out from it no longer holds."""
        arrays = [target.name] if target.name else list(self.readers)
        for array in arrays:
            of = self.readers.get(array)
            if of is None:
                continue
            alone = array not in self.loose and _fixed(target)
            for element in [target] if alone else list(of):
                for key in of.pop(element, ()):
                    self.held.pop(key, None)

    def _forget_all(self, s: When | For) -> None:
        for target in stored(s):
            self._forget(target)


def stored(s: Stmt) -> Iterator[Ref]:
    """What a statement and those inside it store to; a call may store anywhere in any array of its own."""
    if isinstance(s, Store):
        yield s.target
    elif isinstance(s, FunctionCall):
        yield Ref("", "any")
    elif isinstance(s, For | When):
        for inner in (*s.body, *(s.orelse if isinstance(s, When) else ())):
            yield from stored(inner)


def _elements(e: Expr) -> Iterator[Ref]:
    if isinstance(e, Ref) and e.index is not None:
        yield e
    elif isinstance(e, Bin):
        yield from _elements(e.a)
        yield from _elements(e.b)
    elif isinstance(e, Una):
        yield from _elements(e.a)


def _fixed(*refs: Ref) -> bool:
    """Whether indices are numbers, so that unequal ones are different elements."""
    return not any(isinstance(i, str) for r in refs for i in _indices(r))


def _indices(r: Ref) -> tuple[object, ...]:
    if isinstance(r.index, Cell):
        return r.index.row, r.index.column
    return r.index if isinstance(r.index, tuple) else (r.index,)


def _key(e: Expr) -> Key:
    """Sums and products of two do not depend on their order, to the last bit."""
    if isinstance(e, Bin) and e.op in "+*":
        return e.op, frozenset((e.a, e.b))
    return e


def _read(body: Sequence[Stmt], read: set[str]) -> tuple[Stmt, ...]:
    """Without locals that nothing after them reads."""
    out: list[Stmt] = []
    for s in reversed(body):
        if isinstance(s, Let) and s.name not in read:
            continue
        if isinstance(s, Let | Store):
            read |= set(_names(s.value))
        elif isinstance(s, When):
            inner = [_read(b, read) for b in (s.body, s.orelse)]
            read |= {n for c in comparisons(s.condition) for n in (*_names(c.a), *_names(c.b))}
            out.append(When(s.condition, *inner))
            continue
        elif isinstance(s, For):
            out.append(replace(s, body=_read(s.body, read)))
            continue
        elif isinstance(s, FunctionCall):
            read |= {n for a in s.arguments for n in _names(a)}
        out.append(s)
    return tuple(reversed(out))


def _names(e: Expr) -> Iterator[str]:
    if isinstance(e, Ref) and e.index is None:
        yield e.name
    elif isinstance(e, Bin):
        yield from _names(e.a)
        yield from _names(e.b)
    elif isinstance(e, Una):
        yield from _names(e.a)
