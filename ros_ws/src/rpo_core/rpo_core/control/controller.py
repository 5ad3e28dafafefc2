# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Controllers and their files: the fuzzy one; other kinds register (`controller_file`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Protocol

import yaml

from rpo_core import files
from rpo_core.control import controller_file, inference
from rpo_core.control.controller_file import (
    SCHEMA,
    ControllerBase,
    ControllerFile,
    ControllerStage,
    Scaling,
)
from rpo_core.control.fuzzy import WORDS, FuzzySystem, MembershipFunctions, RuleTable, odd_samples
from rpo_core.files import codec
from rpo_core.files.validation import (
    Description,
    InputError,
    Name,
    Provenance,
    choice,
    mapping,
    real,
    schema,
    shown,
)
from rpo_core.kernels.records import prepared
from rpo_core.stage import KernelStage, Stage

FUZZY = 'fuzzy'
"""Kind of a file that names none."""

SYMMETRIES = ('free', 'transpose', 'odd')
"""What a file claims of its rules: nothing; rule(i, j) = rule(j, i); and f(-e, -v) = -f(e, v)."""

INFERENCE = {
    'and': 'min',
    'implication': 'min',
    'aggregation': 'max',
    'defuzzification': 'centroid',
}

SYSTEM_FIELDS = ('membership_functions', 'rules', 'inference')
"""Fields of a file that hold the paper's fuzzy system."""

_VARIABLES = ('position', 'velocity', 'force')
_SCALES = {'position_m': 'm', 'velocity_m_s': 'm/s', 'force_n': 'N'}
_POWERS = ((1, 0, 0), (1, -1, 0), (0, 0, 1))


class Controller(Protocol):
    """Whatever makes a stage that answers a relative state with a force."""

    @property
    def name(self) -> str:
        """Name of the controller."""

    @property
    def provenance(self) -> Mapping[str, Any]:
        """How it came to be."""

    def stage(self, dt_s: float) -> Stage:
        """Return the controller as a stage of the chain; with memory, one for each flight.

        Raises InputError if it counts ticks of another length than `dt_s`.
        """


class FuzzyStage(KernelStage, ControllerStage):
    """The fuzzy controller in the chain; its force follows from the state alone."""

    counts_ticks = False
    kernel = inference.command

    def __init__(self, controller: FuzzyController) -> None:
        super().__init__(controller.law)


_scale = partial(real, above=0.0, most=1e6)


