# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A controller for other tools, and for another vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from rpo.display import Show, progress_in_python
from rpo.door.subjects import Source, fields_of, file_source, mission_source, scenario_source
from rpo.exports import FORMATS, attitude_files, c, c_assured, text_of
from rpo.montecarlo.outputs import identifier, make_folder, write_text
from rpo.training.scaling import Found, search
from rpo_core import files
from rpo_core.control import attitude
from rpo_core.control.controller import AnyController
from rpo_core.files.validation import InputError, shown
from rpo_core.judge import similarity
from rpo_core.scenario.scenario import Scenario, ScenarioSet


def export(
    controller: str | Path | AnyController | Mapping[str, Any],
    to: str | Path,
    assurance: str | Path | Scenario | Mapping[str, Any] | None = None,
) -> str | list[Path]:
    """Return or write a controller as C99, for MATLAB or FuzzyLite, or as JSON or YAML.

    Parameters
    ----------
    controller : str, Path, controller or mapping
        Name, path or object; of attitude too, as C.
    to : str or Path
        `c`, `fis` (MATLAB), `fll` (FuzzyLite), `json` or `yaml` (the file that flies): its text is
        returned. Or path of a file with such a suffix, which is written; C has a header beside it.
    assurance : str, Path, Scenario or mapping, optional
        With C, the assurance filter of this scenario too.

    Returns
    -------
    str or list of Path
        The text, or the files that were written.

    Raises
    ------
    InputError
        If there is no such controller or format, or the format cannot say it.

    Examples
    --------
    >>> import rpo
    >>> rpo.export('allround', 'fis')[:20]
    '% allround: fuzzy co'
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
    if str(to) in FORMATS:
        return next(iter(exported(controller, to_format, None, assurance).values()))
    texts = exported(controller, to_format, path, assurance)
    make_folder(path.parent)
    for place, text in texts.items():
        write_text(place, text)
    return list(texts)


def exported(
    controller: Any, to: str, path: Path | None, assurance: object = None
) -> dict[Path, str]:
    """Return the files of a controller in a format, named after it if no path is given."""
    if isinstance(controller, (str, Path)) and attitude.is_one(str(controller)):
        controller = attitude.load(controller)
    turns = isinstance(controller, attitude.AttitudeController)
    if turns and (to != 'c' or assurance is not None):
        raise InputError('a controller of attitude needs `--to c`, without `--assurance`')
    if assurance is not None and to != 'c':
        raise InputError(f'`--assurance` needs `--to c`; got {to}')
    loaded = attitude.axis_of(controller) if turns else file_source(controller).subject
    path = path or Path(f'{identifier(loaded.name)}.{to}')
    if assurance is not None:
        scenario = scenario_source(assurance, {}).subject
        texts: tuple[str, ...] = c_assured.files(loaded, scenario, path.name)
    elif to == 'c':
        texts = (attitude_files if turns else c.files)(loaded, path.name)
    else:
        texts = (text_of(loaded, to),)
    return dict(zip((path, path.with_suffix('.h')), texts, strict=False))


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
