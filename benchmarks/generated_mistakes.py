"""Make small random mistakes in randomly drawn lines of the code.

A mistake changes an operator, a comparison, a condition, a number, two arguments, a name, or a whole statement.
"""

from __future__ import annotations

import ast
import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOTS = ("eimi_lab", "drivers/eimi_drivers", "fitting/eimi_fitting")

_COMPARISONS: dict[type[ast.cmpop], tuple[str, str]] = {
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.Is: ("is", "is not"),
    ast.IsNot: ("is not", "is"),
    ast.In: ("in", "not in"),
    ast.NotIn: ("not in", "in"),
}
_OPERATORS: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.Pow: ("**", "*"),
    ast.FloorDiv: ("//", "/"),
    ast.Mod: ("%", "*"),
}
# Functions whose result does not depend on the order of their arguments.
_SYMMETRIC = ("max", "min", "math.hypot", "np.hypot", "np.maximum", "np.minimum", "suppress")


@dataclass(frozen=True)
class Change:
    # A small mistake in a source file, made to find out whether a test fails: one text is replaced by another.
    # line, column, end_line, end_column : int
    #     Beginning and end of the old text (lines from 1, bytes in the line from 0).
    # new : str
    #     The new text.
    # says : str
    #     Description of the change.

    line: int
    column: int
    end_line: int
    end_column: int
    new: str
    says: str


def room_of(file: str) -> str:
    """Return the name of the package that contains a file, such as "acquisition"."""
    parts = Path(file).parts
    start = 1 if parts[0] == "eimi_lab" else 2
    return parts[start] if len(parts) > start + 1 else parts[start - 1]


def asked_room(file: str, rooms: Sequence[str]) -> str | None:
    """Return the first of the packages or folders `rooms` that contains the file; None if none of them does."""
    return next((room for room in rooms if room == room_of(file) or room in Path(file).parts[:-1]), None)


def changes(text: str) -> list[Change]:
    """Return all mistakes that can be made in the text of a source file."""
    tree = ast.parse(text)
    skipped = _skipped(tree)
    possible = [
        change for node, names in _walked(tree, {}) if id(node) not in skipped for change in _of_node(node, text, names)
    ]
    return sorted(possible, key=lambda change: (change.line, change.column, change.says, change.new))


def _skipped(tree: ast.AST) -> set[int]:
    """Return the identities (`id`) of the syntax tree's nodes in which no mistake is made, such as imports."""
    roots: list[ast.AST] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.AnnAssign):
            roots.append(node.annotation)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            every = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs, node.args.vararg, node.args.kwarg]
            roots += [a.annotation for a in every if a is not None and a.annotation is not None]
            roots += [*([node.returns] if node.returns else []), *node.decorator_list]
            roots += [node] if "overload" in map(ast.unparse, node.decorator_list) else []
        elif (
            isinstance(node, ast.Import | ast.ImportFrom | ast.JoinedStr | ast.Assert)
            or (isinstance(node, ast.keyword) and node.arg == "strict")
            or (isinstance(node, ast.Call) and ast.unparse(node.func) in ("TypeVar", "ParamSpec", "typer.Option"))
            or (isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"))
        ):
            roots.append(node)
    return {id(inner) for root in roots for inner in ast.walk(root)}


def _walked(node: ast.AST, names: Mapping[str, int]) -> Iterator[tuple[ast.AST, Mapping[str, int]]]:
    """Yield all nodes of a syntax tree, each with the local names that are already set there.

    The names are mapped to the line that sets them first (0 for a parameter).
    """
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        first: dict[str, int] = {a.arg: 0 for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)}
        for inner in ast.walk(node):
            if isinstance(inner, ast.Name) and isinstance(inner.ctx, ast.Store):
                first[inner.id] = min(first.get(inner.id, inner.lineno), inner.lineno)
        names = {name: first[name] for name in sorted(first.keys() - {"self", "cls", "_"})}
    yield node, names
    for child in ast.iter_child_nodes(node):
        yield from _walked(child, names)


