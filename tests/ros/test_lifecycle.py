# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The controller as a managed node: what each transition does, and what a bad one leaves."""

from pathlib import Path

from rpo_core import files
from rpo_core.control.controller import load_controller
from rpo_ctrl.assurance_node import AssuranceNode
from rpo_ctrl.fuzzy_controller_node import ControllerNode
from rpo_ros.signals import Outlet, listen

STATE = (10.0, 60.0, -40.0, 0.1, -0.2, 0.05)
NODE = '/fuzzy_controller'
NAMED = {'scenario': 'approach'}  # there is no plant to say it


class Asker:
    """Sends states and keeps the answers."""

    def __init__(self, bench):
        self.until = bench.until
        self.answers = {}
        self.states = Outlet(bench.user, 'relative_state')
        self.until(self.states.publisher.get_subscription_count)
        listen(bench.user, 'control_force', self._on_force, print)

    def _on_force(self, stamp_ns, force):
        self.answers.setdefault(stamp_ns, []).append(force)

    def ask(self, stamp_ns, state=STATE):
        before = len(self.answers.get(stamp_ns, []))
        self.states.publish(stamp_ns, state)
        self.until(lambda: len(self.answers.get(stamp_ns, [])) > before)
        return self.answers[stamp_ns][-1]


def force_of(name):
    return load_controller(name).force_n(STATE[:3], STATE[3:])


def test_each_transition_does_what_it_says(inner, capfd):
    node = inner.start(ControllerNode({**NAMED, 'autostart': False, 'controller': 'handmade'}))
    asker = Asker(inner)
    asker.states.publish(1, STATE)
    inner.until(lambda: node.ignored['not_activated'])
    assert inner.state(NODE) == 'unconfigured'
    assert inner.transition(NODE, 'configure')
    asker.states.publish(2, STATE)
    inner.until(lambda: node.ignored['not_activated'] == 2)
    assert not asker.answers, 'it commanded before it was activated'
    assert inner.transition(NODE, 'activate')
    assert asker.ask(3) == force_of('handmade') != (0.0, 0.0, 0.0)
    successful, reason = inner.set(NODE, controller='paper_ga')
    assert not successful and 'deactivate` first' in reason
    assert inner.transition(NODE, 'deactivate')
    assert asker.ask(3) == force_of('handmade'), 'two answers to one state differ'
    assert asker.ask(4) == (0.0, 0.0, 0.0)
    successful, reason = inner.set(NODE, controller='nope')
    assert not successful and "'nope'" in reason
    assert node.controller.name == 'handmade' == node.values['controller']
    assert inner.transition(NODE, 'cleanup')
    assert asker.ask(5) == (0.0, 0.0, 0.0)
    assert inner.set(NODE, controller='paper_ga') == (True, '')
    assert inner.transition(NODE, 'configure') and inner.transition(NODE, 'activate')
    assert asker.ask(6) == force_of('paper_ga')
    assert inner.state(NODE) == 'active'
    assert node.health()[2]['answered_zero'] == 2
    assert inner.transition(NODE, 'shutdown') and node.done
    assert 'inactive: commanding zero' in capfd.readouterr().err


def test_a_bad_file_leaves_the_node_unconfigured_and_says_why(inner, tmp_path, capfd):
    good = files.shipped('controller')['handmade'].read_text()
    path = tmp_path / 'mine.yaml'
    path.write_text(good.replace('position_m:', 'position_km:'))
    inner.start(ControllerNode({'autostart': False, 'controller': str(path)}))
    assert not inner.transition(NODE, 'configure')
    assert inner.state(NODE) == 'unconfigured'
    assert not inner.transition(NODE, 'activate'), 'there is no such transition from here'
    path.write_text(good)
    assert inner.transition(NODE, 'configure') and inner.state(NODE) == 'inactive'
    said = capfd.readouterr().err
    assert f'cannot configure: {path}: `scales.position_km`' in said and 'Traceback' not in said


def test_what_breaks_inside_is_logged_with_its_cause(inner, capfd):
    class Broken(ControllerNode):
        fault = ''

        def parse(self, document):
            if self.fault == 'configure':
                raise ZeroDivisionError('in the parser')
            return super().parse(document)

        def part(self, scenario):
            chain = super().part(scenario)
            chain.links[0].stage.step = self.broken
            return chain

        @staticmethod
        def broken(tick, *inputs):
            if inputs == (STATE,):  # not while it warms up
                raise ZeroDivisionError('in the law')
            return ((0.0, 0.0, 0.0),)

    node = inner.start(Broken(NAMED))
    asker = Asker(inner)
    assert asker.ask(1) == (0.0, 0.0, 0.0), 'a broken law commands zero'
    assert inner.state(NODE) == 'inactive'
    assert inner.transition(NODE, 'cleanup')
    node.fault = 'configure'
    assert not inner.transition(NODE, 'configure')
    assert inner.state(NODE) == 'unconfigured'
    said = capfd.readouterr().err
    assert 'ZeroDivisionError: in the law' in said
    assert 'configure broke' in said and 'ZeroDivisionError: in the parser' in said


def threads_of_dds():
    """Return the threads of participants in this process; one of shared memory serves them all."""
    names = (path / 'comm' for path in Path('/proc/self/task').iterdir())
    found = [(str(name), name.read_text().strip()) for name in names]
    return {(task, name) for task, name in found if 'dds' in name and name != 'dds.shm.wdog'}


def test_a_managed_node_that_has_ended_leaves_no_participant_of_dds(command):
    """Its threads ran while the process ended, in which it may have died of SIGSEGV."""
    before = threads_of_dds()
    code, said = command(AssuranceNode.main, scenario='quick')
    assert code == 0 and 'nothing to do' in said
    assert threads_of_dds() <= before
