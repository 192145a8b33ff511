"""Printing the intermediate form: what all languages share."""

from __future__ import annotations

from kfgen.emit.covariance.packed import place
from kfgen.emit.ir.ir import (
    Bin,
    Cell,
    Compare,
    Condition,
    Cursor,
    Expr,
    For,
    FunctionCall,
    Let,
    Note,
    Num,
    Ref,
    Routine,
    StatusFlag,
    Stmt,
    Store,
    Una,
    When,
    Whole,
    comparisons,
)


class Printer:
    """Prints expressions and statements; a language fills in its spellings."""

    indent = "    "

    def number(self, value: float) -> str:
        """A literal."""
        raise NotImplementedError

    def setting(self, name: str) -> str:
        """A number of the emitted code that has a name."""
        return name

    def __init__(self, n: int) -> None:
        self.n = n

    def ref(self, ref: Ref) -> str:
        """A local scalar, an array, or an array's element."""
        return ref.name if ref.index is None else f"{ref.name}[{self.index(ref)}]"

    def index(self, ref: Ref) -> str:
        """The index of an element; of a packed triangle by where its row begins."""
        if isinstance(ref.index, Cell):
            return f"{ref.index.row} * {ref.index.width} + {ref.index.column}"
        if not isinstance(ref.index, tuple):
            return str(ref.index)
        i, j = ref.index
        if isinstance(i, str):
            return f"{self.row(i)} + {j}"
        begins = place(self.n, i, 0)
        return str(begins + j) if isinstance(j, int) else f"{begins} + {j}"

    def row(self, i: str) -> str:
        """Where the row of a loop's variable begins."""
        raise NotImplementedError

    def loop(self, head: tuple[str, str, str, bool], body: list[str]) -> list[str]:
        """A loop: variable, start, stop, whether downwards.

        Parameters
        ----------
        head : (str, str, str, bool)
            Variable, first value, value after the last, whether it runs down.
        body : list of str
            Lines.
        """
        raise NotImplementedError

    def call(self, routine: str, arguments: list[str], merged: bool = False) -> str:
        """A routine at work.

        Parameters
        ----------
        routine : str
            Its name.
        arguments : list of str
            Printed.
        merged : bool
            It has a status, and the graver one is kept.
        """
        raise NotImplementedError

    def whole(self, name: str, value: str) -> str:
        """A new local whole number.

        Parameters
        ----------
        name : str
        value : str
            Printed.
        """
        raise NotImplementedError

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
        """A new local.

        Parameters
        ----------
        name : str
        value : str
            Printed.
        """
        raise NotImplementedError

    def store(self, target: str, value: str) -> str:
        """An assignment to an element.

        Parameters
        ----------
        target : str
            Printed.
        value : str
            Printed.
        """
        raise NotImplementedError

    def note(self, text: str) -> str:
        """A comment."""
        raise NotImplementedError

    def flag(self, status: str) -> str:
        """The status is set."""
        raise NotImplementedError

    def branch(self, condition: str, body: list[str], orelse: list[str]) -> list[str]:
        """A branch with indented bodies.

        Parameters
        ----------
        condition : str
            Printed.
        body : list of str
            Lines.
        orelse : list of str
            Lines; none where there is no other branch.
        """
        raise NotImplementedError

    def expression(self, e: Expr) -> str:
        """An expression, every operation in its own parentheses."""
        if isinstance(e, Num):
            return self.setting(e.name) if e.name else self.number(e.value)
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

    def condition(self, condition: Condition) -> str:
        """A comparison, or several that must all hold."""
        texts = [self.comparison(c) for c in comparisons(condition)]
        return texts[0] if len(texts) == 1 else self.conjunction(texts)

    def comparison(self, c: Compare) -> str:
        """One comparison."""
        return f"{self._bare(c.a)} {c.op} {self._bare(c.b)}"

    def conjunction(self, texts: list[str]) -> str:
        """Several conditions that must all hold."""
        raise NotImplementedError

    def _bare(self, e: Expr) -> str:
        """Without the outermost parentheses."""
        text = self.expression(e)
        return text[1:-1] if isinstance(e, Bin) else text

    def statements(self, body: tuple[Stmt, ...], depth: int = 1) -> list[str]:
        """Lines of a body.

        Parameters
        ----------
        body : sequence of Stmt
        depth : int
            Levels of indentation.
        """
        pad = self.indent * depth
        lines: list[str] = []
        for s in body:
            if isinstance(s, Let):
                lines.append(pad + self.let(s.name, self._bare(s.value)))
            elif isinstance(s, Store):
                lines.append(pad + self.store(self.ref(s.target), self._bare(s.value)))
            elif isinstance(s, Note):
                lines.append(pad + self.note(s.text))
            elif isinstance(s, StatusFlag):
                lines.append(pad + self.flag(s.status))
            elif isinstance(s, Cursor):
                lines.append(pad + self.whole(s.name, self.expression(s.value)))
            elif isinstance(s, FunctionCall):
                lines.append(pad + self.call(s.routine, [self.expression(a) for a in s.arguments], s.merged))
            elif isinstance(s, For):
                start = _sum(s.start, s.skip)
                inner = self.statements(s.body, depth + 1)
                lines += _padded(pad, self.loop((s.var, start, str(s.stop), s.down), inner))
            else:
                assert isinstance(s, When)
                inner = self.statements(s.body, depth + 1)
                orelse = self.statements(s.orelse, depth + 1)
                lines += _padded(pad, self.branch(self.condition(s.condition), inner, orelse))
        return lines

    def body(self, routine: Routine) -> str:
        """The text of a routine's body."""
        return "\n".join(self.statements(routine.body))


