# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One flight: fly it, ask it, show it, save it."""

from __future__ import annotations

import html
from collections.abc import Iterator, KeysView, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from operator import sub
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from rpo.display import UNITS, html_rows, suffix_of
from rpo.door.subjects import (
    AnyLaw,
    Catalogue,
    LawController,
    controller_source,
    fields_of,
    has_file,
    proposing,
    scenario_source,
)
from rpo_core.chain import flight as core
from rpo_core.control.blend import Reasons
from rpo_core.control.controller import dumps as controller_text
from rpo_core.control.controller_file import received
from rpo_core.control.explain import reasons
from rpo_core.files.output import write_text
from rpo_core.files.validation import InputError, choice, missing_reported, real
from rpo_core.judge.metrics import METRICS, row_of
from rpo_core.judge.verdicts import HOLDS, Verdict, missed, verdicts
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario import scenario as of_scenario
from rpo_core.scenario.scenario import Scenario
from rpo_core.wire import interfaces
from rpo_log.format.run import CONTROLLER, PARAMETERS, SCENARIO
from rpo_log.show import report
from rpo_log.tools.export import columns
from rpo_log.topics import Topic

_MAIN = {
    interfaces.RELATIVE_STATE: 'states',
    interfaces.CONTROL_FORCE: 'forces_n',
    interfaces.DISTURBANCE_FORCE: 'disturbances_n',
}
"""Signal -> attribute of a flight that has it."""


@dataclass(frozen=True, repr=False)
class Explanation:
    """Why a controller commanded its force at a time; it is shown in words.

    Attributes
    ----------
    time_s : float
        Time of the tick.
    state : tuple
        State (6,) that the controller read [m, m/s], relative to its goal or reference.
    force_n : tuple
        Commanded force (3,) [N].
    added_n : tuple
        The part of it (3,) that no rule makes [N]: the force that a chaser at rest at the goal, or
        on the reference, needs, minus the disturbance that is estimated.
    axes : mapping
        Axis x, y, z -> the reasons of its force; empty where the controller has no rules.
    """

    time_s: float
    state: tuple[float, ...]
    force_n: tuple[float, ...]
    added_n: tuple[float, ...]
    axes: Mapping[str, Reasons]

    def __repr__(self) -> str:
        said = (f'{axis}: {reason.sentence}' for axis, reason in self.axes.items())
        state, force, added = (
            ', '.join(f'{value + 0.0:.4g}' for value in values)
            for values in (self.state, self.force_n, self.added_n)
        )
        first = f'{self.time_s:g} s: state [{state}], force [{force}] N'
        if any(self.added_n):
            first += f', of which [{added}] N for the goal or reference and against the disturbance'
        return '\n'.join((first, *said))


@dataclass(frozen=True, repr=False)
class Replay:
    """A flight in three dimensions, as a page of HTML that needs nothing else.

    Attributes
    ----------
    html : str
        The page.
    """

    html: str

    def save(self, path: str | Path) -> Path:
        """Write the page to a file.

        Parameters
        ----------
        path : str or Path
            Of the file.

        Returns
        -------
        Path
            The same one.

        Raises
        ------
        InputError
            If the file cannot be written.

        Examples
        --------
        >>> import rpo, tempfile
        >>> place = tempfile.TemporaryDirectory()
        >>> rpo.fly('quick').replay().save(f'{place.name}/replay.html').name
        'replay.html'
        """
        write_text(Path(path), self.html)
        return Path(path)

    def __repr__(self) -> str:
        return f'<Replay: {len(self.html) / 1e6:.1f} MB of HTML; save(path) writes it>'

    def _repr_html_(self) -> str:
        page = html.escape(self.html, quote=True)
        return f'<iframe srcdoc="{page}" width="100%" height="640" style="border:0"></iframe>'