def _of_node(node: ast.AST, text: str, names: Mapping[str, int]) -> Iterator[Change]:
    match node:
        case ast.Compare(ops=[op]) if type(op) in _COMPARISONS:
            old, new = _COMPARISONS[type(op)]
            yield from _between(text, node.left, node.comparators[0], old, new)
        case ast.BinOp(op=op) if type(op) in _OPERATORS and not _is_text(node):
            old, new = _OPERATORS[type(op)]
            yield from _between(text, node.left, node.right, old, new)
        case ast.BoolOp(op=op, values=[first, second, *_]):
            old, new = ("and", "or") if isinstance(op, ast.And) else ("or", "and")
            yield from _between(text, first, second, old, new)
        case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=operand):
            yield _replaced(node, f"({ast.unparse(operand)})", "a sign or a `not` is dropped")
        case ast.If(test=test) | ast.While(test=test) | ast.IfExp(test=test):
            yield _replaced(test, f"not ({ast.unparse(test)})", "a condition is inverted")
        case ast.comprehension(ifs=[test, *_]):
            yield _replaced(test, f"not ({ast.unparse(test)})", "a condition is inverted")
        case ast.Constant(value=bool() as value):
            yield _replaced(node, str(not value), f"{value} becomes {not value}")
        case ast.Constant(value=int() | float() as number):
            new_number = number + 1 if isinstance(number, int) else 2 * number if number else 1.0
            yield _replaced(node, repr(new_number), f"{number} becomes {new_number}")
        case ast.Call(args=[ast.expr() as first, ast.expr() as second, *_]):
            one, other = ast.unparse(first), ast.unparse(second)
            starred = isinstance(first, ast.Starred) or isinstance(second, ast.Starred)
            if one != other and not starred and ast.unparse(node.func) not in _SYMMETRIC:
                yield Change(*_start(first), *_end(second), f"{other}, {one}", "two arguments are swapped")
        case ast.Name(ctx=ast.Load(), id=name) if name in names:
            others = [other for other, line in names.items() if line < node.lineno and other != name]
            yield from (_replaced(node, other, f"{name} becomes {other}") for other in others[:1])
        case ast.Expr(value=ast.Call()) | ast.AugAssign() | ast.Raise() | ast.Break() | ast.Continue():
            yield _replaced(node, "pass", "a statement is dropped")
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]):
            yield _replaced(node, "pass", "a statement is dropped")
        case ast.Return(value=ast.expr() as value) if ast.unparse(value) != "None":
            yield _replaced(node, "return None", "a result is dropped")


def _is_text(node: ast.BinOp) -> bool:
    sides = (node.left, node.right)
    return any(
        isinstance(n, ast.JoinedStr) or (isinstance(n, ast.Constant) and isinstance(n.value, str)) for n in sides
    )


def _start(node: ast.expr | ast.stmt) -> tuple[int, int]:
    return node.lineno, node.col_offset


def _end(node: ast.expr | ast.stmt) -> tuple[int, int]:
    return node.end_lineno or node.lineno, node.end_col_offset or node.col_offset


def _replaced(node: ast.expr | ast.stmt, new: str, says: str) -> Change:
    return Change(*_start(node), *_end(node), new, says)


def _between(text: str, left: ast.expr, right: ast.expr, old: str, new: str) -> Iterator[Change]:
    """Yield the replacement of the operator `old` between two operands by `new`, if `old` occurs there exactly once."""
    (line, column), (end_line, end_column) = _end(left), _start(right)
    if line != end_line:
        return
    source = text.splitlines()[line - 1].encode()
    gap = source[column:end_column].decode()
    if gap.count(old) == 1:
        place = column + len(gap[: gap.index(old)].encode())
        yield Change(line, place, line, place + len(old.encode()), new, f"{old} becomes {new}")


def changed(text: str, change: Change) -> str:
    """Return the text of a source file after a change."""
    lines = text.encode().splitlines(keepends=True)
    first, last = lines[change.line - 1], lines[change.end_line - 1]
    middle = first[: change.column] + change.new.encode() + last[change.end_column :]
    return b"".join([*lines[: change.line - 1], middle, *lines[change.end_line :]]).decode()


def compiles(text: str) -> bool:
    """Return whether a text is valid Python."""
    try:
        compile(text, "changed", "exec")
    except (SyntaxError, ValueError):
        return False
    return True


def unique_fragments(text: str, other: str, change: Change) -> tuple[str, str]:
    """Return the changed lines before and after a change, with so many neighbouring lines that the old text is unique.

    `text` is the whole file before the change, `other` the whole file after the change.
    """
    before, after = text.splitlines(keepends=True), other.splitlines(keepends=True)
    grown = len(after) - len(before)
    first, last = change.line - 1, change.end_line
    while text.count("".join(before[first:last])) != 1:
        first, last = max(first - 1, 0), min(last + 1, len(before))
    return "".join(before[first:last]), "".join(after[first : last + grown])


def sampled(project: Path, number: int, seed: int, rooms: Sequence[str] = ()) -> list[tuple[str, Change]]:
    """Draw lines of the code at random, and one mistake for each line; return pairs (file, mistake).

    Parameters
    ----------
    project
        Top folder of the code.
    number
        Number of lines.
    seed
        Seed of the draw.
    rooms
        Packages or folders from which lines are drawn; empty for all packages.
    """
    generator = random.Random(seed)
    lines: dict[tuple[str, int], list[Change]] = {}
    for root in ROOTS:
        for path in sorted((project / root).rglob("*.py")):
            file = path.relative_to(project).as_posix()
            if not rooms or asked_room(file, rooms):
                for change in changes(path.read_text(encoding="utf-8")):
                    lines.setdefault((file, change.line), []).append(change)
    drawn: list[tuple[str, Change]] = []
    places = sorted(lines)
    generator.shuffle(places)
    for file, line in places:
        if len(drawn) == number:
            break
        text = (project / file).read_text(encoding="utf-8")
        usable = [change for change in lines[file, line] if compiles(changed(text, change))]
        if usable:
            drawn.append((file, generator.choice(usable)))
    return drawn