@dataclass(frozen=True, repr=False)
class FuzzyController(ControllerBase):
    """One fuzzy inference system for each axis alike, with its scales; frozen.

    It is a function: ``law(t, x)`` answers states, ``law(position=..., velocity=...)`` an axis.

    Parameters
    ----------
    name : str
        How files, logs and tables name it.
    system : FuzzySystem
        Rules and membership functions, normalised.
    position_scale_m, velocity_scale_m_s : float
        The error that saturates an input.
    force_scale_n : float
        Force at full output, the paper's maximum force.
    description : str
        What it is, in a sentence.
    provenance : mapping
        How it came to be; free text and numbers, not read by the control.

    Raises
    ------
    InputError
        If a scale is not positive.

    Examples
    --------
    >>> import rpo
    >>> law = rpo.controller('allround')
    >>> law.rules
    position error      LN  SN   Z  SP  LP
    velocity error LN   LN  LN  SN  SN   Z
    velocity error SN   LN  LN  SN   Z  SP
    velocity error Z    SN  SN   Z  SP  SP
    velocity error SP   SN   Z  SP  LP  LP
    velocity error LP    Z  SP  SP  LP  LP
    """

    kind: ClassVar[str] = FUZZY
    alike: ClassVar[bool] = True

    name: Name
    system: FuzzySystem
    position_scale_m: Annotated[float, partial(_scale, unit='m')]
    velocity_scale_m_s: Annotated[float, partial(_scale, unit='m/s')]
    force_scale_n: Annotated[float, partial(_scale, unit='N')]
    description: Description = field(default='', compare=False)
    provenance: Provenance = field(default_factory=dict, compare=False)

    def __str__(self) -> str:
        return f'{self!r}\n{self.rules}'

    @property
    def rules(self) -> RuleTable:
        """Its 25 rules, which print as a table: the words of the force."""
        return self.system.rules

    @property
    def scales(self) -> tuple[float, float, float]:
        """Position [m], velocity [m/s] and force [N] scale."""
        return self.position_scale_m, self.velocity_scale_m_s, self.force_scale_n

    @cached_property
    def law(self) -> Any:
        """What the kernel reads."""
        return prepared(inference.FuzzyLaw(self.scales, self.system.tables))

    def scaled(self, scaling: Scaling) -> FuzzyController:
        """Return the controller of the similar loop; raises InputError where it is out of range."""
        position, velocity, force = _POWERS
        return replace(
            self,
            position_scale_m=scaling.of(self.position_scale_m, position),
            velocity_scale_m_s=scaling.of(self.velocity_scale_m_s, velocity),
            force_scale_n=scaling.of(self.force_scale_n, force),
        )

    def stage(self, dt_s: float) -> Stage:
        """Return the controller as a stage of the chain; it fits ticks of any length."""
        return FuzzyStage(self)

    def with_rule(self, position: str, velocity: str, force: str) -> FuzzyController:
        """Return the controller with one rule of its table changed.

        Words are LN, SN, Z, SP, LP: large negative, small negative, zero, small positive, large
        positive. The other 24 rules stay: to keep an odd table odd, change the mirrored rule too,
        that of the opposite words, to the opposite force.

        Parameters
        ----------
        position, velocity : str
            Words of the errors of an axis that the rule is for; an error is minus the position,
            minus the velocity.
        force : str
            Word of the force that the rule commands.

        Returns
        -------
        FuzzyController
            Another one; this one stays as it is.

        Raises
        ------
        InputError
            If a word is not one of the five.

        Examples
        --------
        >>> import rpo
        >>> law = rpo.controller('allround').with_rule(position='SP', velocity='Z', force='LP')
        >>> law
        <FuzzyController allround (changed): position SP, velocity Z: force LP>
        >>> rpo.fly('paper_test', law).ok
        True
        >>> law.rules.is_odd, law.with_rule('SN', 'Z', 'LN').rules.is_odd
        (False, True)
        """
        words = {'position': position, 'velocity': velocity, 'force': force}
        column, row, code = (WORDS.index(choice(n, word, WORDS)) for n, word in words.items())
        codes = self.system.rules.codes.copy()
        codes[row, column] = code
        rules = RuleTable.from_codes(codes)
        change = f'position {position}, velocity {velocity}: force {force}'
        return self._changed(change, rules=rules)

    def with_membership(self, variable: str, **numbers: float) -> FuzzyController:
        """Return the controller with the membership functions of a variable changed.

        Parameters
        ----------
        variable : str
            position, velocity or force.
        **numbers : float
            Any of z_half_width, sp_left, sp_centre, sp_right, lp_left: half the foot of the
            triangle Z; feet and peak of SP; left foot of LP, whose peak is 1. SN and LN mirror SP
            and LP. They are shares of the scale of the variable, see `scales`.

        Returns
        -------
        FuzzyController
            Another one; this one stays as it is.

        Raises
        ------
        InputError
            If there is no such variable or number, or the triangles would not be in order.

        Examples
        --------
        >>> import rpo
        >>> law = rpo.controller('allround').with_membership('position', z_half_width=0.1)
        >>> law.system.position.z_half_width
        0.1
        """
        functions = getattr(self.system, choice('variable', variable, _VARIABLES))
        for name in numbers or ['']:
            choice('numbers', name, asdict(functions))
        change = ', '.join(f'{name} {value!r}' for name, value in numbers.items())
        return self._changed(f'{variable}: {change}', **{variable: replace(functions, **numbers)})

    def _changed(self, change: str, **parts: Any) -> FuzzyController:
        """Return the controller with parts of its system changed; its name and text say so."""
        first = self.name.endswith(files.CHANGED)
        return replace(
            self,
            name=self.name if first else self.name + files.CHANGED,
            description=f'{self.description}; {change}' if first else change,
            system=replace(self.system, **parts),
            provenance={
                **self.provenance,
                'changed': [*self.provenance.get('changed', ()), change],
            },
        )


AnyController = FuzzyController | ControllerFile
"""What a controller file holds; its `kind` says which, a file without one is fuzzy."""


def parse(document: Any) -> AnyController:
    """Return the controller of a parsed YAML document; raises InputError."""
    schema(document, SCHEMA)
    if isinstance(document, Mapping) and document.get('kind', FUZZY) != FUZZY:
        choice('kind', document['kind'], [FUZZY, *controller_file.kinds()])
        return controller_file.parse(document)
    return _parse_fuzzy(document)


def _parse_fuzzy(document: Any) -> FuzzyController:
    data = mapping(
        '',
        document,
        ['schema', 'name', 'scales', *SYSTEM_FIELDS],
        ['kind', 'description', 'provenance'],
    )
    scales = mapping('scales', data['scales'], _SCALES)
    position_scale, velocity_scale, force_scale = (
        _scale(f'scales.{key}', scales[key], unit) for key, unit in _SCALES.items()
    )
    return FuzzyController(
        name=data['name'],
        description=data.get('description', ''),
        system=parse_system(data, _VARIABLES),
        position_scale_m=position_scale,
        velocity_scale_m_s=velocity_scale,
        force_scale_n=force_scale,
        provenance=data.get('provenance', {}),
    )


