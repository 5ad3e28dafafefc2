# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Checks at the edge: every message names the thing, what was expected and what came."""

from __future__ import annotations

import difflib
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Annotated, Any, ClassVar, get_type_hints

from rpo_core.files import gone

MOST_SHOWN = 2000
"""Characters of a foreign text that are shown; a field of a log may have as many as it likes."""


def printable(text: object, most: int = MOST_SHOWN) -> str:
    r"""Return a foreign text as one line that is safe on a terminal and in a log.

    Escape sequences, newlines and marks that turn the direction of writing become escapes like
    `\x1b`; of a longer text, the first `most` characters stay. What is printable stays as it is.
    """
    line = str(text)
    line = line if len(line) <= most else f'{line[: most - 3]}...'
    return line if line.isprintable() else ''.join(map(_escaped, line))


def _escaped(character: str) -> str:
    return character if character.isprintable() else repr(character)[1:-1]


class InputError(ValueError):
    """A value from a user is not usable; the message is one printable sentence.

    Examples
    --------
    >>> import rpo
    >>> try:
    ...     rpo.fly(3)
    ... except rpo.InputError as error:
    ...     print(error)
    scenario: name, path or object expected; got 3
    """

    def __init__(self, sentence: object) -> None:
        super().__init__(printable(sentence))


def shown(value: Any, limit: int = 60) -> str:
    """Return `value` as it is quoted in an error, cut to `limit` characters."""
    text = repr(value)
    return text if len(text) <= limit else f'{text[: limit - 3]}...'


def quoted(name: str) -> str:
    """Return a name from a file as an error quotes it: in backticks, if short and printable."""
    return f'`{name}`' if name.isprintable() and len(name) <= 80 else shown(name)


@contextmanager
def within(place: str) -> Iterator[None]:
    """Prefix an InputError raised inside with its place: a file, or a field of one."""
    try:
        yield
    except InputError as error:
        raise InputError(f'{place}: {error}') from None


MOST_NAME = 200
"""Longest name of a scenario, of a controller, of a table; ours have 20 characters."""

MOST_PATH = 4096
"""Longest path; Linux has no longer one."""


def store(instance: Any, **checked: Any) -> None:
    """Set checked values of a frozen dataclass from its `__post_init__`."""
    for name, value in checked.items():
        object.__setattr__(instance, name, value)


class Checked:
    """A frozen dataclass whose fields are checked and stored as it is made.

    The annotation of a field holds its check, which takes the name and the value:
    `mass_kg: Annotated[float, partial(real, unit='kg', above=0.0)]`. Raises InputError.

    PLACE : of the fields in errors, as `ga.`
    """

    PLACE: ClassVar[str] = ''

    def __post_init__(self) -> None:
        kind: Any = type(self)
        values = vars(self)
        for name, check in _checks(kind):
            values[name] = check(f'{self.PLACE}{name}', values[name])


@cache
def _checks(kind: Any) -> tuple[tuple[str, Callable[[str, Any], Any]], ...]:
    hints = get_type_hints(kind, include_extras=True)
    return tuple(
        (name, check) for name, hint in hints.items() for check in getattr(hint, '__metadata__', ())
    )


def real(
    name: str,
    value: Any,
    unit: str = '',
    *,
    above: float | None = None,
    least: float | None = None,
    most: float | None = None,
    below: float | None = None,
) -> float:
    """Return a finite float within (above, below) and [least, most].

    Raises
    ------
    InputError
        If `value` is not a number, not finite or out of range.
    """
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    number = math.inf  # float() of a huge int raises
    if is_number and abs(value) < 1e300:
        number = float(value)
    inside = (
        (above is None or number > above)
        and (least is None or number >= least)
        and (most is None or number <= most)
        and (below is None or number < below)
    )
    if math.isfinite(number) and inside:
        return number
    bounds = [
        f'{sign} {bound:g}'
        for sign, bound in (('>', above), ('>=', least), ('<=', most), ('<', below))
        if bound is not None
    ]
    expected = ' '.join(filter(None, ['a finite number', ' and '.join(bounds), unit]))
    hint = '' if is_number else _number_hint(value)
    raise InputError(f'`{name}` must be {expected}; got {shown(value)}{hint}')


