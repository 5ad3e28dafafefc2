# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A controller for other tools, and for another vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from rpo.display import Show, progress_in_python
from rpo.door.flight import Flight, flown, load
from rpo.door.subjects import Source, fields_of, file_source, mission_source
from rpo.exports import FORMATS, c, text_of
from rpo.montecarlo.outputs import identifier, make_folder, write_text
from rpo.training.scaling import Found, search
from rpo_core import files
from rpo_core.control import attitude
from rpo_core.control.controller import AnyController
from rpo_core.files.validation import InputError, shown
from rpo_core.judge import similarity
from rpo_core.scenario.scenario import Scenario, ScenarioSet


def export(
    subject: str | Path | AnyController | Scenario | Mapping[str, Any],
    to: str | Path,
    controller: str | Path | AnyController | Mapping[str, Any] | None = None,
    stages: str = '',
    **changes: Any,
) -> str | list[Path]:
    """Return or write a controller for other tools, or the stages of a scenario as C99.

    Parameters
    ----------
    subject : str, Path, controller, Scenario or mapping
        Name, path or object of a controller; or of a scenario or run, which is C.
    to : str or Path
        `c`, `fis` (MATLAB), `fll` (FuzzyLite), `json` or `yaml` (the file that flies): its text is
        returned. Or path of a file with such a suffix, which is written; C has a header beside it,
        a program that flies the ticks of a flight again, and these ticks.
    controller : str, Path, controller or mapping, optional
        What flies the scenario; by default `allround`, or the one in the log of the run.
    stages : str, optional
        Names of stages, separated by commas, or `all`; by default those on board.
    **changes
        Fields of the scenario with their new values, see `scenario`.

    Returns
    -------
    str or list of Path
        The text, or the files that were written.

    Raises
    ------
    InputError
        If there is no such subject or format, the format cannot say it, or a stage cannot be C.

    Examples
    --------
    >>> import rpo
    >>> rpo.export('allround', 'fis')[:20]
    '% allround: fuzzy co'
    >>> 'int assured_tick(int64_t tick, assured_memory *m, double *s)' in rpo.export('assured', 'c')
    True
    >>> rpo.export('allround', 'exe')
    Traceback (most recent call last):
        ...
    rpo_core.files.validation.InputError: to: fis, fll, json, c, yaml or path of ...
    """
    path = Path(to)
    to_format = str(to) if str(to) in FORMATS else path.suffix[1:]
    if to_format not in FORMATS:
        names = ', '.join(FORMATS)
        raise InputError(
            f'to: {names} or path of a file with such a suffix expected; got {shown(str(to))}'
        )
    place = None if str(to) in FORMATS else path
    texts = exported(subject, to_format, place, controller, stages, fields_of(changes))
    if place is None:
        return next(iter(texts.values()))
    make_folder(path.parent)
    for place, text in texts.items():
        write_text(place, text)
    return list(texts)


def exported(
    subject: Any,
    to: str,
    path: Path | None,
    controller: Any = None,
    stages: str = '',
    changes: Mapping[str, Any] | None = None,
) -> dict[Path, str]:
    """Return the files of a subject in a format, named after it if no path is given."""
    flight = _flight_of(subject, controller, changes or {})
    if flight is None and (controller is not None or stages or changes):
        raise InputError('`--controller`, `--stages` and `--set` need a scenario, or a run')
    if flight is not None and to != 'c':
        raise InputError(f'a scenario, or a run, needs `--to c`; got {to}')
    source: Any = file_source(subject).subject if flight is None else flight.scenario
    path = path or Path(f'{identifier(source.name)}.{to}')
    if to != 'c':
        return {path: text_of(source, to)}
    if flight is None:
        texts = c.of_controller(source, path.name)
    else:
        texts = c.of_flight(flight, flight.controller, path.name, stages)
    beside = [path.with_suffix('.h')]
    beside += [path.with_name(f'{path.stem}_test{suffix}') for suffix in ('.c', '.txt')]
    return dict(zip((path, *beside), texts, strict=True))


def _flight_of(subject: Any, controller: Any, changes: Mapping[str, Any]) -> Flight | None:
    """Return the flight of a scenario, or of a run; None of a controller; raises InputError."""
    if isinstance(subject, (str, Path)):
        name = str(subject)
        if attitude.is_one(name):
            raise InputError(
                f'{name} is a controller of attitude: export a scenario, `--to c`, whose '
                f'`attitude_control.controller` it is'
            )
        if Path(name).is_dir() or name.endswith('.mcap'):
            flight = load(name)
            if changes:
                raise InputError('`--set` needs a scenario; a run is as it was flown')
            if controller is not None or flight.controller is None:
                raise InputError('a run must have its controller in its log; got another, or none')
            return flight
    return flown(subject, controller or 'allround', changes) if _is_mission(subject) else None


def _is_mission(subject: Any) -> bool:
    """Return whether a subject is a scenario, by its name, path, document or class."""
    if isinstance(subject, (str, Path)):
        name = str(subject)
        if not name.endswith(('.yaml', '.yml')):
            return name in files.shipped('scenario') and name not in files.shipped('controller')
        subject = files.load(files.find('scenario', name), lambda document: document)
    if isinstance(subject, Mapping):
        return str(subject.get('schema')).startswith('rpo/scenario')
    return isinstance(subject, (Scenario, ScenarioSet))


def scale(
    controller: str | Path | AnyController | Mapping[str, Any],
    scenario: str | Path | Scenario | ScenarioSet | Mapping[str, Any],
    **changes: Any,
) -> AnyController:
    """Return a controller scaled for another vehicle and mission, without training.

    The loop is similar under scaling of mass, force, length and time. Its units of length and time
    are chosen by flying the scenario, from starts around its own.

    Parameters
    ----------
    controller : str, Path, controller or mapping
        Name, path or object.
    scenario : str, Path, Scenario, ScenarioSet or mapping
        What to scale for: a flight or a set of starts, with requirements.
    **changes
        Fields of the scenario with their new values, see `scenario`.

    Returns
    -------
    FuzzyController or ControllerFile
        Its `provenance` has the multiples of length, time and mass.

    Raises
    ------
    InputError
        If the controller does not scale, or the scenario has no requirements.

    Examples
    --------
    >>> import rpo
    >>> law = rpo.scale('allround', 'paper_test', mass_kg=20.0)
    >>> law.name, rpo.fly('paper_test', law, mass_kg=20.0).ok
    ('allround_paper_test_changed', True)
    """
    fields = fields_of(changes)
    with progress_in_python() as show:
        result = scaled(controller, scenario, fields, show)
    command = similarity.command(
        result.given.name, result.mission.name, [f'{key}={value}' for key, value in fields.items()]
    )
    return result.search.named(result.name, result.given.name, result.mission.name, command)


class Scaled(NamedTuple):
    """A search for a scaling: what it found, of which controller, and for what."""

    search: Found
    given: Source
    mission: Source

    @property
    def name(self) -> str:
        """Name of the scaled controller, if no other is given."""
        goal = self.mission.subject.name.replace(files.CHANGED, '_changed')
        return identifier(f'{self.given.subject.name}_{goal}')


def scaled(controller: object, scenario: object, fields: Mapping[str, Any], show: Show) -> Scaled:
    """Search for the scaling of a controller; see `scale`."""
    given, mission = file_source(controller), mission_source(scenario, fields)
    return Scaled(search(given.subject, mission.subject, show), given, mission)