@dataclass(frozen=True, repr=False, eq=False)
class Flight(core.Flight):
    """One flight at ticks 0..N; `flight['name']` is any signal of it, (N+1, width).

    Attributes
    ----------
    t : ndarray, shape (N+1,)
        Times [s].
    x : ndarray, shape (N+1, 6)
        True states x, y, z [m], vx, vy, vz [m/s], target LVLH.
    u : ndarray, shape (N+1, 3)
        Commanded forces [N], target LVLH.
    scenario : Scenario
        What was flown.
    controller : FuzzyController, ControllerFile or other
        What flew it; None where a log does not have it.
    metrics : dict
        Metric -> value: J is ``metrics['energy_n2s']``.
    requirements : list of Verdict
        Each requirement of the scenario beside the value of the flight.
    ok : bool
        Whether no requirement is missed; also where the scenario states none, as `quick`.

    Examples
    --------
    >>> import rpo
    >>> flight = rpo.fly('quick')
    >>> flight.x.shape, flight['control_force'].shape
    ((51, 6), (51, 3))
    """

    controller: Any = None
    texts: Mapping[str, str] = field(default_factory=dict)

    @property
    def t(self) -> Floats:
        """Times (N+1,) [s]."""
        return self.scenario.times_s

    @property
    def x(self) -> Floats:
        """True states (N+1, 6) [m, m/s], target LVLH."""
        return self.states

    @property
    def u(self) -> Floats:
        """Commanded forces (N+1, 3) [N], target LVLH."""
        return self.forces_n

    def keys(self) -> KeysView[str]:
        """Return the names of its signals.

        Returns
        -------
        keys
            Of the states, the forces, and what each stage put out.

        Examples
        --------
        >>> import rpo
        >>> 'control_force' in rpo.fly('quick').keys()
        True
        """
        return {**_MAIN, **self.signals}.keys()

    def __getitem__(self, name: str) -> Floats:
        choice('signal', name, self.keys())
        return getattr(self, _MAIN[name]) if name in _MAIN else self.signals[name]

    def __contains__(self, name: object) -> bool:
        return name in self.keys()

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    @cached_property
    def metrics(self) -> dict[str, float]:
        """Metric -> value; the name ends in its unit.

        The arrival time of a flight that does not arrive is its duration. The mean window is the
        last 30 s, the late window the last 200 s, if the scenario does not say otherwise.

        Examples
        --------
        >>> import rpo
        >>> metrics = rpo.fly('quick').metrics
        >>> round(metrics['energy_n2s'], 2)
        0.72
        >>> list(metrics)[:4]
        ['energy_n2s', 'mean_speed_norm_m_s', 'slew_per_axis_n_s', 'mean_error_norm_m']
        """
        return Catalogue(zip(METRICS, row_of(self).tolist(), strict=True))

    metrics.__doc__ = f'{metrics.__doc__}\n' + '\n'.join(
        f'        {name:24}  {meaning} [{unit}]' for name, (unit, meaning) in METRICS.items()
    )

    @cached_property
    def requirements(self) -> list[Verdict]:
        """The requirements of the scenario, each beside the value of the flight.

        Examples
        --------
        >>> import rpo
        >>> rpo.fly('paper_test').requirements[0].holds
        True
        """
        return verdicts(self)

    @property
    def ok(self) -> bool:
        """Whether no requirement of the scenario is missed; true where it states none."""
        return not missed(self)

    def __repr__(self) -> str:
        held = sum(verdict.word == HOLDS for verdict in self.requirements)
        said = f'{held} of {len(self.requirements)} requirements hold'
        said = said if self.requirements else 'no requirement stated'
        energy = self.metrics['energy_n2s']
        name, duration_s = self.scenario.name, self.scenario.duration_s
        return f'<Flight {name}: {duration_s:g} s, J = {energy:.3g} N²s, {said}>'

    def _repr_html_(self) -> str:
        rows = []
        for section, lines in report.rows(self).items():
            rows.append(f'<tr><th colspan="4">{html.escape(section)}</th></tr>')
            rows.append(html_rows(lines))
        return f'<p>{html.escape(repr(self))}</p><table>{"".join(rows)}</table>'

    def explain(self, t: float) -> Explanation:
        """Return why the controller commanded its force at a time: the rules that act.

        Parameters
        ----------
        t : float
            Time [s]; the tick at or before it is explained.

        Returns
        -------
        Explanation
            It is printed in words.

        Raises
        ------
        InputError
            If the time is not within the flight.

        Examples
        --------
        >>> import rpo
        >>> rpo.fly('paper_test').explain(300.0).axes['x'].sentence[:10]
        '+0.00509 N'
        """
        end_s = self.scenario.duration_s
        real('t', t, 's', least=0.0, most=end_s)
        tick = int(np.searchsorted(self.t, t + 1e-9, side='right')) - 1
        signals = {name: self[name][tick].tolist() for name in self.keys()}
        state, added = received(self.scenario, signals)
        if self.scenario.compensated:
            added = tuple(map(sub, added, signals[interfaces.ESTIMATED_DISTURBANCE]))
        why: Sequence[Reasons] = (
            reasons(self.controller, state, tick) if has_file(self.controller) else ()
        )
        axes = dict(zip('xyz', why, strict=bool(why)))
        force = tuple(signals[interfaces.CONTROL_FORCE])
        return Explanation(float(self.t[tick]), tuple(state), force, tuple(added), axes)

    def plot(self, ax: Any = None, label: str | None = None) -> Any:
        """Draw position, velocity and force over time; several flights over each other.

        ``axes = first.plot()``, then ``second.plot(axes)`` draws the second over the first;
        ``axes[0].figure.savefig('flights.png')`` writes them. One Axes alone gets the distance
        from the goal.

        Parameters
        ----------
        ax : matplotlib Axes, or three of them, optional
            Where to draw; a new figure without.
        label : str, optional
            Name of the flight in the legend; scenario and controller without.

        Returns
        -------
        Axes or ndarray of three Axes
            Where it was drawn.

        Raises
        ------
        InputError
            If matplotlib is not installed.

        Examples
        --------
        >>> import rpo
        >>> axes = rpo.fly('quick', 'allround').plot()
        >>> len(rpo.fly('quick', 'pd').plot(axes))
        3
        """
        with missing_reported():
            return report.drawn_over(self, ax, label or self._label)

    @property
    def _label(self) -> str:
        return f'{self.scenario.name}, {getattr(self.controller, "name", "controller")}'

    def replay(self) -> Replay:
        """Return the flight in three dimensions: a page that a notebook shows and a file holds.

        Returns
        -------
        Replay
            ``replay.save('replay.html')`` writes it.

        Examples
        --------
        >>> import rpo
        >>> rpo.fly('quick').replay().html[:15]
        '<!doctype html>'
        """
        from rpo.reports.logged import verdict_of
        from rpo.reports.replay import Replayed, page_of

        judged = missed(self) if self.requirements else None
        known = self.controller if has_file(self.controller) else None
        return Replay(
            page_of(self._label, [Replayed(self._label, self, verdict_of(self), judged, known)])
        )

    def to_dataframe(self) -> Any:
        """Return all signals as a pandas DataFrame, a row a tick.

        Returns
        -------
        pandas.DataFrame
            Index `time_s`; the names of columns end in their units, and ``attrs['units']`` has
            them.

        Raises
        ------
        InputError
            If pandas is not installed.

        Examples
        --------
        >>> import rpo
        >>> rpo.fly('quick').to_dataframe()[['x_m', 'fx_n']].shape
        (51, 2)
        """
        with missing_reported():
            import pandas as pd
        columns = {c: v for each in self._columns().values() for c, v in each.items()}
        frame = pd.DataFrame(columns, index=pd.Index(self.t, name='time_s'))
        frame.attrs['units'] = {name: UNITS[suffix_of(name)] for name in columns}
        return frame

    def to_xarray(self) -> Any:
        """Return all signals as an xarray Dataset over the time.

        Returns
        -------
        xarray.Dataset
            A variable for each column of `to_dataframe`, with its unit and meaning in ``attrs``.

        Raises
        ------
        InputError
            If xarray is not installed.

        Examples
        --------
        >>> import rpo
        >>> rpo.fly('quick').to_xarray()['fx_n'].attrs['units']
        'N'
        """
        with missing_reported():
            import xarray as xr
        found = {}
        for signal, parts in self._columns().items():
            meaning = interfaces.row_of(signal).meaning
            for name, values in parts.items():
                attrs = {'units': UNITS[suffix_of(name)], 'long_name': meaning}
                found[name] = 'time_s', values, attrs
        attrs = {'scenario': self.scenario.name, 'frame': interfaces.LVLH_FRAME}
        coordinate = {'time_s': ('time_s', self.t, {'units': 's'})}
        return xr.Dataset(found, coordinate, {**attrs, **self.metrics})

    def _columns(self) -> dict[str, dict[str, Floats]]:
        """Return signal -> name of a column -> values (N+1,)."""
        return {
            name: dict(zip(_names_of(name, self[name]), self[name].T, strict=True)) for name in self
        }

    def save(self, folder: str | Path, overwrite: bool = False) -> str:
        """Write the run folder that `rpo verify`, `rpo report` and `rpo log` read.

        Parameters
        ----------
        folder : str or Path
            A new folder.
        overwrite : bool
            Whether a run in the folder is replaced.

        Returns
        -------
        str
            What was written, in a sentence.

        Raises
        ------
        InputError
            If the controller has no file: a log carries it.
        LogError
            If the folder cannot be written.

        Examples
        --------
        >>> import rpo, tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     rpo.fly('quick').save(f'{folder}/run')
        '206 messages logged; none missing'
        """
        from rpo_log.tools.record import record

        if interfaces.DUE_FORCE not in self.signals:
            raise InputError('save: a flight that was flown expected; this one is from a log')
        if isinstance(self.controller, LawController):
            raise InputError(
                'save: a run carries the file of its controller, and `rpo verify` flies it; '
                f'the function {self.controller.name} has none'
            )
        texts = dict(self.texts)
        texts[SCENARIO] = of_scenario.text_for_logs(
            texts.get(SCENARIO) or of_scenario.dumps(self.scenario), self.scenario
        )
        texts[CONTROLLER] = texts.get(CONTROLLER) or controller_text(self.controller)
        attached = {name: text.encode() for name, text in texts.items()}
        return record(self, attached, Path(folder), overwrite=overwrite).sentence()


