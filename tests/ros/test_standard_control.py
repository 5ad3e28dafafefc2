# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The standard simulation_interfaces, with a double of the package: no wheel has it.

A real plant flies with real peers; only the transport of these requests is not there. Constants are
those of simulation_interfaces 1.x.
"""

import sys
from types import ModuleType, SimpleNamespace

import pytest
from test_plant_node import Bench

from rpo_sim import services
from rpo_sim.plant_node import PlantNode

OK, UNSUPPORTED, INCORRECT, FAILED = 1, 0, 3, 4
STOPPED, PLAYING, PAUSED, QUITTING = 0, 1, 2, 3


class Answer(SimpleNamespace):
    """Any response: a result, a state, features; and the codes of SetSimulationState."""

    ALREADY_IN_TARGET_STATE, INCORRECT_TRANSITION = 101, 103

    def __init__(self):
        super().__init__(result=Answer.part(), state=Answer.part(), features=Answer.part())

    part = SimpleNamespace


class Reset(SimpleNamespace):
    SCOPE_DEFAULT, SCOPE_TIME, SCOPE_ALL = 0, 1, 255


SERVICES = (
    'GetSimulatorFeatures', 'GetSimulationState', 'SetSimulationState', 'ResetSimulation',
    'StepSimulation',
)  # fmt: skip


class Double:
    """The package as modules, its action server, and a client of what the plant offers."""

    def __init__(self, monkeypatch):
        kinds = {name: SimpleNamespace(Response=Answer) for name in SERVICES}
        steps = SimpleNamespace(Feedback=SimpleNamespace, Result=Answer)
        messages = {
            'Result': SimpleNamespace(
                RESULT_OK=OK, RESULT_FEATURE_UNSUPPORTED=UNSUPPORTED,
                RESULT_INCORRECT_STATE=INCORRECT, RESULT_OPERATION_FAILED=FAILED,
            ),
            'SimulationState': SimpleNamespace(
                STATE_STOPPED=STOPPED, STATE_PLAYING=PLAYING, STATE_PAUSED=PAUSED,
                STATE_QUITTING=QUITTING,
            ),
            'SimulatorFeatures': SimpleNamespace(
                SIMULATION_RESET=20, SIMULATION_STATE_GETTING=24, SIMULATION_STATE_SETTING=25,
                SIMULATION_STATE_PAUSE=26, STEP_SIMULATION_SINGLE=31, STEP_SIMULATION_MULTIPLE=32,
                STEP_SIMULATION_ACTION=33,
            ),
        }  # fmt: skip
        parts = {'msg': messages, 'srv': kinds, 'action': {'SimulateSteps': steps}}
        for name, content in parts.items():
            module = ModuleType(f'{services.PACKAGE}.{name}')
            vars(module).update(content)
            monkeypatch.setitem(sys.modules, module.__name__, module)
        package = ModuleType(services.PACKAGE)
        monkeypatch.setitem(sys.modules, package.__name__, package)
        self.offered, real = {}, PlantNode.create_service

        def create_service(node, kind, name, callback, **options):
            if kind in kinds.values():
                self.offered[name] = callback
                return None
            return real(node, kind, name, callback, **options)

        monkeypatch.setattr(PlantNode, 'create_service', create_service)
        monkeypatch.setattr(services, 'ActionServer', self._serve)

    def _serve(self, _node, _kind, name, execute, cancel_callback):
        self.offered[name] = execute

    def call(self, bench, name, request=None):
        """Return the response of a service, or the result of the action."""
        callback, response = self.offered[f'~/{name}'], Answer()
        arguments = (request,) if name == 'simulate_steps' else (request, response)
        task = bench.inner.executor.create_task(callback, *arguments)
        bench.until(task.done)
        return task.result()

    def set(self, bench, state):
        request = SimpleNamespace(state=SimpleNamespace(state=state))
        return self.call(bench, 'set_simulation_state', request).result.result

    def state(self, bench):
        return self.call(bench, 'get_simulation_state').state.state


class Goal:
    """A goal of the action, as the client sees it."""

    def __init__(self, steps, cancel_after=None):
        self.request, self.fed, self.end = SimpleNamespace(steps=steps), [], ''
        self.cancel_after = cancel_after

    @property
    def is_cancel_requested(self):
        return len(self.fed) == self.cancel_after

    def publish_feedback(self, feedback):
        self.fed.append((feedback.completed_steps, feedback.remaining_steps))

    def succeed(self):
        self.end = 'succeeded'

    def abort(self):
        self.end = 'aborted'

    def canceled(self):
        self.end = 'canceled'


@pytest.fixture
def double(monkeypatch):
    return Double(monkeypatch)


@pytest.fixture
def bench(double, inner, tmp_path):
    found = Bench(inner, tmp_path)
    found.start(real_time_factor=10.0)
    return found


def test_it_pauses_steps_and_plays_by_the_standard(double, bench):
    assert double.state(bench) == STOPPED
    assert double.set(bench, PAUSED) == Answer.INCORRECT_TRANSITION
    bench.says('flying')
    assert double.state(bench) == PLAYING
    assert double.set(bench, PLAYING) == Answer.ALREADY_IN_TARGET_STATE
    step = SimpleNamespace(steps=4)
    refused = double.call(bench, 'step_simulation', step).result
    assert refused.result == FAILED and 'pause first' in refused.error_message
    assert double.set(bench, PAUSED) == OK and double.state(bench) == PAUSED
    before = bench.plant.tick
    assert double.call(bench, 'step_simulation', step).result.result == OK
    assert bench.plant.tick == before + 4 and double.state(bench) == PAUSED
    goal = Goal(3)
    assert double.call(bench, 'simulate_steps', goal).result.result == OK
    assert goal.fed == [(1, 2), (2, 1), (3, 0)] and goal.end == 'succeeded'
    goal = Goal(50, cancel_after=2)
    assert double.call(bench, 'simulate_steps', goal).result.result == FAILED
    assert goal.end == 'canceled' and bench.plant.tick == before + 9
    assert double.set(bench, STOPPED) == UNSUPPORTED
    assert double.set(bench, QUITTING) == OK
    bench.until(lambda: bench.plant.done)
    assert bench.plant.exit_code == 3


def test_steps_that_the_run_has_not_are_no_success(double, bench):
    bench.says('flying')
    assert double.set(bench, PAUSED) == OK
    bench.inner.set('plant', real_time_factor=0.0)
    found = double.call(bench, 'step_simulation', SimpleNamespace(steps=10_000)).result
    assert found.result == FAILED and found.error_message == 'finished at tick 200'


def test_a_reset_is_one_of_all_and_features_are_those_it_has(double, bench):
    reset = Reset(scope=Reset.SCOPE_ALL)
    assert double.call(bench, 'reset_simulation', reset).result.result == INCORRECT
    bench.until(lambda: bench.plant.tick > 2)
    time_only = Reset(scope=Reset.SCOPE_TIME)
    assert double.call(bench, 'reset_simulation', time_only).result.result == UNSUPPORTED
    assert double.call(bench, 'reset_simulation', reset).result.result == OK
    bench.until(lambda: bench.plant.phase == 'waiting')
    features = double.call(bench, 'get_simulator_features').features.features
    assert features == [20, 24, 25, 26, 31, 32, 33]


def test_without_the_package_there_is_nothing_of_it(monkeypatch):
    monkeypatch.setitem(sys.modules, services.PACKAGE, None)
    assert services.offer(None) is None
