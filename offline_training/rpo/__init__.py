# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The door: fly, judge, train, disperse, prove and report, by name.

    rpo.scenarios(), rpo.controllers(), rpo.campaigns()  what ships
    rpo.scenario('paper_test', mass_kg=12.0)             a scenario, with fields changed
    rpo.controller('allround')                           a controller
    rpo.fly('paper_test', 'allround', mass_kg=12.0)      a flight
    rpo.load('runs/demo')                                the flight of a log
    rpo.campaign('paper_test', law, runs=1000, seed=3)   many dispersed flights
    rpo.train('paper', generations=20, seed=4).best      a controller that a search trained
    rpo.prove, rpo.verify, rpo.report                    a proof, a log computed again, a page
    rpo.export, rpo.scale                                C and other formats, another vehicle
    rpo.FinalApproach, rpo.DispersedApproach             Gymnasium environments

A flight has `t, x, u`, its signals by name, `metrics`, `requirements` and `ok`, which is also True
where a scenario states no requirement. Its methods are
`explain(t)`, `plot()`, `replay()`, `to_dataframe()`, `to_xarray()` and `save(folder)`:

    axes = rpo.fly('paper_test', 'allround').plot()
    rpo.fly('paper_test', 'pd').plot(axes)

Give a scenario, a controller or a campaign by its shipped name, by the path of its file, or as an
object. Any function `law(t, x)` is a controller, and a controller is a function:

    rpo.fly('paper_test', lambda t, x: -0.03 * x[:3] - x[3:])
    law = rpo.controller('allround').with_rule(position='SP', velocity='Z', force='LP')
    law(position=[-10.0, 0.0, 10.0], velocity=0.0), law.rules, rpo.plot(law, 'rules')

Frame: target LVLH, x from the Earth outward, y along the velocity, z along the angular momentum; SI
units. A wrong input raises an `InputError` of one sentence. `help(rpo.fly)` says more.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpo_core import files
from rpo_core.files.validation import INSTALLED_BY, missing_reported
from rpo_core.files.validation import InputError as InputError

if TYPE_CHECKING:
    from rpo.door.campaign import Campaign as Campaign
    from rpo.door.campaign import campaign as campaign
    from rpo.door.conversion import export as export
    from rpo.door.conversion import scale as scale
    from rpo.door.evidence import Verification as Verification
    from rpo.door.evidence import report as report
    from rpo.door.evidence import verify as verify
    from rpo.door.flight import Explanation as Explanation
    from rpo.door.flight import Flight as Flight
    from rpo.door.flight import Replay as Replay
    from rpo.door.flight import fly as fly
    from rpo.door.flight import load as load
    from rpo.door.proof import Proof as Proof
    from rpo.door.proof import prove as prove
    from rpo.door.subjects import Catalogue as Catalogue
    from rpo.door.subjects import campaigns as campaigns
    from rpo.door.subjects import controller as controller
    from rpo.door.subjects import controllers as controllers
    from rpo.door.subjects import plot as plot
    from rpo.door.subjects import scenario as scenario
    from rpo.door.subjects import scenarios as scenarios
    from rpo.door.train import Training as Training
    from rpo.door.train import train as train
    from rpo.training.gym import FinalApproach as FinalApproach
    from rpo.training.gym_vector import DispersedApproach as DispersedApproach
    from rpo_core.control.controller import FuzzyController as FuzzyController
    from rpo_core.judge.verdicts import Verdict as Verdict
    from rpo_core.scenario.scenario import Scenario as Scenario

files.SHIPPED['campaign'] = Path(__file__).parent / 'shipped' / 'campaigns'

_MODULES = {
    name: module
    for module, names in {
        'rpo.door.campaign': ('Campaign', 'campaign'),
        'rpo.door.conversion': ('export', 'scale'),
        'rpo.door.evidence': ('Verification', 'report', 'verify'),
        'rpo.door.flight': ('Explanation', 'Flight', 'Replay', 'fly', 'load'),
        'rpo.door.proof': ('Proof', 'prove'),
        'rpo.door.subjects': (
            *('Catalogue', 'campaigns', 'controller', 'controllers'),
            *('plot', 'scenario', 'scenarios'),
        ),
        'rpo.door.train': ('Training', 'train'),
        'rpo.training.gym': ('FinalApproach',),
        'rpo.training.gym_vector': ('DispersedApproach',),
        'rpo_core.control.controller': ('FuzzyController',),
        'rpo_core.judge.verdicts': ('Verdict',),
        'rpo_core.scenario.scenario': ('Scenario',),
    }.items()
    for name in names
}
"""Name -> its module, imported as the name is asked for."""

_LAYERS = {
    'report': ('cryptography', 'matplotlib', 'rich', 'scipy', 'typer'),
    'train': ('cma', 'numba', 'pymoo'),
    'campaign': ('cvxpy', 'dask', 'distributed'),
    'gym': ('gymnasium',),
}
"""Layer of `make setup`, and extra of the wheel -> modules that it brings."""

for _layer, _modules in _LAYERS.items():
    _install = f"`make setup LAYERS={_layer}`, or `pip install 'rpo[{_layer}]'`"
    INSTALLED_BY.update(dict.fromkeys(_modules, _install))
INSTALLED_BY['ccsds_ndm'] = '`make setup LAYERS=formats`'
INSTALLED_BY['Basilisk'] = '`make setup LAYERS=truth`'

__all__ = ['InputError', *_MODULES]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f'module `rpo` has no attribute `{name}`; it has {", ".join(__all__)}')
    with missing_reported():
        value = getattr(import_module(_MODULES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
