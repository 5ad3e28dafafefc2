# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A kernel as a C99 function, statement by statement."""

from __future__ import annotations

import ast
import textwrap
from collections import Counter
from collections.abc import Sequence
from typing import Any

from rpo_export.c_expressions import Expression, Expressions, Surroundings, Written, own_name
from rpo_export.kernel_source import Read, Type

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


class _Block:
    """Where a block begins: names that are declared in it end with it."""

    def __init__(self, statements: Sequence[ast.stmt], depth: int) -> None:
        self.uses, self.depth = _uses(statements), depth


class Writer:
    """Writes one kernel under a name; `given` are the types of its arguments."""

    def __init__(
        self, source: Surroundings, kernel: Read, name: str, given: Sequence[Type]
    ) -> None:
        self._source, self._tree, self._hints = source, kernel.tree, kernel.hints
        self._name = name
        self._all, self._stores = _uses(kernel.tree.body), _uses(kernel.tree.body, ast.Store)
        self._loads = _uses(kernel.tree.body, ast.Load)
        self._c = Expressions(source, kernel.names, self._tree.name)
        names = [argument.arg for argument in self._tree.args.args]
        for i, name in enumerate(names):
            known = given[i] if i < len(given) else None
            hint = self._hints.get(name)
            table = isinstance(known, str) and known not in ('int', 'double')
            self._c.types[name] = known if table or hint is None else hint
        self._parameters = tuple(self._c.types.items())
        self._returns = self._hints['return']
        self._early: list[str] = []
        self._copies = 0

    def written(self) -> Written:
        """Return the function; raises InputError for what kernels do not use."""
        body, document = self._tree.body, ast.get_docstring(self._tree)
        body = body[1:] if document else body
        idle = [f'    (void){own_name(n)};' for n, _ in self._parameters if not self._loads[n]]
        lines = self._block(body, 1)
        head = ', '.join(
            f'{self._source.spelled(kind)} {own_name(name)}'.replace('* ', '*')
            for name, kind in self._parameters
        )
        first = (document or '').split('\n\n')[0].replace('*/', '* /')
        comment = wrapped(f'/* {" ".join(first.split())} */') + '\n' if first else ''
        text = '\n'.join(
            [
                wrapped(f'static {self._source.spelled(self._returns)} {self._name}({head})'),
                '{',
                *self._early,
                *idle,
                *lines,
                '}',
            ]
        )
        kinds = tuple(kind for _, kind in self._parameters)
        return Written(self._name, comment + text, kinds, self._returns)

    def _block(self, statements: Sequence[ast.stmt], depth: int) -> list[str]:
        block, before, lines = _Block(statements, depth), dict(self._c.types), []
        for statement in statements:
            lines += self._statement(statement, block)
        hoisted = {n: k for n, k in self._c.types.items() if n in self._hoisted()}
        self._c.types = {**hoisted, **before}
        return lines

    def _hoisted(self) -> set[str]:
        return {line.split()[-1].rstrip(';') for line in self._early}

    def _statement(self, node: ast.stmt, block: _Block) -> list[str]:
        method: Any = getattr(self, f'_{type(node).__name__.lower()}', None)
        if method is None:
            raise self._c.refused(node)
        found: list[str] = method(node, block)
        return found

    def _return(self, node: ast.Return, block: _Block) -> list[str]:
        if node.value is None:
            raise self._c.refused(node)
        return [wrapped(f'return {self._c.of(node.value, self._returns).text};', block.depth)]

    def _break(self, node: ast.Break, block: _Block) -> list[str]:
        return [wrapped('break;', block.depth)]

    def _continue(self, node: ast.Continue, block: _Block) -> list[str]:
        return [wrapped('continue;', block.depth)]

    def _augassign(self, node: ast.AugAssign, block: _Block) -> list[str]:
        target = node.target
        if not isinstance(target, ast.Name):
            raise self._c.refused(node)
        whole = ast.BinOp(ast.Name(target.id, ast.Load()), node.op, node.value)
        return [self._stored(target.id, self._c.of(whole), block)]

    def _assign(self, node: ast.Assign, block: _Block) -> list[str]:
        first, *rest = reversed(node.targets)
        if isinstance(first, ast.Tuple):
            if rest:
                raise self._c.refused(node)
            return self._unpacked(first, node.value, block)
        lines = [self._named(first, self._c.of(node.value), block)]
        for target in rest:  # a = b = value: the same value for all
            if isinstance(first, ast.Name):
                lines.append(self._named(target, self._c.of(first), block))
        return lines

    def _named(self, target: ast.expr, value: Expression, block: _Block) -> str:
        if not isinstance(target, ast.Name):
            raise self._c.refused(target)
        return self._stored(target.id, value, block)

    def _unpacked(self, target: ast.Tuple, value: ast.expr, block: _Block) -> list[str]:
        names = [part.id if isinstance(part, ast.Name) else '' for part in target.elts]
        if isinstance(value, ast.Tuple):
            later = [_uses(value.elts[i + 1 :]) for i in range(len(names))]
            if any(later[i][name] for i, name in enumerate(names)):
                return self._through_copies(names, value, block)
            pairs = zip(names, map(self._c.of, value.elts), strict=True)
            return [self._stored(name, one, block) for name, one in pairs if self._loads[name]]
        whole, lines = self._c.of(value), []
        if not isinstance(value, ast.Name):
            text, self._copies = whole.text, self._copies + 1
            name = f'found{self._copies}' if self._copies > 1 else 'found'
            kind = self._source.spelled(whole.type)
            lines.append(wrapped(f'const {kind} {name} = {text};', block.depth))
            whole = Expression(name, whole.rank, whole.type)
        for i, name in enumerate(names):
            if self._loads[name]:
                lines.append(self._stored(name, self._c.part(whole, str(i), value), block))
        return lines

    def _through_copies(self, names: list[str], value: ast.Tuple, block: _Block) -> list[str]:
        copies, lines = [], []
        for name, part in zip(names, value.elts, strict=True):
            one = self._c.of(part)
            copies.append(Expression(f'new_{name}', one.rank, one.type))
            kind = self._source.spelled(one.type)
            lines.append(wrapped(f'const {kind} new_{name} = {one.text};', block.depth))
        pairs = zip(names, copies, strict=True)
        return lines + [self._stored(name, copy, block) for name, copy in pairs]

    def _stored(self, name: str, value: Expression, block: _Block) -> str:
        text = f'{own_name(name)} = {value.text};'
        if name not in self._c.types:
            self._c.types[name] = value.type
            kind = self._source.spelled(value.type)
            if block.uses[name] == self._all[name]:
                text = f'{"const " if self._stores[name] == 1 else ""}{kind} {text}'
            else:
                self._early.append(f'    {kind} {own_name(name)};')
        return wrapped(text, block.depth)

    def _if(self, node: ast.If, block: _Block) -> list[str]:
        lines = [wrapped(f'if ({self._c.of(node.test).text}) {{', block.depth)]
        lines += self._block(node.body, block.depth + 1)
        if len(node.orelse) == 1 and isinstance(node.orelse[0], ast.If):
            first, *rest = self._if(node.orelse[0], block)
            return [*lines, wrapped(f'}} else {first.strip()}', block.depth), *rest]
        if node.orelse:
            lines.append(wrapped('} else {', block.depth))
            lines += self._block(node.orelse, block.depth + 1)
        return [*lines, wrapped('}', block.depth)]

    def _while(self, node: ast.While, block: _Block) -> list[str]:
        lines = [wrapped(f'while ({self._c.of(node.test).text}) {{', block.depth)]
        return [*lines, *self._block(node.body, block.depth + 1), wrapped('}', block.depth)]

    def _for(self, node: ast.For, block: _Block) -> list[str]:
        call = node.iter
        if not (
            isinstance(node.target, ast.Name)
            and isinstance(call, ast.Call)
            and ast.unparse(call.func) == 'range'
        ):
            raise self._c.refused(node)
        start, stop, step = {
            1: lambda a: ('0', a[0], '1'),
            2: lambda a: (a[0], a[1], '1'),
            3: lambda a: (a[0], a[1], a[2]),
        }[len(call.args)]([self._c.of(argument).text for argument in call.args])
        name = own_name(node.target.id)
        self._c.types[node.target.id] = 'int'
        more = f'{name}++' if step == '1' else f'{name} += {step}'
        head = f'for (int {name} = {start}; {name} < {stop}; {more}) {{'
        lines = [wrapped(head, block.depth), *self._block(node.body, block.depth + 1)]
        del self._c.types[node.target.id]
        return [*lines, wrapped('}', block.depth)]
