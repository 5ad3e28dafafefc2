# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios and controllers by name, path or object, and the names of what ships."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import wraps
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec, TypeGuard, TypeVar

import numpy as np
import yaml

from rpo.display import html_rows
from rpo_core import files
from rpo_core.control import controller as core
from rpo_core.control.controller import AnyController, Controller
from rpo_core.control.controller_file import ControllerFile, ControllerStage
from rpo_core.files.validation import (
    InputError,
    choice,
    missing_reported,
    near,
    printable,
    shown,
    within,
)
from rpo_core.scenario import overrides
from rpo_core.scenario import scenario as of_scenario
from rpo_core.scenario.scenario import Scenario, ScenarioSet
from rpo_core.stage import Signal, Stage

Value = TypeVar('Value')


class NameMissing(InputError, KeyError):
    """A name that a catalogue does not have."""

    __str__ = InputError.__str__  # KeyError would quote the sentence


class Catalogue(dict[str, Value]):
    """Name -> description, rate or number; shown as a table. An unknown name is an InputError."""

    def __missing__(self, name: str) -> Value:
        try:
            return self[choice('name', name, self)]
        except InputError as error:
            raise NameMissing(error) from None

    def __repr__(self) -> str:
        width = max(map(len, self), default=0)
        return '\n'.join(f'{name:{width}}  {printable(value)}' for name, value in self.items())

    def _repr_html_(self) -> str:
        return f'<table>{html_rows((name, str(value)) for name, value in self.items())}</table>'


Arguments = ParamSpec('Arguments')


def proposing(function: Callable[Arguments, Value]) -> Callable[Arguments, Value]:
    """Return a function whose error about an unknown field proposes a keyword that is near."""

    @wraps(function)
    def called(*args: Arguments.args, **keywords: Arguments.kwargs) -> Value:
        try:
            return function(*args, **keywords)
        except InputError as error:
            for key in keywords:
                hint = near(key, inspect.signature(function).parameters)
                if hint and f'`{key}` is not a known field' in str(error):
                    raise InputError(f'`{key}` is neither a keyword nor a field{hint}') from None
            raise

    return called


def scenarios() -> Catalogue[str]:
    """Return the scenarios that ship, and what each is.

    Returns
    -------
    Catalogue
        Name -> description, of single flights.

    Examples
    --------
    >>> import rpo
    >>> rpo.scenarios()['quick']
    "Five seconds with the paper's disturbance, for trying things out."
    """
    shipped = files.described('scenario').items()
    single = (row for row in shipped if row[1][1]['schema'] == of_scenario.SCHEMA)
    return Catalogue((name, text) for name, (text, _) in single)


def controllers() -> Catalogue[str]:
    """Return the controllers that ship, and what each is.

    Returns
    -------
    Catalogue
        Name -> description.

    Examples
    --------
    >>> import rpo
    >>> list(rpo.controllers())[:3]
    ['allround', 'apf_smc', 'drift']
    """
    return Catalogue((name, text) for name, (text, _) in files.described('controller').items())


def campaigns() -> Catalogue[str]:
    """Return the campaigns that ship, and what each flies.

    Returns
    -------
    Catalogue
        Name -> description.

    Examples
    --------
    >>> import rpo
    >>> rpo.campaigns()['paper_test']
    '10000 runs of allround in paper_test'
    """
    return Catalogue((name, text) for name, (text, _) in files.described('campaign').items())


class Source(NamedTuple):
    """A scenario or controller, and where it comes from.

    text : of its file; '' if it came as an object
    name : as it was named, or its name
    """

    subject: Any
    text: str
    name: str


def scenario_source(subject: object, fields: Mapping[str, Any]) -> Source:
    """Return a scenario with fields changed, the text of its file, and its name; see `scenario`."""
    source = mission_source(subject, fields)
    return source._replace(subject=of_scenario.single(source.subject, source.name))


