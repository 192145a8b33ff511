"""Printing the intermediate form: what all languages share."""

from __future__ import annotations

from kfgen.emit.ir import Bin, Compare, Expr, Flag, Let, Note, Num, Ref, Routine, Stmt, Store, Una, When


class Printer:
    """Prints expressions and statements; a language fills in its spellings."""

    indent = "    "

    def number(self, value: float) -> str:
        """A literal."""
        raise NotImplementedError

    def ref(self, ref: Ref) -> str:
        """A local scalar or an array element."""
        return ref.name if ref.index is None else f"{ref.name}[{ref.index}]"

    def root(self, argument: str) -> str:
        """A square root."""
        raise NotImplementedError

    def magnitude(self, argument: str) -> str:
        """An absolute value."""
        raise NotImplementedError

    def signum(self, argument: str) -> str:
        """-1, 0 or 1."""
        raise NotImplementedError

    def rounded(self, argument: str) -> str:
        """The nearest whole number, halves to the even one."""
        raise NotImplementedError

    def let(self, name: str, value: str) -> str:
        """A new local."""
        raise NotImplementedError

    def store(self, target: str, value: str) -> str:
        """An assignment to an element."""
        raise NotImplementedError

    def note(self, text: str) -> str:
        """A comment."""
        raise NotImplementedError

    def flag(self, status: str) -> str:
        """The status is set."""
        raise NotImplementedError

    def branch(self, condition: str, body: list[str], orelse: list[str]) -> list[str]:
        """A branch with indented bodies."""
        raise NotImplementedError

    def expression(self, e: Expr) -> str:
        """An expression, every operation in its own parentheses."""
        if isinstance(e, Num):
            return self.number(e.value)
        if isinstance(e, Ref):
            return self.ref(e)
        if isinstance(e, Bin):
            return f"({self.expression(e.a)} {e.op} {self.expression(e.b)})"
        assert isinstance(e, Una)
        inner = self.expression(e.a)
        if e.op == "neg":
            return f"(-{inner})"
        spelling = {"sqrt": self.root, "abs": self.magnitude, "sign": self.signum, "rint": self.rounded}
        return spelling[e.op](inner)

    def condition(self, c: Compare) -> str:
        """A comparison."""
        return f"{self._bare(c.a)} {c.op} {self._bare(c.b)}"

    def _bare(self, e: Expr) -> str:
        """Without the outermost parentheses."""
        text = self.expression(e)
        return text[1:-1] if isinstance(e, Bin) else text

    def statements(self, body: tuple[Stmt, ...], depth: int = 1) -> list[str]:
        """Lines of a body."""
        pad = self.indent * depth
        lines: list[str] = []
        for s in body:
            if isinstance(s, Let):
                lines.append(pad + self.let(s.name, self._bare(s.value)))
            elif isinstance(s, Store):
                lines.append(pad + self.store(self.ref(s.target), self._bare(s.value)))
            elif isinstance(s, Note):
                lines.append(pad + self.note(s.text))
            elif isinstance(s, Flag):
                lines.append(pad + self.flag(s.status))
            else:
                assert isinstance(s, When)
                inner = self.statements(s.body, depth + 1)
                orelse = self.statements(s.orelse, depth + 1)
                lines += [
                    pad + line if line.lstrip() == line else line
                    for line in self.branch(self.condition(s.condition), inner, orelse)
                ]
        return lines

    def body(self, routine: Routine) -> str:
        """The text of a routine's body."""
        return "\n".join(self.statements(routine.body))