def _number_hint(value: Any) -> str:
    """Return why a text that looks like a number is none to YAML, '' if it does not look so."""
    try:
        number = float(value) if isinstance(value, str) else math.nan
    except ValueError:
        return ''
    if not math.isfinite(number):
        return ''
    if 'e' in value.lower():
        return '; YAML wants a point and a signed exponent, like 1.0e-3 or 1.0e+3'
    return '; without the quotes it is a number'


def optional(name: str, value: Any, check: Callable[..., Any] = real, **limits: Any) -> Any:
    """Return what a check returns, None of None; raises InputError."""
    return None if value is None else check(name, value, **limits)


def whole(name: str, value: Any, *, least: int, most: int | None = None) -> int:
    """Return an int within [least, most]; raises InputError."""
    inside = (
        isinstance(value, int)
        and not isinstance(value, bool)
        and value >= least
        and (most is None or value <= most)
    )
    if not inside:
        upper = '' if most is None else f' and <= {most}'
        raise InputError(f'`{name}` must be a whole number >= {least}{upper}; got {shown(value)}')
    return int(value)


def flag(name: str, value: Any) -> bool:
    """Return `value` if it is true or false; raises InputError."""
    if not isinstance(value, bool):
        raise InputError(f'`{name}` must be true or false; got {shown(value)}')
    return value


def vector3(name: str, value: Any, unit: str, *, bound: float) -> tuple[float, float, float]:
    """Return three finite floats, each within `bound` of zero; raises InputError."""
    if type(value) is tuple and len(value) == 3 and _are_floats(value, bound):
        return value
    if hasattr(value, 'tolist'):  # a NumPy array
        value = value.tolist()
    if isinstance(value, (str, bytes)) or not isinstance(value, Sequence) or len(value) != 3:
        raise InputError(
            f'`{name}` must be a list of 3 numbers [x, y, z] in {unit}; got {shown(value)}'
        )
    x, y, z = (
        real(f'{name}[{i}]', component, unit, least=-bound, most=bound)
        for i, component in enumerate(value)
    )
    return x, y, z


def _are_floats(values: Sequence[Any], bound: float) -> bool:
    """Return whether `real` would return them as they are; a run of a campaign has hundreds."""
    return all(type(value) is float and -bound <= value <= bound for value in values)


def matrix(
    name: str, value: Any, rows: int, columns: int, *, bound: float
) -> tuple[tuple[float, ...], ...]:
    """Return rows of finite floats, each within `bound` of zero; raises InputError."""
    if hasattr(value, 'tolist'):  # a NumPy array
        value = value.tolist()
    lists = (list, tuple)
    right = isinstance(value, lists) and len(value) == rows
    if not right or not all(isinstance(row, lists) and len(row) == columns for row in value):
        raise InputError(f'`{name}` must be {rows} rows of {columns} numbers; got {shown(value)}')
    if all(_are_floats(row, bound) for row in value):
        return tuple(map(tuple, value))
    return tuple(
        tuple(
            real(f'{name}[{i}][{j}]', number, least=-bound, most=bound)
            for j, number in enumerate(row)
        )
        for i, row in enumerate(value)
    )


def text(name: str, value: Any, *, most: int = MOST_NAME) -> str:
    """Return a printable line of at most `most` characters, not blank; raises InputError."""
    if not isinstance(value, str) or not value.strip():
        raise InputError(f'`{name}` must be a text; got {shown(value)}')
    if not value.isprintable():
        raise InputError(f'`{name}` must be printable, in one line; got {shown(value)}')
    if len(value) > most:
        raise InputError(
            f'`{name}` must be at most {most} characters; got {len(value)}: {shown(value)}'
        )
    return value


def description(name: str, value: Any) -> str:
    """Return a printable string, of any number of lines, or empty; raises InputError."""
    if not isinstance(value, str):
        raise InputError(f'`{name}` must be a text; got {shown(value)}')
    if not all(c.isprintable() or c in '\n\t' for c in value):
        raise InputError(f'`{name}` must be printable; got {shown(value)}')
    return value


def provenance(name: str, value: Any) -> dict[str, Any]:
    """Return a mapping of whatever texts and numbers; raises InputError."""
    if not isinstance(value, Mapping):
        raise InputError(f'`{name}` must be a mapping; got {shown(value)}')
    return dict(value)


Name = Annotated[str, text]
Description = Annotated[str, description]
Provenance = Annotated[Mapping[str, Any], provenance]
"""Annotations of fields, see `Checked`."""