def _padded(pad: str, lines: list[str]) -> list[str]:
    """Lines of a block's head and foot, which are not yet indented."""
    return [pad + line if line.lstrip() == line else line for line in lines]


def _sum(a: Whole, b: int) -> str:
    if isinstance(a, int):
        return str(a + b)
    return f"{a} + {b}" if b else a


class PythonPrinter(Printer):
    """Python on flat arrays, in double precision."""

    def number(self, value: float) -> str:
        """A literal that reads back to the same float."""
        return repr(float(value)) if value >= 0 else f"({float(value)!r})"

    def root(self, argument: str) -> str:
        """From the standard library."""
        return f"sqrt({argument})"

    def magnitude(self, argument: str) -> str:
        """Built in."""
        return f"abs({argument})"

    def signum(self, argument: str) -> str:
        """By two comparisons."""
        return f"(float({argument} > 0.0) - float({argument} < 0.0))"

    def rounded(self, argument: str) -> str:
        """Built in."""
        return f"float(round({argument}))"

    def let(self, name: str, value: str) -> str:
        """A local."""
        return f"{name} = {value}"

    def store(self, target: str, value: str) -> str:
        """An assignment."""
        return f"{target} = {value}"

    def note(self, text: str) -> str:
        """A comment."""
        return f"# {text}"

    def flag(self, status: str) -> str:
        """The status is set."""
        return f"status = max(status, Status.{status})"

    def row(self, i: str) -> str:
        """From a table."""
        return f"ROW[{i}]"

    def loop(self, head: tuple[str, str, str, bool], body: list[str]) -> list[str]:
        """``for``."""
        var, start, stop, down = head
        turns = f"reversed(range({start}, {stop}))" if down else f"range({start}, {stop})"
        return [f"for {var} in {turns}:", *body]

    def call(self, routine: str, arguments: list[str], merged: bool = False) -> str:
        """A method of the class."""
        called = f"self.{'' if merged else '_'}{routine}({', '.join(arguments)})"
        return f"status = max(status, {called})" if merged else called

    def whole(self, name: str, value: str) -> str:
        """A local."""
        return f"{name} = int({value})"

    def conjunction(self, texts: list[str]) -> str:
        """``and``."""
        return " and ".join(texts)

    def branch(self, condition: str, body: list[str], orelse: list[str]) -> list[str]:
        """``if`` and ``else``."""
        if not body:
            return [f"if not ({condition}):", *orelse]
        return [f"if {condition}:", *body, *(["else:", *orelse] if orelse else [])]
