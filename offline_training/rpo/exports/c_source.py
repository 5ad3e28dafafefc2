# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels in C99: the same operations in the same order, so the same bits.

The compiler must not contract, reorder or compute in wider formats: no `-ffast-math`, and
`-ffp-contract=off` where the processor has FMA. Whole numbers have 64 bits, as compiled kernels
have them.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import textwrap
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import FunctionType, ModuleType
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

from rpo_core.files.validation import InputError
from rpo_core.kernels.calls import call
from rpo_core.kernels.records import Field, fields_of
from rpo_core.kernels.simd import lanes

Type = Any
"""'double', 'int' or 'void'; a tuple of types; a class of named tuples; a `Record`, an `Array`."""


@dataclass(frozen=True)
class Record:
    """Where a record is (`rpo_core.kernels.records`), which a kernel may write unless it is const.

    base : its class; is_value : whether it is the record itself, which a kernel made
    """

    base: Any
    is_const: bool
    is_value: bool = False


@dataclass(frozen=True)
class Array:
    """Where numbers or records are, as a `Field` of a record has them.

    shape : None in the place of a length that is not fixed, 0 of one that C is not told
    """

    base: Any
    shape: tuple[int | None, ...]
    is_const: bool


_SCALARS = {float: 'double', int: 'int', bool: 'int', type(None): 'void'}


def type_of(annotation: Any) -> Type:
    """Return the type of an annotation; None for one that the caller knows."""
    if annotation in _SCALARS:
        return _SCALARS[annotation]
    if get_origin(annotation) is tuple:
        return tuple(map(type_of, get_args(annotation)))
    return annotation if isinstance(annotation, type) and issubclass(annotation, tuple) else None


def type_of_value(value: Any) -> Type:
    """Return the type of a number."""
    return _SCALARS[type(value)]


def plain(function: Any) -> Any:
    """Return the Python function of a kernel."""
    return getattr(function, 'py_func', function)  # numba keeps it there


class Read(NamedTuple):
    """A kernel: its definition, the types of its annotations, the globals of its module."""

    tree: ast.FunctionDef
    hints: dict[str, Type]
    names: Mapping[str, Any]


def read(function: Callable[..., Any]) -> Read:
    """Return a kernel without its annotations and decorator, and as it is compiled."""
    function = plain(function)
    is_function = isinstance(function, FunctionType)
    node = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0] if is_function else None
    if not isinstance(node, ast.FunctionDef):
        raise InputError(f'a kernel must be a plain function; got {function!r}')
    node.decorator_list, node.returns = [], None
    hints = {name: type_of(annotation) for name, annotation in get_type_hints(function).items()}
    for argument in node.args.args:
        argument.annotation = None
    return Read(_Compiled().visit(node), hints, function.__globals__)


class _Compiled(ast.NodeTransformer):
    """Takes out the branches that interpreted kernels alone take."""

    def visit_If(self, node: ast.If) -> Any:
        """Return the statements that are taken."""
        self.generic_visit(node)
        taken = {'COMPILED': node.body, 'not COMPILED': node.orelse}
        return taken.get(ast.unparse(node.test), node)


_BINARY = {
    ast.Add: ('+', 9), ast.Sub: ('-', 9), ast.Mult: ('*', 10), ast.Div: ('/', 10),
    ast.FloorDiv: ('int64_floor', 12), ast.Mod: ('int64_modulo', 12),
    ast.BitAnd: ('&', 4), ast.BitOr: ('|', 4), ast.BitXor: ('^', 4), ast.LShift: ('<<', 4),
    ast.RShift: ('>>', 4),
}  # fmt: skip
_WHOLE_ALONE = ast.FloorDiv, ast.Mod, ast.BitAnd, ast.BitOr, ast.BitXor, ast.LShift, ast.RShift
_COMPARE = {
    ast.Lt: '<', ast.LtE: '<=', ast.Gt: '>', ast.GtE: '>=', ast.Eq: '==', ast.NotEq: '!='
}  # fmt: skip
_CHOICE, _OR, _AND, _BITS, _COMPARED, _UNARY, WHOLE = 1, 2, 3, 4, 6, 11, 12  # how tightly C binds
MAX_INT = 2**31 - 1
_KEYWORDS = frozenset((
    'auto', 'break', 'case', 'char', 'const', 'continue', 'default', 'do', 'double', 'else',
    'enum', 'extern', 'float', 'for', 'goto', 'if', 'inline', 'int', 'long', 'register',
    'restrict', 'return', 'short', 'signed', 'sizeof', 'static', 'struct', 'switch', 'typedef',
    'union', 'unsigned', 'void', 'volatile', 'while',
))  # fmt: skip


class Written(NamedTuple):
    """A function in C."""

    name: str
    text: str
    parameters: tuple[Type, ...]
    returns: Type