_ENDS = {
    'force': ('fx_n', 'fy_n', 'fz_n'),
    'torque': ('tx_nm', 'ty_nm', 'tz_nm'),
    'momentum': ('hx_nms', 'hy_nms', 'hz_nms'),
    'mass': ('mass_kg',),
}
"""Last word of the name of a signal that is no topic -> its columns."""


def _names_of(signal: str, values: Floats) -> list[str]:
    """Return the names of the columns of a signal (n, width), as `rpo log export` has them."""
    row = interfaces.row_of(signal)
    if row.columns:
        return columns(Topic(signal, row))
    stem, _, last = signal.rpartition('_')
    names = _ENDS.get(last, ())
    if len(names) != values.shape[1]:
        return [f'{signal}_{i}' for i in range(values.shape[1])]
    return [f'{stem}_{name}' for name in names]


@proposing
def fly(
    scenario: str | Path | Scenario | Mapping[str, Any],
    controller: AnyLaw = 'allround',
    **changes: Any,
) -> Flight:
    """Return the flight of a controller through a scenario, with the bits that the nodes fly.

    Parameters
    ----------
    scenario : str, Path, Scenario or mapping
        What is flown: name, path, object or document, see `scenario`.
    controller : str, Path, controller or callable
        What flies: name, path or object, see `controller`; or a function ``law(t, x)`` of time [s]
        and state (6,) [m, m/s] relative to the goal, that returns 3 forces [N].
    **changes
        Fields of the scenario with their new values, see `scenario`.

    Returns
    -------
    Flight
        States, forces, metrics, verdicts; it draws and saves itself.

    Raises
    ------
    InputError
        If scenario, controller or a field is none, or they do not fit.

    Examples
    --------
    >>> import rpo
    >>> rpo.fly('paper_test', 'allround')
    <Flight paper_test: 400 s, J = 4.12 N²s, 6 of 6 requirements hold>
    >>> rpo.fly('paper_test', lambda t, x: -0.03 * x[:3] - x[3:])
    <Flight paper_test: 400 s, J = 13.3 N²s, 6 of 6 requirements hold>
    >>> rpo.fly('quick')
    <Flight quick: 5 s, J = 0.721 N²s, no requirement stated>
    >>> rpo.fly('quick', lambda t, x: -0.02 * x)
    Traceback (most recent call last):
        ...
    rpo_core.files.validation.InputError: law(t, x) must return 3 finite forces [N], ...
    """
    return flown(scenario, controller, fields_of(changes))


