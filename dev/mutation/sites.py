"""Changes of the product, and their location in another tree."""

from __future__ import annotations

import ast
import copy
import hashlib
import random
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

# Folders whose functions are changed.
ROOMS = ("core", "messages", "nodes", "launch", "tools")
# Folders and, in older trees, files that measure, print or are templates.
LEFT_OUT = ("bench", "cli", "damage", "fuzz", "scenes", "templates", "drawing")
LEFT_OUT_FILES = ("bench_", "figures_", "testing")
LEFT_OUT_ENDS = ("_objects", "_objects_drawn", "_text", "_tables", "_peer", "_peers", "_examples")
LEFT_OUT_NAMES = ("closing", "display", "thesis_examples", "rebuild_shapes", "planner_trial")
# Comparisons, and those that replace them.
TURNED: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
SIGNS: dict[type[ast.operator], type[ast.operator]] = {ast.Add: ast.Sub, ast.Sub: ast.Add}
SCALES: dict[type[ast.operator], type[ast.operator]] = {ast.Mult: ast.Div, ast.Div: ast.Mult}

Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Point:
    """A node of the syntax tree, and the text that replaces it."""

    node: ast.expr | ast.stmt
    statement: ast.stmt
    kind: str
    after: str


@dataclass(frozen=True)
class Body:
    """A top-level function or a method, with all its possible changes."""

    file: str
    name: str
    exact: str  # Hash of the code
    shape: str  # Hash of the code without names
    points: tuple[Point, ...]


@dataclass(frozen=True)
class Site:
    """A change, described so that it is located after moves and renames."""

    number: int
    file: str
    line: int
    function: str  # name
    exact: str  # hash of the function
    shape: str  # hash of the function without names
    ordinal: int  # of the change among all of its function
    kind: str
    before: str  # text that is replaced
    after: str  # text that replaces it
    statement: str  # text
    statement_shape: str  # hash without names
    statement_ordinal: int  # of the change among those of its statement


def bodies_of(root: Path) -> list[Body]:
    """All functions of the product, in the order of files and lines."""
    bodies: list[Body] = []
    for path in sorted(p for room in ROOMS for p in (root / room).rglob("*.py")):
        name = path.relative_to(root).as_posix()
        for qualified, function in _functions(ast.parse(path.read_text("utf-8")), ""):
            points = tuple(_points(function))
            if points:
                exact, shape = _hash(function, names=True), _hash(function, names=False)
                bodies.append(Body(name, qualified, exact, shape, points))
    return bodies


def is_changed(file: str) -> bool:
    """Whether changes are drawn from a file."""
    *folders, last = Path(file).with_suffix("").parts
    return not (
        any(folder in LEFT_OUT for folder in folders)
        or last.startswith(LEFT_OUT_FILES)
        or last.endswith(LEFT_OUT_ENDS)
        or last in LEFT_OUT_NAMES
    )


def _functions(tree: ast.AST, prefix: str) -> Iterator[tuple[str, Function]]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, Function):
            yield prefix + node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from _functions(node, f"{prefix}{node.name}.")


def _points(function: Function) -> Iterator[Point]:
    for statement in function.body:
        yield from _points_below(statement, statement)


def _points_below(node: ast.AST, statement: ast.stmt) -> Iterator[Point]:
    """Possible changes at a node and below it, in the order of the text."""
    if isinstance(node, ast.Raise | ast.Assert | ast.Import | ast.ImportFrom | ast.JoinedStr):
        return
    if isinstance(node, ast.stmt):
        statement = node
    if isinstance(node, ast.expr | ast.stmt):
        for kind, after in _changes(node):
            yield Point(node, statement, kind, after)
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "format_spec"):
            continue
        if isinstance(node, Function | ast.Lambda) and name == "args":
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _points_below(child, statement)