class Expression(NamedTuple):
    """An expression in C, how tightly it binds, and its type."""

    text: str
    rank: int
    type: Type

    def within(self, rank: int) -> str:
        """Return it as a part of an expression of a rank."""
        return self.text if self.rank >= rank else f'({self.text})'


def own_name(name: str) -> str:
    """Return the name of a variable in C."""
    return 'turn' if name == '_' else f'{name}_' if name in _KEYWORDS else name


def number(value: Any) -> str:
    """Return a number as C has it, bit for bit; raises InputError if it is none."""
    if isinstance(value, bool):
        return str(int(value))
    if not isinstance(value, (int, float)):
        raise InputError(f'a constant of a kernel must be a number; got {value!r}')
    if math.isfinite(value):
        return repr(value)
    return 'NAN' if math.isnan(value) else 'INFINITY' if value > 0.0 else '-INFINITY'


WIDTH = 100
_STEP = 4


def wrapped(text: str, depth: int = 0) -> str:
    """Return a line of C, broken at blanks where it is too long."""
    return textwrap.fill(
        text, WIDTH, initial_indent=' ' * _STEP * depth, break_long_words=False,
        subsequent_indent=' ' * _STEP * (depth + 1), break_on_hyphens=False,
    )  # fmt: skip


def _uses(nodes: Sequence[ast.AST], context: type[ast.expr_context] | None = None) -> Counter[str]:
    return Counter(
        part.id
        for node in nodes
        for part in ast.walk(node)
        if isinstance(part, ast.Name) and (context is None or isinstance(part.ctx, context))
    )


class _Block(NamedTuple):
    """A block: how often it uses each name, which ends with it if it is declared in it."""

    uses: Counter[str]
    depth: int


