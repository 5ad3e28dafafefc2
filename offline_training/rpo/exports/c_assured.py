# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A controller and the assurance filter of a scenario in one C99 file, with the bits of both.

The memory of the filter is a structure that the caller holds: forces on their way to delayed
thrusters, the last force, the mode. docs/safety.md has the proof; it is about this arithmetic.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rpo.exports import c, formats
from rpo.exports.c_source import Source, number, wrapped
from rpo.exports.formats import filled
from rpo.montecarlo.outputs import identifier
from rpo_core.assurance import filters
from rpo_core.assurance.assurance import CONSTRAINTS, MODES, UNKNOWN, AssuranceStage, step_of
from rpo_core.assurance.guard import proof_of
from rpo_core.assurance.settings import Assurance
from rpo_core.assurance.shaping import Shaping, ShapingStage, shaped
from rpo_core.chain.chain import Chain
from rpo_core.chain.flight import fly
from rpo_core.control.controller import AnyController, FuzzyController
from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place, section_of
from rpo_core.wire import interfaces
from rpo_core.world.cw import cw_step

_CASES = 32  # ticks of each half of the self-test

_REFERENCE = 'const double reference[6], const double reference_force_n[3]'


class Assured(NamedTuple):
    """A controller, the scenario whose section `assurance` says what is kept, and their name."""

    name: str
    controller: AnyController
    scenario: Scenario
    settings: Assurance
    delay: int

    @property
    def guided(self) -> bool:
        """Whether the controller follows a reference."""
        return any(section_of(s).place is Place.GUIDANCE for s in self.scenario.sections)

    @property
    def counts(self) -> bool:
        """Whether the controller counts ticks."""
        return c.counts_ticks(self.controller)

    @property
    def shaping(self) -> Shaping | None:
        """What is done to the command before the filter."""
        return self.scenario.section(Shaping)

    def sending(self, memory: str, command: str, indent: int = 4) -> dict[str, str]:
        """Return the lines of C that shape a command, and what the filter then gets."""
        if self.shaping is None:
            return {'send': '', 'sent': command}
        lines = 'double sent_n[3];', f'{self.name}_shape({memory}, {command}, sent_n);'
        return {'send': ''.join(f'\n{" " * indent}{line}' for line in lines), 'sent': 'sent_n'}


def assured(controller: AnyController, scenario: Scenario) -> Assured:
    """Return what is exported; raises InputError where C would not be the chain that flies."""
    settings = scenario.section(Assurance)
    if settings is None:
        raise InputError(f'`--assurance` needs a section `assurance`; {scenario.name} has none')
    if settings.abort is not None:
        raise InputError(
            f'`--assurance` exports the filter, not the abort table of {scenario.name}: '
            'take `assurance.abort` out of the file'
        )
    if scenario.target is not None and settings.corridor is not None:
        raise InputError(
            f'`--assurance` exports a corridor that stands; that of {scenario.name} turns with '
            'section `target`'
        )
    if any(section_of(s).place is Place.ESTIMATOR for s in scenario.sections):
        raise InputError(
            f'`--assurance` needs fixed errors of the state; the set of {scenario.name} follows '
            'the covariance of its estimator'
        )
    if not isinstance(controller, FuzzyController):
        controller.refuse_other_ticks(scenario.dt_s)
    delay = scenario.thrusters.delay_ticks if scenario.thrusters else 0
    return Assured(identifier(controller.name), controller, scenario, settings, delay)


def _functions(a: Assured, source: Source) -> str:
    source.record('PLANT', step_of(a.settings, a.scenario))
    source.record('GUARD', proof_of(a.settings, a.scenario).guard)
    filtered, first = source.function(filters.assure), source.function(filters.first_mode)
    step = source.function(cw_step).name
    goal = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)) if a.scenario.goal is None else a.scenario.goal
    constants = [] if a.guided else [c.vector('GOAL_M', goal[0]), c.vector('HOLD_N', goal[1])]
    about = ', on the reference with its force' if a.guided else ', and what holds the goal'
    shape = ''
    if a.shaping is not None:
        numbers = ', '.join(map(number, ShapingStage(a.shaping, a.scenario).numbers))
        shape = filled('shape', name=a.name, shaped=source.function(shaped).name, numbers=numbers)
    state = 'const double position_m[3], const double velocity_m_s[3]'
    memory, tick = f'{a.name}_memory *memory', 'tick, ' * a.counts
    given = f'{state}, {"int tick, " * a.counts}{f"{_REFERENCE}, " * a.guided}'
    out = 'double force_n[3]'
    functions = filled(
        'functions',
        **a.sending('memory', 'command_n'),
        start=wrapped(f'void {a.name}_start({memory})'),
        command=wrapped(f'void {a.name}_command({given}double command_n[3])'),
        assure=wrapped(f'int {a.name}_assure({memory}, {state}, const double command_n[3], {out})'),
        step=wrapped(f'int {a.name}_step({memory}, {given}double command_n[3], {out})'),
        shape=shape,
        forget='\n    memory->shaped = 0;' if a.shaping else '',
        name=a.name,
        slots=max(a.delay, 1),
        unknown=UNKNOWN,
        about=about,
        to_r='reference[axis]' if a.guided else 'GOAL_M[axis]',
        to_v='reference[3 + axis]' if a.guided else '0.0',
        extra='reference_force_n[axis]' if a.guided else 'HOLD_N[axis]',
        tick=tick,
        reference='reference, reference_force_n, ' * a.guided,
        first_mode=first.name,
        filter=filtered.name,
        answer=source.spelled(filtered.returns),
        ahead=filled('ahead', slots=a.delay, step=step) if a.delay else '',
        remember=filled('remember', slots=a.delay) if a.delay else '',
    )
    return '\n\n'.join([*constants, functions])