def flown(scenario: object, controller: object, changes: Mapping[str, Any]) -> Flight:
    """Return the flight through a scenario with fields changed; `fly` and `rpo simulate`.

    changes : field, with dots into sections -> its value as YAML has it
    """
    source, flying = scenario_source(scenario, changes), controller_source(controller)
    flight = core.fly(source.subject, flying.subject)
    texts = [
        yaml.safe_dump(value, default_flow_style=True, width=1e9) for value in changes.values()
    ]
    ended = (text.removesuffix('\n').removesuffix('\n...') for text in texts)
    written = [f'{key}={text}' for key, text in zip(changes, ended, strict=True)]
    named = {'scenario': source.name, 'controller': flying.name, 'set': written}
    parameters = yaml.safe_dump({'simulate': named})
    attached = {SCENARIO: source.text, CONTROLLER: flying.text, PARAMETERS: parameters}
    return extended(flight, flying.subject, attached)


def extended(flight: core.Flight, controller: Any, texts: Mapping[str, str]) -> Flight:
    """Return a flight of the core with what flew it."""
    values = {each.name: getattr(flight, each.name) for each in fields(flight)}
    return Flight(**values, controller=controller, texts=texts)


def load(run: str | Path, scenario: str = '') -> Flight:
    """Return the flight that a log holds: of the ROS nodes, of `rpo simulate`, of `Flight.save`.

    Parameters
    ----------
    run : str or Path
        Run folder, .mcap file or bag.
    scenario : str, optional
        Name or path of the scenario of a bag that does not carry it.

    Returns
    -------
    Flight
        With the signals that are logged.

    Raises
    ------
    InputError
        If the log cannot be read, or does not hold a whole flight.

    Examples
    --------
    >>> import rpo, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     flight = rpo.fly('quick')
    ...     said = flight.save(f'{folder}/run')
    ...     bool((rpo.load(f'{folder}/run').x == flight.x).all())
    True
    """
    from rpo_log.bag import open_run
    from rpo_log.read.run_log import controller_of, flight_of, read_run

    log = read_run(open_run(run, scenario))
    carried = controller_of(log) if CONTROLLER in log.attachments else None
    return extended(flight_of(log), carried, {})