class Writer:
    """Writes one kernel; `given` are the types of its arguments.

    key : types of its parameters
    types : of the variables that are known so far
    public : whether others call it: it then returns an int, 0 where the kernel returns nothing
    """

    def __init__(
        self, source: Source, kernel: Read, given: Sequence[Type], public: bool = False
    ) -> None:
        self._source, self._tree, self._names = source, kernel.tree, kernel.names
        self._public, hints = public, kernel.hints
        self._all, self._stores = _uses(kernel.tree.body), _uses(kernel.tree.body, ast.Store)
        self._loads = _uses(kernel.tree.body, ast.Load)
        self.types: dict[str, Type] = {}
        names = [argument.arg for argument in self._tree.args.args]
        for i, name in enumerate(names):
            known = given[i] if i < len(given) else None
            hint = hints.get(name)
            is_place = isinstance(known, (Record, Array))
            self.types[name] = known if is_place or hint is None else hint
        self._parameters = tuple(self.types.items())
        self.key = tuple(self.types.values())
        self._returns = self._returned(hints.get('return'))
        self._early: dict[str, str] = {}  # declarations before the first statement
        self._copies = Counter(self._all.keys())

    def _returned(self, hint: Type) -> Type:
        """Return the type of what it returns."""
        if hint is None:
            raise InputError(f'kernel `{self._tree.name}` must say what it returns, to be C')
        if not isinstance(hint, tuple):
            return Record(hint, True, is_value=True) if isinstance(hint, type) else hint
        return tuple(map(self._returned, hint))

    def written(self, title: str) -> Written:
        """Return the function under a name; raises InputError for what kernels do not use."""
        body, document = self._tree.body, ast.get_docstring(self._tree)
        body = body[1:] if document else body
        idle = [f'    (void){own_name(n)};' for n, _ in self._parameters if not self._loads[n]]
        lines = self._block(body, 1)
        if self._public and not isinstance(body[-1], ast.Return):
            lines.append('    return 0;')
        head = ', '.join(self._source.declared(k, own_name(n)) for n, k in self._parameters)
        returns = 'int' if self._public else f'static {self._source.spelled(self._returns)}'
        first = (document or '').split('\n\n')[0].replace('*/', '* /')
        comment = wrapped(f'/* {" ".join(first.split())} */') + '\n' if first else ''
        text = '\n'.join(
            [
                wrapped(f'{returns} {title}({head or "void"})'),
                '{',
                *self._early.values(),
                *idle,
                *lines,
                '}',
            ]
        )
        kinds = tuple(kind for _, kind in self._parameters)
        return Written(title, comment + text, kinds, self._returns)

    def _block(self, statements: Sequence[ast.stmt], depth: int) -> list[str]:
        block, before = _Block(_uses(statements), depth), dict(self.types)
        lines = list[str]()
        for statement in statements:
            lines += self._statement(statement, block)
        hoisted = {name: self.types[name] for name in self._early}
        self.types = {**hoisted, **before}
        return lines

    def _statement(self, node: ast.stmt, block: _Block) -> list[str]:
        method: Any = getattr(self, f'_{type(node).__name__.lower()}', None)
        if method is None:
            raise self.refused(node)
        lines: list[str] = method(node, block)
        return lines

    def _return(self, node: ast.Return, block: _Block) -> list[str]:
        if node.value is None:
            return [wrapped('return 0;' if self._public else 'return;', block.depth)]
        value = self._as(self.of(node.value, self._returns), self._returns, node)
        text = f'(int){value.within(_UNARY)}' if self._public else value.text
        return [wrapped(f'return {text};', block.depth)]

    def _break(self, node: ast.Break | ast.Continue, block: _Block) -> list[str]:
        return [wrapped(f'{ast.unparse(node)};', block.depth)]

    _continue = _break

    def _pass(self, _node: ast.Pass, block: _Block) -> list[str]:
        return [wrapped(';', block.depth)]

    def _augassign(self, node: ast.AugAssign, block: _Block) -> list[str]:
        target: Any = node.target
        whole = ast.BinOp(target, node.op, node.value)
        return [self._named(target, self.of(whole), block)]

    def _expr(self, node: ast.Expr, block: _Block) -> list[str]:
        return [wrapped(f'{self.of(node.value).text};', block.depth)]

    def _assign(self, node: ast.Assign, block: _Block) -> list[str]:
        first, *rest = reversed(node.targets)
        if isinstance(first, ast.Tuple):
            if rest:
                raise self.refused(node)
            return self._unpacked(first, node.value, block)
        lines = [self._named(first, self.of(node.value), block)]
        for target in rest:  # a = b = value: the same value for all
            lines.append(self._named(target, self.of(first), block))
        return lines

    def _named(self, target: ast.expr, value: Expression, block: _Block) -> str:
        if isinstance(target, ast.Name):
            return self._stored(target.id, value, block)
        if not isinstance(target, (ast.Subscript, ast.Attribute)):
            raise self.refused(target)
        whole, place = self.of(target.value).type, self.of(target)
        is_written = isinstance(whole, (Record, Array)) and not whole.is_const
        if not (is_written and place.type in ('int', 'double')):
            raise self.refused(target)
        text = f'{place.text} = {self._as(value, place.type, target).text};'
        return wrapped(text, block.depth)

    def _unpacked(self, target: ast.Tuple, value: ast.expr, block: _Block) -> list[str]:
        names = [part.id if isinstance(part, ast.Name) else '' for part in target.elts]
        if isinstance(value, ast.Tuple):
            later = [_uses(value.elts[i + 1 :]) for i in range(len(names))]
            if not all(names) or any(later[i][name] for i, name in enumerate(names)):
                return self._through_copies(target.elts, value, block)
            pairs = zip(names, map(self.of, value.elts), strict=True)
            return [self._stored(name, one, block) for name, one in pairs if self._loads[name]]
        whole, lines = self.of(value), []
        if not isinstance(value, ast.Name):
            name = self._unique('found')
            head = self._source.declared(whole.type, name, fixed=True)
            lines.append(wrapped(f'{head} = {whole.text};', block.depth))
            whole = Expression(name, WHOLE, whole.type)
        return lines + self._spread(target, whole, value, block)

    def _spread(
        self, target: ast.Tuple, whole: Expression, value: ast.expr, block: _Block
    ) -> list[str]:
        lines = list[str]()
        for i, one in enumerate(target.elts):
            if isinstance(one, ast.Name) and not self._loads[one.id]:
                continue
            part = self.part(whole, str(i), value)
            if isinstance(one, ast.Tuple):
                lines += self._spread(one, part, value, block)
            else:
                lines.append(self._named(one, part, block))
        return lines

    def _unique(self, name: str) -> str:
        """Return a name that the function has not declared."""
        self._copies[name] += 1
        return f'{name}{self._copies[name]}' if self._copies[name] > 1 else name

    def _through_copies(
        self, targets: Sequence[ast.expr], value: ast.Tuple, block: _Block
    ) -> list[str]:
        copies, lines = [], []
        for target, part in zip(targets, value.elts, strict=True):
            one = self.of(part)
            name = self._unique(f'new_{target.id}' if isinstance(target, ast.Name) else 'new')
            copies.append(Expression(name, WHOLE, one.type))
            head = self._source.declared(one.type, name, fixed=True)
            lines.append(wrapped(f'{head} = {one.text};', block.depth))
        for target, copy in zip(targets, copies, strict=True):
            if isinstance(target, ast.Tuple):
                lines += self._spread(target, copy, value, block)
            else:
                lines.append(self._named(target, copy, block))
        return lines

    def _stored(self, name: str, value: Expression, block: _Block) -> str:
        if name not in self.types:
            self.types[name] = value.type
            if block.uses[name] == self._all[name]:
                head = self._source.declared(value.type, own_name(name), self._stores[name] == 1)
                return wrapped(f'{head} = {value.text};', block.depth)
            self._early[name] = f'    {self._source.declared(value.type, own_name(name))};'
        value = self._as(value, self.types[name], ast.Name(name))
        return wrapped(f'{own_name(name)} = {value.text};', block.depth)

    def _as(self, value: Expression, wanted: Type, node: ast.AST) -> Expression:
        """Return a number as one of a type, and an array of numbers as a tuple."""
        if isinstance(wanted, tuple) and isinstance(value.type, Array):
            parts = (self.part(value, str(i), node).text for i in range(len(wanted)))
            text = f'({self._source.spelled(wanted)}){{{{{", ".join(parts)}}}}}'
            return Expression(text, WHOLE, wanted)
        if wanted == 'int' and value.type == 'double':
            raise self.refused(node)
        if wanted != 'double' or value.type != 'int' or value.text.isdigit():
            return value
        return Expression(f'(double){value.within(_UNARY)}', _UNARY, 'double')

    def _if(self, node: ast.If, block: _Block) -> list[str]:
        lines = [wrapped(f'if ({self.of(node.test).text}) {{', block.depth)]
        lines += self._block(node.body, block.depth + 1)
        if len(node.orelse) == 1 and isinstance(node.orelse[0], ast.If):
            first, *rest = self._if(node.orelse[0], block)
            return [*lines, wrapped(f'}} else {first.strip()}', block.depth), *rest]
        if node.orelse:
            lines.append(wrapped('} else {', block.depth))
            lines += self._block(node.orelse, block.depth + 1)
        return [*lines, wrapped('}', block.depth)]

    def _while(self, node: ast.While, block: _Block) -> list[str]:
        lines = [wrapped(f'while ({self.of(node.test).text}) {{', block.depth)]
        return [*lines, *self._block(node.body, block.depth + 1), wrapped('}', block.depth)]

    def _for(self, node: ast.For, block: _Block) -> list[str]:
        call = node.iter
        if not (
            isinstance(node.target, ast.Name)
            and isinstance(call, ast.Call)
            and ast.unparse(call.func) == 'range'
        ):
            raise self.refused(node)
        given = [self.of(argument).text for argument in call.args]
        start, stop, *steps = given if len(given) > 1 else ['0', *given]
        step = steps[0] if steps else '1'
        name = own_name(node.target.id)
        self.types[node.target.id] = 'int'
        more = f'{name}++' if step == '1' else f'{name} += {step}'
        test = '>' if step.startswith('-') else '<'
        first = f'{self._source.spelled("int")} {name} = {start}'
        if not stop.isidentifier() and not stop.isdigit():
            first, stop = f'{first}, end_{name} = {stop}', f'end_{name}'
        head = f'for ({first}; {name} {test} {stop}; {more}) {{'
        lines = [wrapped(head, block.depth), *self._block(node.body, block.depth + 1)]
        del self.types[node.target.id]
        return [*lines, wrapped('}', block.depth)]

    def of(self, node: ast.expr, wanted: Type = None) -> Expression:
        """Return an expression; raises InputError for what kernels do not use.

        wanted : type of a tuple, which the tuple itself does not say
        """
        method: Any = getattr(self, f'_{type(node).__name__.lower()}', None)
        if method is None:
            raise self.refused(node)
        if isinstance(node, (ast.Tuple, ast.IfExp)):
            return method(node, wanted)
        return method(node)

    def refused(self, node: ast.AST) -> InputError:
        """Return the error for what C does not get."""
        return InputError(
            f'kernel `{self._tree.name}` must have + - * /, comparisons, if, loops over range, '
            f'tuples and calls of kernels alone, to be C; got {ast.unparse(node)}'
        )

    def _name(self, node: ast.Name) -> Expression:
        if node.id in self.types:
            return Expression(own_name(node.id), WHOLE, self.types[node.id])
        return self._global(node.id, self._names.get(node.id), node)

    def _global(self, name: str, value: Any, node: ast.expr) -> Expression:
        if isinstance(value, tuple):
            parts = ast.Tuple([ast.Constant(part) for part in value])
            if not hasattr(value, '_fields'):
                return self.of(parts)
            return self._built(type(value), list(map(self.of, parts.elts)), node)
        if not isinstance(value, (int, float)):
            raise self.refused(node)
        if math.isnan(value):
            return Expression('NAN', WHOLE, 'double')
        return Expression(self._source.constant(name, value), WHOLE, type_of_value(value))

    def _constant(self, node: ast.Constant) -> Expression:
        return Expression(number(node.value), WHOLE, type_of_value(node.value))

    def _attribute(self, node: ast.Attribute) -> Expression:
        module = self._module(node.value)
        if module is not None:
            return self._global(node.attr, getattr(module, node.attr), node)
        return self._field(self.of(node.value), node.attr)

    def _field(self, record: Expression, attribute: str) -> Expression:
        field_type, name = self._source.field(record.type, attribute), own_name(attribute)
        text = f'{record.text}->{name}'
        if record.text.startswith('&'):
            text = f'{record.text[1:]}.{name}'
        elif isinstance(record.type, Record) and record.type.is_value:
            text = f'{record.text}.{name}'
        if isinstance(field_type, Record):
            return Expression(f'&{text}', _UNARY, field_type)
        return Expression(text, WHOLE, field_type)

    def _module(self, node: ast.expr) -> ModuleType | None:
        module = self._names.get(node.id) if isinstance(node, ast.Name) else None
        return module if isinstance(module, ModuleType) else None

    def _subscript(self, node: ast.Subscript) -> Expression:
        whole, index = self.of(node.value), self.of(node.slice)
        text = whole.within(WHOLE)
        if isinstance(whole.type, Array):
            return self._element(whole.type, text, index)
        if not isinstance(whole.type, tuple):
            raise self.refused(node)
        return self.part(whole, index.text, node)

    def _element(self, array: Array, text: str, index: Expression) -> Expression:
        """Return an element of an array, or a row of it."""
        base, shape, is_const = array.base, array.shape, array.is_const
        if None not in shape:
            text = f'{text}[{index.text}]'
        elif len(shape) == 1:
            text = f'{text}.at[{index.text}]'
        else:
            row, shape = f'&{text}.at[{text}.width * {index.within(_UNARY)}]', (None, 0)
            return Expression(row, _UNARY, Array(base, shape[1:], is_const))
        if len(shape) > 1:
            return Expression(text, WHOLE, Array(base, shape[1:], is_const))
        if base in (float, int):
            return Expression(text, WHOLE, 'double' if base is float else 'int')
        return Expression(f'&{text}', _UNARY, Record(base, is_const))

    def part(self, whole: Expression, index: str, node: ast.AST) -> Expression:
        """Return an element of a tuple, of a record that is one, or of an array."""
        if isinstance(whole.type, Record) and hasattr(whole.type.base, '_fields'):
            return self._field(whole, whole.type.base._fields[int(index)])
        if isinstance(whole.type, Array):
            return self._element(whole.type, whole.within(WHOLE), Expression(index, WHOLE, 'int'))
        if set(whole.type) == {'double'}:
            return Expression(f'{whole.text}.at[{index}]', WHOLE, 'double')
        if not index.isdigit():
            raise self.refused(node)
        return Expression(f'{whole.text}.f{index}', WHOLE, whole.type[int(index)])

    def _unaryop(self, node: ast.UnaryOp) -> Expression:
        value = self.of(node.operand)
        if isinstance(node.op, ast.Not):
            return Expression(f'!{value.within(_UNARY + 1)}', _UNARY, 'int')
        if not isinstance(node.op, ast.USub):
            raise self.refused(node)
        return Expression(f'-{value.within(_UNARY + 1)}', _UNARY, value.type)

    def _binop(self, node: ast.BinOp) -> Expression:
        if type(node.op) not in _BINARY:
            raise self.refused(node)
        sign, rank = _BINARY[type(node.op)]
        left, right = self.of(node.left), self.of(node.right)
        is_real = 'double' in (left.type, right.type) or isinstance(node.op, ast.Div)
        if is_real:
            if isinstance(node.op, _WHOLE_ALONE):
                raise self.refused(node)
            left, right = self._as(left, 'double', node), self._as(right, 'double', node)
        elif rank == WHOLE or (sign == '*' and self._is_long(node)):
            name = 'int64_product' if sign == '*' else sign
            return Expression(f'{name}({left.text}, {right.text})', WHOLE, 'int')
        elif rank == _BITS:
            return Expression(f'{left.within(_UNARY)} {sign} {right.within(_UNARY)}', rank, 'int')
        first = left.within(rank)
        if is_real and 'double' not in (left.type, right.type):
            first = f'(double){left.within(_UNARY)}'
        text = f'{first} {sign} {right.within(rank + 1)}'
        return Expression(text, rank, 'double' if is_real else 'int')

    def _is_long(self, node: ast.BinOp) -> bool:
        """Whether one side is a constant of more than 31 bits."""
        for side in (node.left, node.right):
            value = side.value if isinstance(side, ast.Constant) else None
            value = self._names.get(side.id) if isinstance(side, ast.Name) else value
            if isinstance(value, int) and abs(value) > MAX_INT:
                return True
        return False

    def _compare(self, node: ast.Compare) -> Expression:
        choices = node.comparators[0]
        if isinstance(node.ops[0], ast.In) and isinstance(choices, ast.Tuple):
            same: list[ast.expr] = [ast.Compare(node.left, [ast.Eq()], [c]) for c in choices.elts]
            return self._boolop(ast.BoolOp(ast.Or(), same))
        if not all(type(op) in _COMPARE for op in node.ops):
            raise self.refused(node)
        sides = [self.of(part) for part in (node.left, *node.comparators)]
        if isinstance(sides[0].type, tuple):
            return self._same(sides, node)
        if any(side.type == 'double' for side in sides):
            sides = [self._as(side, 'double', node) for side in sides]
        parts = [side.within(_COMPARED + 2) for side in sides]
        tests = [f'{parts[i]} {_COMPARE[type(op)]} {parts[i + 1]}' for i, op in enumerate(node.ops)]
        return Expression(' && '.join(tests), _COMPARED if len(tests) == 1 else _AND, 'int')

    def _same(self, sides: Sequence[Expression], node: ast.Compare) -> Expression:
        """Return whether two tuples are equal, number by number."""
        one, other = sides[0], self._as(sides[-1], sides[0].type, node)
        if len(sides) > 2 or one.type != other.type or not isinstance(node.ops[0], ast.Eq):
            raise self.refused(node)
        pairs = ((self.part(one, str(i), node), self.part(other, str(i), node))
                 for i in range(len(one.type)))  # fmt: skip
        return Expression(' && '.join(f'{a.text} == {b.text}' for a, b in pairs), _AND, 'int')

    def _boolop(self, node: ast.BoolOp) -> Expression:
        sign, rank = ('||', _OR) if isinstance(node.op, ast.Or) else ('&&', _AND)
        tests = [self.of(value).within(_COMPARED) for value in node.values]
        return Expression(f' {sign} '.join(tests), rank, 'int')

    def _ifexp(self, node: ast.IfExp, wanted: Type) -> Expression:
        test = self.of(node.test).within(_CHOICE + 1)
        yes, no = self.of(node.body, wanted), self.of(node.orelse, wanted)
        result = yes.type if yes.type == no.type else 'double'
        if isinstance(yes.type, (Array, Record)) and isinstance(no.type, (Array, Record)):
            result = replace(yes.type, is_const=yes.type.is_const or no.type.is_const)
            if result != replace(no.type, is_const=result.is_const):
                raise self.refused(node)
        yes, no = self._as(yes, result, node), self._as(no, result, node)
        text = f'{test} ? {yes.within(_CHOICE + 1)} : {no.within(_CHOICE + 1)}'
        return Expression(text, _CHOICE, result)

    def _tuple(self, node: ast.Tuple, wanted: Type) -> Expression:
        of_parts = wanted if isinstance(wanted, tuple) else (None,) * len(node.elts)
        parts = [self.of(value, one) for value, one in zip(node.elts, of_parts, strict=True)]
        tuple_type = wanted if isinstance(wanted, tuple) else tuple(one.type for one in parts)
        parts = [self._as(one, k, node) for one, k in zip(parts, tuple_type, strict=True)]
        texts = ', '.join(one.text for one in parts)
        name = self._source.spelled(tuple_type)
        inner = f'{{{{{texts}}}}}' if set(tuple_type) == {'double'} else f'{{{texts}}}'
        return Expression(f'({name}){inner}', WHOLE, tuple_type)

    def _call(self, node: ast.Call) -> Expression:
        module = self._module(node.func.value) if isinstance(node.func, ast.Attribute) else None
        if module is not None and isinstance(node.func, ast.Attribute):
            called: Any = getattr(module, node.func.attr)
        elif isinstance(node.func, ast.Name):
            name = node.func.id
            called = self._names.get(name, getattr(builtins, name, None))
        else:
            raise self.refused(node)
        if called is call:
            return self._by_address(node)
        given = [self.of(argument) for argument in node.args]
        if called is lanes:  # one after the other
            return given[0]
        if called is len and isinstance(given[0].type, Array):
            length = given[0].type.shape[0]
            if length == 0:
                raise self.refused(node)
            text = f'{given[0].text}.count' if length is None else str(length)
            return Expression(text, WHOLE, 'int')
        if called is abs and given[0].type == 'int':
            return Expression(f'llabs({given[0].text})', WHOLE, 'int')
        if called in (math.sqrt, abs):
            name = 'sqrt' if called is math.sqrt else 'fabs'
            value = self._as(given[0], 'double', node)
            return Expression(f'{name}({value.text})', WHOLE, 'double')
        if called is int:
            whole = self._source.spelled('int')
            return Expression(f'({whole}){given[0].within(_UNARY)}', _UNARY, 'int')
        if called is float:
            return Expression(f'(double){given[0].within(_UNARY)}', _UNARY, 'double')
        if called is bool:
            return Expression(f'{given[0].within(_COMPARED + 2)} != 0', _COMPARED, 'int')
        if node.keywords:
            raise self.refused(node)
        if isinstance(called, type) and hasattr(called, '_fields'):
            return self._built(called, given, node)
        if not isinstance(plain(called), FunctionType):
            raise self.refused(node)
        defaults = plain(called).__defaults__ or ()
        missing = plain(called).__code__.co_argcount - len(given)
        arguments = [*node.args, *map(ast.Constant, defaults[len(defaults) - missing :])]
        given = [self.of(argument) for argument in arguments]
        written = self._source.function(called, tuple(one.type for one in given))
        texts = (
            self._as(self.of(argument, kind), kind, node).text
            for argument, kind in zip(arguments, written.parameters, strict=True)
        )
        return Expression(f'{written.name}({", ".join(texts)})', WHOLE, written.returns)

    def _by_address(self, node: ast.Call) -> Expression:
        """Return the call of the kernel that has an address when it flies (`calls.call`)."""
        tick, u, y, first = (self.of(node.args[i]) for i in (1, 2, 5, 6))
        stage, inputs = self._source.inner, f'{u.text}.at' if None in u.type.shape else u.text
        if not stage:
            raise self.refused(node)
        memory = f'&{stage}_p, &{stage}_m'
        text = f'{stage}_step({tick.text}, {inputs}, {memory}, {y.text} + {first.text})'
        return Expression(text, WHOLE, 'int')

    def _built(self, tuple_class: Any, parts: Sequence[Expression], node: ast.AST) -> Expression:
        """Return a named tuple of parts."""
        record = Record(tuple_class, True, is_value=True)
        values = (
            self._as(value, self._source.field(record, name), node).text
            for value, name in zip(parts, tuple_class._fields, strict=True)
        )
        text = f'({self._source.spelled(record)}){{{", ".join(values)}}}'
        return Expression(text, WHOLE, record)