def choice(name: str, value: Any, known: Iterable[str]) -> str:
    """Return `value` if it is one of `known`; raises InputError listing them."""
    names = list(known)
    if not isinstance(value, str) or value not in names:
        if answer := gone.answer(name.rpartition('.')[2], value):
            raise InputError(f'`{name}` {value} is {answer}')
        hint = near(value, names)
        raise InputError(f'`{name}` must be one of {", ".join(names)}; got {shown(value)}{hint}')
    return value


def near(value: Any, names: Iterable[str]) -> str:
    """Return the end of a sentence that proposes the nearest of some names; '' if none is near."""
    names_like_it = difflib.get_close_matches(str(value)[:MOST_NAME], list(names), n=1)
    return f'; did you mean `{names_like_it[0]}`?' if names_like_it else ''


def mapping(
    name: str, value: Any, required: Iterable[str], optional: Iterable[str] = ()
) -> Mapping[str, Any]:
    """Return `value` if it is a mapping with all `required` keys and no unknown ones.

    Raises
    ------
    InputError
        Naming the first missing or unknown key, with the nearest known one.
    """
    required, names = list(required), [*required, *optional]
    label = f'`{name}`' if name else 'the document'
    prefix = f'{name}.' if name else ''
    if not isinstance(value, Mapping):
        raise InputError(f'{label} must be a mapping with {_listed(names)}; got {shown(value)}')
    for key in value:
        if key not in names:
            if answer := gone.answer('field', f'{prefix}{key}'):
                raise InputError(f'`{prefix}{key}` is {answer}')
            hint = near(key, names) or f'; known: {_listed(names)}'
            raise InputError(f'{quoted(f"{prefix}{key}")} is not a known field{hint}')
    for key in required:
        if key not in value:
            raise InputError(f'`{prefix}{key}` is missing')
    return value


def _listed(names: Sequence[str]) -> str:
    """Return names as an error lists them: the first 14, if there are more."""
    return ', '.join(names[:14]) + (', ...' if len(names) > 14 else '')


def schema(document: Any, *known: str) -> str:
    """Return the field `schema` of a document; raises InputError if it is none of `known`.

    Looked at before the other fields, for a file of a newer version has others. What is no mapping,
    or has the field misspelt, is left to `mapping`.
    """
    if not isinstance(document, Mapping):
        return ''
    if 'schema' not in document:
        if difflib.get_close_matches('schema', map(str, document), n=1):
            return ''
        raise InputError('`schema` is missing')
    found = document['schema']
    if not isinstance(found, str) or found not in known:
        if answer := gone.answer('schema', found):
            raise InputError(f'`schema` {found} is {answer}')
        raise InputError(
            f'`schema` must be {" or ".join(known)}; got {shown(found)}{_kinds(found, known)}'
        )
    return found


def _kinds(found: Any, known: Sequence[str]) -> str:
    """Return the end of a sentence that calls a file by its kind, if it is of another one."""
    kind, *wanted = (str(name).split('/')[1:2] for name in (found, *known))
    if not str(found).startswith('rpo/') or kind in wanted:
        return ''
    names = dict.fromkeys(' '.join(name).replace('_', ' ') for name in wanted)
    return f': this is a {printable(kind[0][:60])} file; expected a {" or a ".join(names)}'


INSTALLED_BY: dict[str, str] = {}
"""Module -> command that installs it, where that is not pip with its name; `rpo` adds its own."""

_BY_PIP = {
    **dict.fromkeys(('mcap', 'zstandard', 'lz4'), 'mcap'),
    **{name: name for name in ('rosbags', 'cryptography', 'matplotlib', 'pandas', 'xarray')},
}
"""What brings a module: mcap brings the libraries of compression too."""


def missing_library(module: str | None) -> str | None:
    """Return how to install a missing module; None if it is none of these.

    module : its full name, as ModuleNotFoundError has it
    """
    top = (module or '').partition('.')[0]
    install = INSTALLED_BY.get(top, '')
    if not install and top in _BY_PIP:
        # Outside a virtual environment Debian and Ubuntu refuse pip; `--user` touches nothing of
        # apt.
        options = '' if sys.prefix != sys.base_prefix else '--user --break-system-packages '
        install = f'`python3 -m pip install {options}{_BY_PIP[top]}`'
    return f'the Python library {top} is missing: {install} installs it' if install else None


@contextmanager
def missing_reported() -> Iterator[None]:
    """Make the import of a missing library inside an InputError that says how to install it."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (sentence := missing_library(error.name)) is None:
            raise
        raise InputError(sentence) from None
