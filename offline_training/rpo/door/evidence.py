# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What was flown, verified from its log, and drawn as a page."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from rpo.door.campaign import Campaign
from rpo.door.flight import Flight
from rpo.door.proof import Proof
from rpo.door.subjects import file_source
from rpo.montecarlo.outputs import digest_of, identifier, write_text
from rpo_core.control import attitude
from rpo_core.files.validation import InputError, shown, within
from rpo_log import verify as logs
from rpo_log.verify import Verification as Verification


def verify(
    run: str | Path | Flight,
    trusted: str | Path | None = None,
    given: Collection[str] = (),
    scenario: str = '',
    controller: str = '',
) -> Verification:
    """Compute a logged flight again, stage by stage, and compare it bit for bit.

    Parameters
    ----------
    run : str, Path or Flight
        Run folder, .mcap file or bag; or a flight, whose saved log is verified.
    trusted : str or Path, optional
        Public key, or folder of them (*.pem): one must have signed the run.
    given : collection of str
        Topics that a node of somebody else made: they are taken as they are.
    scenario, controller : str
        Names or files, of a bag that does not carry them.

    Returns
    -------
    Verification
        `ok`; `difference`, the first thing that is not as computed; `lines()` says it all.

    Raises
    ------
    InputError
        If there is no log that can be read, or `trusted` holds no keys.

    Examples
    --------
    >>> import rpo
    >>> rpo.verify(rpo.fly('quick')).ok
    True
    >>> rpo.verify('runs/nothing')
    Traceback (most recent call last):
        ...
    rpo_log.errors.NotARun: runs/nothing: ...
    """
    keys = None if trusted is None else Path(trusted)
    with TemporaryDirectory(prefix='rpo_verify_') as scratch:
        path = _path_of(run, Path(scratch)) if isinstance(run, Flight) else run
        if not isinstance(path, (str, Path)):
            raise InputError(f'run: folder, .mcap file or Flight expected; got {shown(run)}')
        outcome = logs.verify(path, keys, given, scenario, controller)
    return replace(outcome, path=Path(run.scenario.name)) if isinstance(run, Flight) else outcome


class Reported(NamedTuple):
    """A report that was written.

    report : the page, before it was written
    paths : its files, the page last
    logged : of runs, what their logs show
    """

    report: Any
    paths: list[Path]
    logged: Sequence[Any]


def report(what: Any, folder: str | Path | None = None, scenario: str = '') -> Path:
    """Draw runs, a campaign, a proof or a controller: one HTML page, and its pictures as PNGs.

    Parameters
    ----------
    what : str, Path, Flight, Campaign, Proof, controller, or list
        Folder of a run, a campaign or a proof; name, file or object of a controller; an object of
        `rpo`; or several runs or flights, which are drawn beside each other.
    folder : str or Path, optional
        Where the page goes; without, `report/` in the folder, or `runs/report_NAME`.
    scenario : str
        Of a controller: judged by what this scenario or set requires. Of a bag: what was flown.

    Returns
    -------
    Path
        Of `report.html`; runs and campaigns have `replay.html` beside it.

    Raises
    ------
    InputError
        If there is nothing to draw, several are no runs, or the folder cannot be written.

    Examples
    --------
    >>> import rpo, tempfile
    >>> place = tempfile.TemporaryDirectory()
    >>> rpo.report(rpo.fly('quick'), place.name).name
    'report.html'
    >>> rpo.report(3)
    Traceback (most recent call last):
        ...
    rpo_core.files.validation.InputError: report: run, campaign, proof or controller expected (...
    """
    subjects = list(what) if isinstance(what, (list, tuple)) else [what]
    return reported(subjects, folder, scenario).paths[-1]


def reported(subjects: Sequence[Any], folder: str | Path | None, scenario: str) -> Reported:
    """Write the report of some subjects; see `report`."""
    from rpo.reports import page

    if not subjects:
        raise InputError('report: at least one run, campaign, proof or controller expected')
    with TemporaryDirectory(prefix='rpo_report_') as scratch:
        targets = [str(_path_of(each, Path(scratch))) for each in subjects]
        first = page.subject_of(targets[0])
        if scenario and first not in ('controller', 'run'):
            raise InputError(
                f'`--scenario` is for a controller or a bag; {targets[0]} is a {first}'
            )
        for target in targets[1:]:
            if (other := page.subject_of(target)) != 'run' or first != 'run':
                raise InputError(
                    f'several targets must be runs; {targets[0]} is a {first}, {target} a {other}'
                )
        made, logged = _of(targets, first, scenario)
        place = Path(folder) if folder else _place(targets, first, Path(scratch))
        return Reported(made, page.write(made, place), logged)


def _path_of(subject: Any, scratch: Path) -> str | Path:
    """Return the name or path of a subject; an object without one is written into a folder."""
    if isinstance(subject, (str, Path)):
        return subject
    if isinstance(subject, Flight):
        path = scratch / f'{identifier(subject.scenario.name)}_{len(list(scratch.iterdir()))}'
        subject.save(path)
        return path
    if isinstance(subject, (Campaign, Proof)):
        if subject.folder is None:
            raise InputError(
                f'report: {subject!r} is in memory alone; fly it with a folder, like '
                "folder='runs/first'"
            )
        return Path(subject.folder)
    if not hasattr(subject, 'stage'):
        raise InputError(
            'report: run, campaign, proof or controller expected (name, path or object); '
            f'got {shown(subject)}'
        )
    source = file_source(subject)
    path = scratch / f'{identifier(source.name)}.yaml'
    write_text(path, source.text)
    return path


def _place(targets: Sequence[str], subject: str, scratch: Path) -> Path:
    """Return where a report goes if nothing else is said: another folder for each file.

    A controller's file adds its folder, which a person knows, and a digest of its path, which no
    other file has.
    """
    from rpo_log.show.report import folder_of

    path = Path(targets[0])
    names = [Path(target).stem for target in targets]
    if len(targets) == 1 and not path.is_relative_to(scratch):
        if subject != 'controller':
            return folder_of(path) if subject == 'run' else path / 'report'
        if path.name != targets[0] or path.suffix:
            parent, digest = path.resolve().parent.name, digest_of(str(path.resolve()))[:8]
            names = [*([parent] if parent and parent != path.stem else []), path.stem, digest]
        else:
            names = [targets[0]]
    return Path('runs') / '_'.join(['report', *names])


def _of(targets: Sequence[str], subject: str, scenario: str) -> tuple[Any, Sequence[Any]]:
    """Return the report of a subject, and what the logs of runs show."""
    from rpo.reports import campaign, controller, proof, run

    target, *others = targets
    if others:
        return run.compared([Path(each) for each in targets], scenario)
    if subject == 'run':
        made, flight = run.report_of(Path(target), scenario)
        return made, [flight]
    if subject != 'controller':
        module = campaign if subject == 'campaign' else proof
        return module.report_of(Path(target)), ()
    if attitude.is_one(target):
        fly = f'rpo simulate tumbling_docking --set attitude_control.controller={target}'
        raise InputError(f'{target} turns the chaser: `{fly}` flies it, and that run has a report')
    with within(f'{target}: no run and no campaign; as a controller'):
        return controller.report_of(target, scenario), ()