def cases(a: Assured) -> tuple[list[int], list[list[float]]]:
    """Return ticks and rows: state, command, force, constraint (13), reference and its force (9).

    The first half is of a flight, every so many ticks; in the second half, a hostile command at
    full thrust, mostly towards the target, answers states of the flight that are faster.
    """
    flight = fly(a.scenario, a.controller)
    seen = next(
        link.reads[0]
        for link in Chain.of(a.scenario, a.controller).links
        if isinstance(link.stage, AssuranceStage)
    )
    states = flight.states if seen == interfaces.RELATIVE_STATE else flight.signals[seen]
    ticks = np.linspace(0, a.scenario.ticks, _CASES).astype(int).tolist()
    stage, rows = AssuranceStage(a.settings, a.scenario), []
    shaping = ShapingStage(a.shaping, a.scenario) if a.shaping else None
    none = np.zeros((a.scenario.ticks + 1, 6))
    references = flight.signals.get(interfaces.REFERENCE_STATE, none)
    forces = flight.signals.get(interfaces.REFERENCE_FORCE, none[:, :3])
    numbers, draw = {name: float(n) for n, name in CONSTRAINTS.items()}, np.random.default_rng(2)
    for hostile in (False, True):
        stage.reset()
        if shaping is not None:
            shaping.reset()
        for tick in ticks:
            state, command = states[tick].tolist(), flight.forces_n[tick].tolist()
            if hostile:
                state[3:] = [3.0 * speed for speed in state[3:]]
                limit = float(a.scenario.max_force_n)
                sides = np.sign(state[:3]) * np.sign(draw.uniform(-0.8, 0.2, 3))
                command = (limit * sides * draw.uniform(0.5, 1.2, 3)).tolist()
            (sent,) = shaping.step(tick, command) if shaping else (tuple(command),)
            (force,) = stage.step(tick, tuple(state), sent)
            acted = numbers[stage.decision.constraint if stage.decision is not None else '']
            more = [*references[tick].tolist(), *forces[tick].tolist()] if a.guided else []
            rows.append([*state, *command, *map(float, force), acted, *more])
    return ticks, rows


def _self_test(a: Assured) -> str:
    ticks, rows = cases(a)
    tables = [c.table('cases', 'double', rows)]
    if a.counts:
        tables.append(
            f'static const int ticks[{len(ticks)}] = {{\n{formats.listed(ticks, 4, 96)}}};'
        )
    return filled(
        'assured_self_test',
        cases='\n\n'.join(tables),
        name=a.name,
        count=len(rows),
        own=len(ticks),
        tick='ticks[i], ' * a.counts,
        reference='&c[13], &c[19], ' * a.guided,
        **a.sending('&memory', '&c[6]', indent=8),
    )


def files(controller: AnyController, scenario: Scenario, file: str) -> c.Files:
    """Return the C of both: `NAME_start`, `_step`, `_command`, `_assure`, `_self_test`, a header.

    file : name of the source file, whose header has an example of its use
    """
    a, source = assured(controller, scenario), Source()
    about = formats.one_line(f'runtime assurance of {scenario.name}: {scenario.description}')
    facts = '\n'.join([c.facts_of(controller), wrapped(f'/* {about} */')])
    codes = ', '.join(f'{n} {word or "none"}' for n, word in CONSTRAINTS.items())
    memory = filled(
        'memory',
        name=a.name,
        slots=max(a.delay, 1),
        shaped=filled('shaped') if a.shaping else '',
        unknown=UNKNOWN,
        modes=', '.join(f'{mode} {name}' for mode, name in MODES.items()),
    )
    types = f'/* The constraint that changed a command: {codes}. */', memory
    force = 'static ' + c.force_text(source, controller, a.name).split('*/\n', 1)[1]
    functions = [force, _functions(a, source), _self_test(a)]
    use = (
        f'{a.name}_memory memory;\n             {a.name}_start(&memory);\n'
        f'             acted = {a.name}_step(&memory, position_m, velocity_m_s, '
        f'{"tick, " * a.counts}{"reference, reference_force_n, " * a.guided}command_n, force_n);'
    )
    return c.files_of(a.name, facts, source, functions, use, file, *types)