def mission_source(subject: object, fields: Mapping[str, Any]) -> Source:
    """Return what `scenario_source` does, of a set of starts too."""
    if isinstance(subject, (str, Path)):
        name = str(subject)
        path = files.find('scenario', name)
        text, place = files.read_text(path), str(path)
    elif isinstance(subject, (Scenario, ScenarioSet)):
        if not fields:
            return Source(subject, '', subject.name)
        if isinstance(subject, ScenarioSet):
            raise InputError(f'scenario {subject.name}: fields of a set change by name or path')
        name = place = subject.name
        text = of_scenario.dumps(subject)
    elif isinstance(subject, Mapping):
        name = place = 'scenario'
        text = yaml.safe_dump(dict(subject), sort_keys=False)
    else:
        raise InputError(f'scenario: name, path or object expected; got {shown(subject)}')
    if fields:
        with within(f'scenario {name}'):
            text = overrides.changed(text, fields)
    return Source(files.loads(text, of_scenario.parse, place), text, name)


def fields_of(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of keyword arguments: with dots into sections, values as YAML has them."""
    return {key.replace('__', '.'): _plain(value) for key, value in changes.items()}


def _plain(value: Any) -> Any:
    """Return a value as YAML has it: NumPy's numbers and arrays, and tuples, become Python's."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if hasattr(value, 'tolist'):
        return value.tolist()
    return [_plain(item) for item in value] if isinstance(value, (list, tuple)) else value


def scenario(scenario: str | Path | Scenario | Mapping[str, Any], /, **changes: Any) -> Scenario:
    """Return a scenario, with fields changed.

    Parameters
    ----------
    scenario : str, Path, Scenario or mapping
        Name of one that ships (`scenarios`), path of a file, an object, or the document of a file.
    **changes
        Fields with their new values, as `rpo simulate --set` takes them; two underscores lead into
        a section: ``thrusters__delay_ticks=2``. None removes a field or section.

    Returns
    -------
    Scenario
        A frozen dataclass; the name of a changed one says so.

    Raises
    ------
    InputError
        If there is no such scenario or field, or a value is out of range.

    Examples
    --------
    >>> import rpo
    >>> rpo.scenario('paper_test', mass_kg=12.0)
    <Scenario paper_test (changed): 400 s from [10, 60, -40] m, 12 kg>
    >>> rpo.scenario('paper_test', thrusters__delay_ticks=2).thrusters.delay_ticks
    2
    >>> rpo.scenario('paper_test', masss_kg=12.0)
    Traceback (most recent call last):
        ...
    rpo_core.files.validation.InputError: scenario paper_test: `masss_kg` is not a known field; ...
    """
    found: Scenario = scenario_source(scenario, fields_of(changes)).subject
    return found


Law = Callable[[float, Any], Any]
"""A function of time [s] and state (6,) [m, m/s] that returns the force (3,) [N]."""


class LawStage(ControllerStage):
    """A function of the user in the chain; nobody knows whether it has memory."""

    memory_ticks = None

    def __init__(self, law: Law, dt_s: float) -> None:
        self._law, self._dt_s = law, dt_s

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return the commanded force (3,) [N] of a state (6,)."""
        answer = self._law(tick * self._dt_s, np.array(inputs[0]))
        try:
            force = np.asarray(answer, dtype=np.float64)
        except (TypeError, ValueError):
            force = np.empty(0)
        if force.shape != (3,) or not np.isfinite(force).all():
            raise InputError(
                'law(t, x) must return 3 finite forces [N], of shape (3,), for a state x '
                f'of shape (6,); got {shown(answer)}'
            )
        return (tuple(force.tolist()),)


@dataclass(frozen=True)
class LawController:
    """A function `law(t, x)` as a controller."""

    law: Law
    name: str = 'law'
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def stage(self, dt_s: float) -> Stage:
        """Return the controller as a stage of the chain."""
        return LawStage(self.law, dt_s)


def _check_arguments(law: Callable[..., Any]) -> None:
    """Raise InputError if a function cannot be called as law(t, x)."""
    try:
        signature = inspect.signature(law)
    except ValueError:  # of a built-in one
        return
    try:
        signature.bind(0.0, np.zeros(6))
    except TypeError:
        raise InputError(
            f'controller: function law(t, x) expected; got one of {signature}'
        ) from None


def controller_source(subject: object) -> Source:
    """Return a controller, the text of its file, and its name; a function may be one."""
    if isinstance(subject, (str, Path)):
        path = files.find('controller', str(subject))
        text = files.read_text(path)
        return Source(files.loads(text, core.parse, str(path)), text, str(subject))
    if isinstance(subject, Mapping):
        with within('controller'):
            loaded = core.parse(subject)
        return Source(loaded, '', loaded.name)
    if hasattr(subject, 'stage') and hasattr(subject, 'name'):
        return Source(subject, '', str(subject.name))
    if callable(subject):
        _check_arguments(subject)
        name = getattr(subject, '__name__', type(subject).__name__)
        name = 'law' if name == '<lambda>' else name
        return Source(LawController(subject, name), '', name)
    raise InputError(
        f'controller: name, path, object or function law(t, x) expected; got {shown(subject)}'
    )


def has_file(controller: object) -> TypeGuard[AnyController]:
    """Return whether a controller can be written to a file, which logs and campaigns carry."""
    return isinstance(controller, (core.FuzzyController, ControllerFile))


def file_source(subject: object) -> Source:
    """Return a controller that has a file, its text, and its name; raises InputError."""
    source = controller_source(subject)
    if not has_file(source.subject):
        raise InputError(
            f'controller: name, path or object of a controller file expected; {source.name} has '
            'no file'
        )
    return source._replace(text=source.text or core.dumps(source.subject))


def controller(controller: str | Path | AnyController | Mapping[str, Any], /) -> AnyController:
    """Return a controller.

    Parameters
    ----------
    controller : str, Path, controller or mapping
        Name of one that ships (`controllers`), path of a file, an object, or the document of a
        file.

    Returns
    -------
    FuzzyController or ControllerFile
        A frozen dataclass that answers states: ``law(t, x)``, ``law(position=..., velocity=...)``.

    Raises
    ------
    InputError
        If there is no such controller.

    Examples
    --------
    >>> import rpo
    >>> law = rpo.controller('allround')
    >>> law(position=[-10.0, 0.0, 10.0], velocity=0.0).round(3).tolist()
    [0.223, 0.0, -0.223]
    """
    loaded: AnyController = controller_source(controller).subject
    return loaded


def plot(controller: str | Path | AnyController, what: str = 'surface') -> Any:
    """Draw how a controller decides.

    Parameters
    ----------
    controller : str, Path or controller
        Name, path or object, see `controller`.
    what : str
        `surface`: the force over position and velocity. Of a fuzzy controller also its `rules`, or
        the membership functions of their `words`.

    Returns
    -------
    matplotlib Figure
        A notebook shows it; ``figure.savefig('surface.png')`` writes it.

    Raises
    ------
    InputError
        If the controller is none, has no rules, or matplotlib is not installed.

    Examples
    --------
    >>> import rpo
    >>> len(rpo.plot('allround', 'words').axes)
    3
    """
    law = file_source(controller).subject
    choice('what', what, ('surface', 'rules', 'words'))
    with missing_reported():
        from rpo.reports import controller as pictures
        from rpo_log.show import style

        with style.applied():
            if what == 'surface':
                return pictures.control_surface(law)
            fuzzy = core.only_fuzzy(law)
            return pictures.rules(fuzzy) if what == 'rules' else pictures.words(fuzzy)


AnyLaw = str | Path | AnyController | Controller | Law | Mapping[str, Any]
"""What flies: a name, a path, an object, a function, or the document of a file."""