def _changes(node: ast.expr | ast.stmt) -> Iterator[tuple[str, str]]:
    """Kinds of change, and the text that replaces the node."""
    match node:
        case ast.BinOp(op=op) if type(op) in SIGNS and not _is_joined(node):
            yield "sign", _with_field(node, "op", SIGNS[type(op)]())
        case ast.BinOp(op=op) if type(op) in SCALES:
            yield "sign", _with_field(node, "op", SCALES[type(op)]())
        case ast.AugAssign(op=op) if type(op) in SIGNS and not _is_joined(node):
            yield "sign", _with_field(node, "op", SIGNS[type(op)]())
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            yield "sign", f"({ast.unparse(operand)})"
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            yield "comparison", f"(bool({ast.unparse(operand)}))"
        case ast.Constant(value=bool(value)):
            yield "constant", str(not value)
        case ast.Constant(value=int(value)):
            yield "constant", str(value + 1)
            if value > 0:
                yield "constant", str(value - 1)
        case ast.Constant(value=float(value)):
            yield "constant", repr(value * 2.0 if value else 1.0)
            if value:
                yield "constant", repr(value * 0.9)
        case ast.Compare(ops=[op, *rest]):
            for turned in TURNED[type(op)]:
                yield "comparison", _with_field(node, "ops", [turned(), *rest])
        case ast.BoolOp(op=op):
            yield (
                "comparison",
                _with_field(node, "op", ast.Or() if isinstance(op, ast.And) else ast.And()),
            )
        case ast.If(body=[*_, ast.Raise() | ast.Return() | ast.Continue() | ast.Break()]):
            yield "guard removed", "False"
            yield "guard negated", f"not ({ast.unparse(node.test)})"
        case ast.If() | ast.IfExp():
            yield "guard negated", f"not ({ast.unparse(node.test)})"


def _is_joined(node: ast.BinOp | ast.AugAssign) -> bool:
    """Whether a sum joins texts or lists, for which no other sign is defined."""
    sides = [node.left, node.right] if isinstance(node, ast.BinOp) else [node.value]
    kinds = (ast.JoinedStr, ast.List, ast.Tuple, ast.ListComp)
    return any(
        isinstance(side, kinds) or (isinstance(side, ast.Constant) and isinstance(side.value, str))
        for side in sides
    )


def _with_field(node: ast.expr | ast.stmt, field: str, value: object) -> str:
    changed = copy.copy(node)
    setattr(changed, field, value)
    text = ast.unparse(changed)
    return text if isinstance(node, ast.stmt) else f"({text})"


def target(point: Point) -> ast.expr | ast.stmt:
    """The node whose text is replaced; for a guard its condition."""
    return point.node.test if isinstance(point.node, ast.If | ast.IfExp) else point.node


def header(statement: ast.stmt) -> ast.AST:
    """A statement without the statements in it."""
    if not hasattr(statement, "body"):
        return statement
    bare = copy.copy(statement)
    for name in ("body", "orelse", "finalbody", "handlers", "cases"):
        if hasattr(bare, name):
            setattr(bare, name, [])
    return bare


class _Normalised(ast.NodeTransformer):
    """Removes what moves and renames change: texts, annotations, imports, and names on request."""

    def __init__(self, keeps_names: bool) -> None:
        self.keeps_names = keeps_names

    def generic_visit(self, node: ast.AST) -> ast.AST:
        node = super().generic_visit(node)
        for field in ("annotation", "returns"):
            if hasattr(node, field) and not isinstance(node, ast.AnnAssign):
                setattr(node, field, None)
        if isinstance(node, ast.AnnAssign):
            node.annotation = ast.Constant(0)
        if hasattr(node, "decorator_list"):
            node.decorator_list = []
        if isinstance(node, Function | ast.ClassDef):
            node.body = [child for child in node.body if not _is_text(child)] or [ast.Pass()]
        if not self.keeps_names:
            for field in ("id", "attr", "arg", "name", "asname"):
                if isinstance(getattr(node, field, None), str):
                    setattr(node, field, "_")
        return node

    def visit_Import(self, node: ast.Import) -> None:
        return None

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        return None

    def visit_Assert(self, node: ast.Assert) -> None:
        return None

    def visit_Raise(self, node: ast.Raise) -> ast.AST:
        return ast.Raise()

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.AST:
        return ast.Constant("_")

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        return ast.Constant("_") if isinstance(node.value, str) else node


def _is_text(statement: ast.stmt) -> bool:
    if not isinstance(statement, ast.Expr) or not isinstance(statement.value, ast.Constant):
        return False
    return isinstance(statement.value.value, str)


def _hash(node: ast.AST, *, names: bool) -> str:
    plain = _Normalised(names).visit(copy.deepcopy(node))
    if isinstance(plain, Function) and names:
        plain.name = "_"
    text = "" if plain is None else ast.dump(plain)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _statement_text(statement: ast.stmt) -> str:
    return ast.unparse(ast.fix_missing_locations(header(statement)))