_FUNCTIONS = {
    'int64_floor': """static int64_t int64_floor(int64_t a, int64_t b)
{
    return a / b - (a % b != 0 && (a < 0) != (b < 0));
}""",
    'int64_modulo': """static int64_t int64_modulo(int64_t a, int64_t b)
{
    const int64_t rest = a % b;
    return rest != 0 && (rest < 0) != (b < 0) ? rest + b : rest;
}""",
    'int64_product': """static int64_t int64_product(int64_t a, int64_t b)
{
    return (int64_t)((uint64_t)a * (uint64_t)b); /* it may wrap around */
}""",
}


class Source:
    """C99 source of some kernels, of what they call, and of the records that they read.

    inner : what the names of the stage begin with whose kernel the next one calls by its address
    """

    def __init__(self) -> None:
        self.inner = ''
        self._tuples: dict[str, str] = {}
        self._constants: dict[str, float] = {}
        self._functions: dict[Any, Written] = {}
        self._names: set[str] = set()  # of functions
        self._structs: dict[tuple[Any, bool], str] = {}
        self._typedefs: dict[str, str] = {}
        self._declarations: list[str] = []

    def declare(self, text: str) -> None:
        """Let functions use a variable that is defined after them."""
        self._declarations.append(text)

    def declared(self, type_: Type, name: str, fixed: bool = False) -> str:
        """Return a declaration of a name; fixed : it is written once."""
        if not isinstance(type_, Array) or None in type_.shape:
            text = f'{self.spelled(type_)} {name}'.replace('* ', '*')
            is_place = isinstance(type_, Record) and not type_.is_value
            return f'const {text}' if fixed and not is_place else text
        const = 'const ' if type_.is_const else ''
        sizes = ''.join(f'[{n}]' for n in type_.shape[1:])
        place = f'(*{name}){sizes}' if sizes else f'*{name}'
        return f'{const}{self._base(type_.base, type_.is_const)} {place}'

    def spelled(self, type_: Type) -> str:
        """Return a type as C has it."""
        if isinstance(type_, tuple):
            return self._tuple(type_)
        if isinstance(type_, Record) and type_.is_value:
            return self._value_struct(type_)
        if isinstance(type_, Record):
            const = 'const ' if type_.is_const else ''
            return f'{const}{self.struct(type_.base, type_.is_const)} *'
        if isinstance(type_, Array) and None not in type_.shape:
            return self.declared(type_, '')
        if isinstance(type_, Array):
            return self._list(type_.base, len(type_.shape), type_.is_const)
        return 'int64_t' if type_ == 'int' else str(type_)

    def _tuple(self, types: tuple[Type, ...]) -> str:
        spelled = list(map(self.spelled, types))
        if set(types) == {'double'}:
            name, fields = f'double{len(types)}', f'double at[{len(types)}];'
        else:
            pairs = zip(types, spelled, strict=True)
            letters = (k[0] if isinstance(k, str) else f'_{name}' for k, name in pairs)
            name = f'all_{"".join(letters)}'
            fields = ' '.join(f'{k} f{i};' for i, k in enumerate(spelled))
        self._tuples[name] = fields
        return name

    def field(self, record: Record, name: str) -> Type:
        """Return the type of a field of a record."""
        field = next(field for field in fields_of(record.base) if field.name == name)
        if field.shape and record.is_value:
            return ('double',) * (field.shape[0] or 0)
        if field.shape:
            return Array(field.base, field.shape, record.is_const)
        if field.base in (float, int):
            return 'double' if field.base is float else 'int'
        return Record(field.base, record.is_const)

    def _value_struct(self, record: Record) -> str:
        """Return the name of the struct of a named tuple that a kernel makes: it has no arrays."""
        fields = fields_of(record.base)
        if not any(field.shape for field in fields):
            return self.struct(record.base, True)
        types = ((f.name, self.spelled(self.field(record, f.name))) for f in fields)
        name = f'{record.base.__name__}_value'
        self._tuples[name] = ' '.join(f'{spelled} {own_name(f)};' for f, spelled in types)
        return name

    def struct(self, record: Any, is_const: bool) -> str:
        """Return the name of a record's struct; what arrays of any length hold may be const."""
        key = record, is_const or not _has_lists(record)
        if key not in self._structs:
            lines = [f'    {self._member(field, is_const)};' for field in fields_of(record)]
            name, taken = own_name(record.__name__), self._typedefs
            name = f'{name}_{len(taken)}' if name in taken else name
            self._structs[key] = name
            about = (inspect.getdoc(record) or '').replace('*/', '* /')
            body = '\n'.join(['typedef struct {', *lines, f'}} {name};'])
            self._typedefs[name] = f'/* {about} */\n{body}' if about else body
        return self._structs[key]

    def _base(self, base: Any, is_const: bool) -> str:
        if base in (float, int):
            return 'double' if base is float else 'int64_t'
        return self.struct(base, is_const)

    def _member(self, field: Field, is_const: bool) -> str:
        if not field.is_fixed:
            return f'{self._list(field.base, len(field.shape), is_const)} {own_name(field.name)}'
        sizes = ''.join(f'[{n}]' for n in field.shape)
        return f'{self._base(field.base, is_const)} {own_name(field.name)}{sizes}'

    def _list(self, base: Any, dimensions: int, is_const: bool) -> str:
        """Return the name of the struct of an array of any length."""
        of = self._base(base, is_const)
        const, words = ('const ', 'const_') if is_const else ('', '')
        name = f'{words}{of}_{"rows" if dimensions > 1 else "list"}'
        counts = 'count, width' if dimensions > 1 else 'count'
        self._typedefs[name] = f'typedef struct {{ {const}{of} *at; int64_t {counts}; }} {name};'
        return name

    def constant(self, name: str, value: float) -> str:
        """Return the name of a constant of a module; another one where two are different."""
        while self._constants.setdefault(name, value) != value:
            name = f'{name}_'
        return name

    def function(
        self, kernel: Callable[..., Any], given: Sequence[Type] = (), public: str = ''
    ) -> Written:
        """Return a kernel in C, written once for each types; raises InputError if it cannot be.

        public : its name, if others call it
        """
        function = plain(kernel)
        writer = Writer(self, read(function), given, bool(public))
        key = function, writer.key, public
        if key not in self._functions:
            name = public or f'rpo_{function.__name__}'
            name = f'{name}_{len(self._names)}' if name in self._names else name
            self._names.add(name)
            self._functions[key] = writer.written(name)
        return self._functions[key]

    def types(self) -> str:
        """Return the structs."""
        return '\n\n'.join(self._typedefs.values())

    def text(self) -> str:
        """Return types, constants and functions, each before what needs it."""
        functions = [written.text for written in self._functions.values()]
        body = '\n\n'.join(functions)
        tuples = '\n'.join(f'typedef struct {{ {f} }} {n};' for n, f in self._tuples.items())
        declarations = '\n'.join(self._declarations)
        used = (text for name, text in _FUNCTIONS.items() if f'{name}(' in body)
        blocks = [self.types(), tuples, self._numbers(), declarations, *used, *functions]
        return '\n\n'.join(filter(None, blocks))

    def _numbers(self) -> str:
        short = {n: isinstance(v, int) and abs(v) <= MAX_INT for n, v in self._constants.items()}
        whole = [f'{n} = {v}' for n, v in self._constants.items() if short[n]]
        lines = [wrapped(f'enum {{ {", ".join(whole)} }};')] if whole else []
        others = {n: v for n, v in self._constants.items() if not short[n]}
        return '\n'.join([*lines, *(f'#define {n} {number(v)}' for n, v in others.items())])


def _has_lists(record: Any) -> bool:
    return any(
        not field.is_fixed or (field.base not in (float, int) and _has_lists(field.base))
        for field in fields_of(record)
    )