def parse_system(data: Mapping[str, Any], variables: Sequence[str]) -> FuzzySystem:
    """Return the system of the fields `SYSTEM_FIELDS` of a document; raises InputError.

    variables : names of both inputs and of the output there
    """
    functions = mapping('membership_functions', data['membership_functions'], variables)
    position, velocity, force = (
        codec.from_mapping(MembershipFunctions, f'membership_functions.{name}', functions[name])
        for name in variables
    )
    rules, samples = _rules(data['rules']), _samples(data['inference'])
    return FuzzySystem(position, velocity, force, rules, samples)


def _rules(value: Any) -> RuleTable:
    data = mapping('rules', value, ['symmetry', 'columns', *WORDS])
    symmetry = choice('rules.symmetry', data['symmetry'], SYMMETRIES)
    if data['columns'] != list(WORDS):
        raise InputError(
            f'`rules.columns` must be [{", ".join(WORDS)}], the words of the position '
            f'error; got {shown(data["columns"])}'
        )
    for word in WORDS:
        if not isinstance(data[word], list) or len(data[word]) != 5:
            raise InputError(f'`rules.{word}` must be a list of 5 words; got {shown(data[word])}')
    table = RuleTable(tuple(tuple(data[word]) for word in WORDS))
    if symmetry != 'free' and not table.is_transpose_symmetric:
        raise InputError(f'`rules.symmetry` is {symmetry}, but the table is not its own transpose')
    if symmetry == 'odd' and not table.is_odd:
        raise InputError('`rules.symmetry` is odd, but rule(-e, -v) = -rule(e, v) does not hold')
    return table


def _samples(value: Any) -> int:
    data = mapping('inference', value, [*INFERENCE, 'samples'])
    for key, only in INFERENCE.items():
        choice(f'inference.{key}', data[key], [only])
    return odd_samples('inference.samples', data['samples'])


def to_document(controller: AnyController) -> dict[str, Any]:
    """Return the controller as the document that `parse` reads."""
    if isinstance(controller, ControllerFile):
        return {'schema': SCHEMA, **controller_file.to_document(controller)}
    return {
        'schema': SCHEMA,
        'name': controller.name,
        'description': controller.description,
        'scales': dict(zip(_SCALES, controller.scales, strict=True)),
        **system_document(controller.system, _VARIABLES),
        'provenance': dict(controller.provenance),
    }


def system_document(system: FuzzySystem, variables: Sequence[str]) -> dict[str, Any]:
    """Return the fields of a document that `parse_system` reads."""
    rules, symmetry = system.rules, 'free'
    if rules.is_transpose_symmetric:
        symmetry = 'odd' if rules.is_odd else 'transpose'
    parts = (system.position, system.velocity, system.force)
    return {
        'membership_functions': {n: asdict(p) for n, p in zip(variables, parts, strict=True)},
        'rules': {
            'symmetry': symmetry,
            'columns': list(WORDS),
            **{word: list(row) for word, row in zip(WORDS, rules.words, strict=True)},
        },
        'inference': {**INFERENCE, 'samples': system.samples},
    }


class _Dumper(yaml.SafeDumper):
    """YAML with rows of words in flow style, so that the rule table reads as a table."""

    def ignore_aliases(self, data: Any) -> bool:
        return True  # the reader refuses them


def _represent_list(dumper: yaml.SafeDumper, items: list[Any]) -> yaml.Node:
    flat = not any(isinstance(item, (list, dict)) for item in items)
    return dumper.represent_sequence('tag:yaml.org,2002:seq', items, flow_style=flat)


_Dumper.add_representer(list, _represent_list)


def dumps(controller: AnyController) -> str:
    """Return the YAML text of a controller; floats round-trip bit for bit."""
    return text_of(to_document(controller))


def text_of(document: Mapping[str, Any]) -> str:
    """Return the YAML text of the document of a controller."""
    return yaml.dump(document, Dumper=_Dumper, sort_keys=False, width=100, allow_unicode=True)


def load_controller(name: str | Path) -> AnyController:
    """Return the controller of a shipped name or a path; raises InputError."""
    return files.load(files.find('controller', str(name)), parse)


def load_fuzzy(name: str | Path) -> FuzzyController:
    """Return a fuzzy controller; a baseline, which has no rules to show, is refused."""
    return only_fuzzy(load_controller(name))


def only_fuzzy(controller: AnyController) -> FuzzyController:
    """Return the controller if it is fuzzy; raises InputError."""
    if isinstance(controller, FuzzyController):
        return controller
    raise InputError(
        f'`controller` must be a fuzzy one here; {controller.name} is of kind {controller.kind}'
    )