def draw(bodies: Sequence[Body], count: int, seed: int) -> list[Site]:
    """Draw lines at random, and one change on each."""
    lines: dict[tuple[str, int], list[tuple[Body, int]]] = defaultdict(list)
    for body in bodies:
        for i, point in enumerate(body.points):
            if is_changed(body.file):
                lines[body.file, target(point).lineno].append((body, i))
    rng = random.Random(seed)
    chosen = rng.sample(sorted(lines), min(count, len(lines)))
    return [_site(number, *_random_change(rng, lines[line])) for number, line in enumerate(chosen)]


def _random_change(rng: random.Random, on_line: Sequence[tuple[Body, int]]) -> tuple[Body, int]:
    """A random change of a line; all kinds of change on it are equally likely."""
    kind = rng.choice(sorted({body.points[i].kind for body, i in on_line}))
    return rng.choice([(body, i) for body, i in on_line if body.points[i].kind == kind])


def _site(number: int, body: Body, ordinal: int) -> Site:
    point = body.points[ordinal]
    mates = [i for i, other in enumerate(body.points) if other.statement is point.statement]
    return Site(
        number=number,
        file=body.file,
        line=target(point).lineno,
        function=body.name,
        exact=body.exact,
        shape=body.shape,
        ordinal=ordinal,
        kind=point.kind,
        before=ast.unparse(target(point)),
        after=point.after,
        statement=_statement_text(point.statement),
        statement_shape=_hash(header(point.statement), names=False),
        statement_ordinal=mates.index(ordinal),
    )


def find(bodies: Sequence[Body], site: Site) -> tuple[Body, Point, str] | None:
    """Location of a change in a tree, and how it is found; None if it is missing or ambiguous."""
    for found_by, same in (
        ("body", [body for body in bodies if body.exact == site.exact]),
        ("shape", [body for body in bodies if body.shape == site.shape]),
    ):
        best = _best(same, site)
        if best is not None and site.ordinal < len(best.points):
            point = best.points[site.ordinal]
            if point.kind == site.kind:
                return best, point, found_by
    named = [body for body in bodies if body.name == site.function]
    near = [body for body in named if body.file == site.file] or named
    renamed = [body for body in bodies if _last_name(body.name) == _last_name(site.function)]
    for found_by, candidates in (
        ("name", near),
        ("last name", renamed),
        ("statement", list(bodies)),
    ):
        for exact in (True, False):
            if not exact and found_by == "statement":
                continue
            hits = [hit for body in candidates if (hit := _in_body(body, site, exact)) is not None]
            if len(hits) == 1:
                return (*hits[0], found_by)
    return None


def _best(candidates: list[Body], site: Site) -> Body | None:
    """The candidate with the site's name, else its last name, else any; None if ambiguous."""
    named = [body for body in candidates if body.name == site.function]
    last = [body for body in candidates if _last_name(body.name) == _last_name(site.function)]
    for bodies in (named, last, candidates):
        near = [body for body in bodies if body.file == site.file] or bodies
        if len(near) == 1:
            return near[0]
        if near and len({body.exact for body in near}) == 1:
            return near[0]
    return None


def _last_name(name: str) -> str:
    return name.rpartition(".")[2].lstrip("_")


def _in_body(body: Body, site: Site, exact: bool) -> tuple[Body, Point] | None:
    """The change in a function with another body, by the statement alone."""
    mates: dict[int, list[Point]] = defaultdict(list)
    for point in body.points:
        mates[id(point.statement)].append(point)
    hits = []
    for points in mates.values():
        if site.statement_ordinal >= len(points):
            continue
        point = points[site.statement_ordinal]
        if point.kind != site.kind:
            continue
        if exact and _statement_text(point.statement) != site.statement:
            continue
        if not exact and _hash(header(point.statement), names=False) != site.statement_shape:
            continue
        hits.append((body, point))
    return hits[0] if len(hits) == 1 else None


def changed(source: str, point: Point) -> str:
    """The text of a file with one change."""
    node = target(point)
    assert node.end_lineno is not None and node.end_col_offset is not None
    lines = source.encode().splitlines(keepends=True)
    begin = sum(map(len, lines[: node.lineno - 1])) + node.col_offset
    end = sum(map(len, lines[: node.end_lineno - 1])) + node.end_col_offset
    data = source.encode()
    return (data[:begin] + point.after.encode() + data[end:]).decode()
