# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A campaign: many dispersed flights, how many succeed, and each of them again."""

from __future__ import annotations

import html
import re
from collections.abc import Collection, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

from rpo.display import UNITS, Show, html_rows, progress_in_python, suffix_of
from rpo.door.flight import Flight, extended
from rpo.door.subjects import (
    AnyLaw,
    Catalogue,
    Source,
    controller_source,
    fields_of,
    has_file,
    proposing,
    scenario_source,
)
from rpo.montecarlo import config, execution, judging, run_batch, statistics
from rpo.montecarlo.statistics import Rate
from rpo.montecarlo.store import Results, Store
from rpo_core import files
from rpo_core.control.controller import dumps as controller_text
from rpo_core.files import DEFAULT_CONTROLLER
from rpo_core.files.validation import InputError, missing_reported, shown, whole, within
from rpo_core.kernels.arrays import Bools, Floats
from rpo_core.scenario import overrides
from rpo_core.scenario import scenario as of_scenario
from rpo_core.scenario.scenario import Scenario

OF_ITS_FILE = ('success', 'faults', 'sampling')
"""Fields of a campaign's file that `campaign` takes beside those of the scenario."""


class Campaign:
    """Dispersed flights: `runs['name']` is what was drawn or counted of each run, (runs,).

    Attributes
    ----------
    definition : Campaign
        Configuration, scenario and controller: all that determines the results.
    folder : Path or None
        Where the results are, if they are in a folder.
    """

    def __init__(self, results: Results) -> None:
        self.results, self.definition = results, results.campaign
        self.folder = results.folder if isinstance(results, Store) else None

    def __len__(self) -> int:
        return self.definition.config.runs

    def __getitem__(self, name: str) -> Floats:
        if name not in self.results.columns:
            raise InputError(f'column must be one of {", ".join(self)}; got {shown(name)}')
        return self.results.column(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self.results.columns)

    @cached_property
    def rates(self) -> dict[str, Rate]:
        """Limit -> rate of the runs that keep it, with Wilson's interval at 95 %.

        `success` is the rate of the runs that keep every limit. A limit of the scenario that
        success has at another value is named with its value.

        Examples
        --------
        >>> import rpo
        >>> rates = rpo.campaign('paper_test', runs=20).rates
        >>> rates['position and speed']
        <Rate position and speed: 100.00 % (83.89 to 100.00 %), 20 of 20 runs>
        >>> rates['success'].kept, round(rates['success'].high, 2)
        (0, 0.16)
        """
        found: Catalogue[Rate] = Catalogue()
        for rate in statistics.rates(self.results):
            name = rate.name.partition(' <= ')[0]
            found[rate.name if name in found else name] = rate
        return found

    @cached_property
    def success(self) -> Bools:
        """Which runs (runs,) keep every limit."""
        settings = self.definition.config
        return statistics.successes(settings, {name: self[name] for name in settings.judging})

    @property
    def ok(self) -> bool:
        """Whether every run succeeds."""
        return bool(self.success.all())

    def __repr__(self) -> str:
        settings, rates = self.definition.config, self.rates
        names = list(settings.success)
        if judging.MOTION in rates:
            names = [judging.MOTION, *(name for name in names if name in judging.EFFORT)]
        missed = sorted((rates[n].kept, f'{n} {rates[n].percent} %') for n in names)
        worst = [text for kept, text in missed if kept < len(self)][:3]
        every = f'{rates["success"].percent} % keep every limit ({rates["success"].interval} %)'
        runs = f'{settings.controller}, {len(self)} runs, {every}'
        return f'<Campaign {settings.name}: {"; ".join(filter(None, [runs, ", ".join(worst)]))}>'

    def _repr_html_(self) -> str:
        table = html_rows(statistics.rows(self.results))
        sentence = html.escape(judging.sentence(self.definition))
        return f'<p>{html.escape(repr(self))}</p><table>{table}</table><p>success: {sentence}</p>'

    def to_dataframe(self) -> Any:
        """Return draws and metrics as a pandas DataFrame, a row a run.

        Returns
        -------
        pandas.DataFrame
            Index `run`; a column for each name, then `success`. ``attrs['units']`` has the units.

        Raises
        ------
        InputError
            If pandas is not installed.

        Examples
        --------
        >>> import rpo
        >>> table = rpo.campaign('paper_test', runs=20).to_dataframe()
        >>> table.shape, table['energy_n2s'].mean().round(1).item()
        ((20, 41), 3.9)
        """
        with missing_reported():
            import pandas as pd
        frame = pd.DataFrame({name: self[name] for name in self})
        frame['success'] = self.success
        frame.index.name = 'run'
        units = {name: UNITS[suffix_of(name)] for name in self}
        frame.attrs['units'] = {**units, **self.definition.metrics}
        return frame

    def plot(self) -> Any:
        """Draw how the judged metrics are distributed, of successes and of failures.

        Returns
        -------
        ndarray of Axes
            One for each metric.

        Raises
        ------
        InputError
            If matplotlib is not installed.

        Examples
        --------
        >>> import rpo
        >>> rpo.campaign('paper_test', runs=20).plot().shape
        (4, 2)
        """
        with missing_reported():
            from matplotlib import pyplot

            from rpo.reports.campaign import PANEL_IN, histograms
            from rpo_log.show import style

        columns = {judging.words(name): self[name] for name in judging.figures(self.definition)}
        rows = -(-len(columns) // 2)
        size = (style.WIDTH_IN, PANEL_IN * rows)
        with style.applied():
            panels = pyplot.subplots(rows, 2, squeeze=False, figsize=size, layout='constrained')[1]
            histograms(panels, columns, self.success)
        return panels

    def scenario(self, number: int) -> Scenario:
        """Return the scenario of a run: what was drawn is in it, and any controller flies it.

        Parameters
        ----------
        number : int
            Number of the run, from 0.

        Returns
        -------
        Scenario
            The nodes fly it too. Faults of messages are not part of it.

        Raises
        ------
        InputError
            If there is no such run.

        Examples
        --------
        >>> import rpo
        >>> rpo.campaign('paper_test', runs=20).scenario(3).name
        'paper_test_run_3'
        """
        whole('number', number, least=0, most=len(self) - 1)
        return run_batch.scenario_of(self.definition, number)

    def flight(self, number: int) -> Flight:
        """Return the flight of a run, flown again with the same bits.

        Parameters
        ----------
        number : int
            Number of the run, from 0.

        Returns
        -------
        Flight
            With message faults, its forces are those held at each tick.

        Raises
        ------
        InputError
            If there is no such run, or its bits are others, which is a defect.

        Examples
        --------
        >>> import rpo
        >>> rpo.campaign('paper_test', runs=20).flight(3).ok
        False
        """
        whole('number', number, least=0, most=len(self) - 1)
        _, flight = execution.fly_again(self.definition, number, self.results)
        return extended(flight, self.definition.controller, {})


@proposing
def campaign(
    campaign: object,
    controller: AnyLaw | None = None,
    runs: int | None = 1000,
    seed: int | None = None,
    *,
    disperse: Mapping[str, Any] | None = None,
    judge: Collection[str] = (),
    folder: str | Path | None = None,
    workers: int = 0,
    cluster: str = '',
    **changes: Any,
) -> Campaign:
    """Fly many dispersed runs, with the bits of `rpo campaign`.

    The campaign `paper_test` adds dispersions, errors of navigation and a delay to the scenario of
    the same name. With `disperse`, the scenario alone flies, and only what you name is dispersed.

    Parameters
    ----------
    campaign : str, Path, Campaign or mapping
        Name of one that ships (`campaigns`), path of a file, folder of results, an object, or the
        document of a file. With `disperse` a scenario: name, path or object.
    controller : str, Path, controller, mapping or callable, optional
        What flies: see `fly`. Without, that of the campaign; of a scenario, `allround`. Functions
        fly run by run, which is slower, on one thread, and in memory alone.
    runs : int, optional
        How many; None: as many as the campaign says.
    seed : int, optional
        Of the draws; without, that of the campaign, or 1.
    disperse : mapping, optional
        Quantity -> distribution, as in a campaign's file: ``{'mass_share': {'normal': 0.03}}``.
    judge : collection of str, optional
        Limits that success is judged by, by the names of `Campaign.rates` or their first words:
        ``['position and speed', 'slew']``. Without, all of the campaign, or of the scenario.
    folder : str or Path, optional
        Where results are saved as they come in; the same call goes on there, and `rpo campaign`
        reads it. Without, they are in memory alone.
    workers : int
        Threads, or processes of a local cluster; 0: one per core.
    cluster : str
        `local`, or the address of a dask scheduler.
    **changes
        `success`, `faults` and `sampling` as in the file of a campaign; fields of the scenario with
        their new values, see `scenario`.

    Returns
    -------
    Campaign
        Rates, columns, each flight; it draws itself.

    Raises
    ------
    InputError
        If campaign, scenario, controller or a field is none, or they do not fit.

    Examples
    --------
    >>> import rpo
    >>> rpo.campaign('paper_test', 'pd', runs=50, seed=3)
    <Campaign paper_test: pd, 50 runs, 0.00 % keep every limit (0.00 to 7.13 %); ...>
    >>> heavier = {'mass_share': {'uniform': 0.2}}
    >>> rpo.campaign('paper_test', runs=50, disperse=heavier).ok
    True
    >>> len(rpo.campaign('paper_test', lambda t, x: -0.03 * x[:3] - x[3:], runs=2))
    2
    """
    own = {'runs': runs, 'seed': seed, **{n: changes.pop(n) for n in OF_ITS_FILE if n in changes}}
    own = fields_of({name: value for name, value in own.items() if value is not None})
    if isinstance(campaign, (str, Path)) and Path(campaign).is_dir():
        if controller or seed is not None or disperse or judge or folder or changes:
            raise InputError(f'campaign: {campaign} has results; nothing of them can be changed')
        results: Results = Store.open(Path(campaign))
    else:
        what = defined(campaign, controller, own, fields_of(changes), disperse, judge)
        if not what.texts[2]:
            if folder is not None or cluster:
                raise InputError(
                    f'controller: the function {what.controller.name} has no file, which a folder '
                    'or a cluster needs; leave `folder` and `cluster` out'
                )
            workers = 1  # a function may have memory, which two flights at once would share
        results = Results(what) if folder is None else Store.begun(Path(folder), what)
    with progress_in_python() as show:
        return flown(results, workers, cluster, show)


def flown(results: Results, workers: int, cluster: str, show: Show) -> Campaign:
    """Fly what is missing of a campaign; show how many runs are done, and how many succeed."""
    before, new, kept = results.done_runs, 0, 0

    def advance(runs: int, successful: int) -> None:
        nonlocal new, kept
        new, kept = new + runs, kept + successful
        sentence = f'{100 * kept / new:.2f} % succeed'
        show('runs', before + new, results.campaign.config.runs, sentence)

    execution.fly(results, workers, cluster, advance)
    return Campaign(results)


def defined(
    subject: object,
    controller: object,
    own: Mapping[str, Any],
    changes: Mapping[str, Any],
    disperse: Mapping[str, Any] | None = None,
    judge: Collection[str] = (),
) -> config.Campaign:
    """Return what a campaign flies; see `campaign`.

    own : field of the campaign's file -> value as YAML has it
    changes : field of the scenario, with dots into sections -> value as YAML has it
    """
    flying = None if controller is None else controller_source(controller)
    own = {**own, 'controller': flying.name} if flying else own
    if isinstance(subject, Campaign):
        subject = subject.definition
    if disperse is not None:
        scenario = scenario_source(subject, changes)
        name = re.sub(r'\W+', '_', scenario.subject.name).strip('_')
        place = name
        document: Any = {'schema': config.SCHEMA, 'name': name, 'scenario': scenario.name}
        document |= {'controller': DEFAULT_CONTROLLER, 'dispersions': fields_of(disperse)}
    elif isinstance(subject, config.Campaign):
        place, document = subject.config.name, files.parse_yaml(subject.texts[0])
        _, text, flying_text = subject.texts
        scenario = Source(None, overrides.changed(text, changes) if changes else text, place)
        flying = flying or Source(subject.controller, flying_text, place)
    elif isinstance(subject, (str, Path)):
        place = str(_path(str(subject)))
        document = files.load(Path(place), lambda document: document)
    elif isinstance(subject, Mapping):
        place, document = 'campaign', fields_of(subject)
    else:
        raise InputError(f'campaign: name, path or object expected; got {shown(subject)}')
    with within(place):
        settings = config.parse({**document, **own} if isinstance(document, dict) else document)
        if disperse is None and not isinstance(subject, config.Campaign):
            scenario = scenario_source(settings.scenario, changes)
        flying = flying or controller_source(settings.controller)
    law = None if has_file(flying.subject) else flying.subject
    texts = (
        config.dumps(settings),
        scenario.text or of_scenario.dumps(scenario.subject),
        flying.text or (controller_text(flying.subject) if law is None else ''),
    )
    found = config.Campaign.of_texts(texts, (place, scenario.name, flying.name), law)
    return found.judging(judging.limits_named(judge, found.config.success)) if judge else found


def _path(name: str) -> Path:
    """Return the file of a campaign; raises InputError."""
    if name in files.shipped('scenario') and name not in files.shipped('campaign'):
        raise InputError(
            f'campaign: scenario {name} has no dispersions of its own; give some, like '
            "disperse={'mass_share': {'normal': 0.03}}"
        )
    return files.find('campaign', name)
