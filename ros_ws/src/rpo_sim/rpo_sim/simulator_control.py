# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Services by which people steer a simulator: pause, step, reset, abort.

They are std_srvs; simulation_interfaces, the standard names for the same, is not among the ROS
wheels. A call returns at once; `run_status` says when what was asked for has happened.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from std_srvs.srv import SetBool, Trigger

if TYPE_CHECKING:
    from rpo_sim.plant_node import PlantNode

Answer = SetBool.Response | Trigger.Response


def _answer(response: Answer, refusal: str, done: str) -> Answer:
    response.success = not refusal
    response.message = refusal or done
    return response


class SimulatorControl:
    """The plant's services `~/pause`, `~/step`, `~/reset` and `~/abort`.

    paused : no tick passes but those asked for
    steps : ticks that were asked for and have not passed
    """

    def __init__(self, node: PlantNode) -> None:
        self.node = node
        self.paused = False
        self.steps = 0
        node.create_service(SetBool, '~/pause', self._on_pause)
        node.create_service(Trigger, '~/step', self._on_step)
        node.create_service(Trigger, '~/reset', self._on_reset)
        node.create_service(Trigger, '~/abort', self._on_abort)

    def release(self) -> None:
        """Forget pause and steps: a new run begins."""
        self.paused, self.steps = False, 0

    def passed(self) -> bool:
        """Count a tick; return whether it was the last one asked for."""
        if self.steps:
            self.steps -= 1
        return self.paused and not self.steps

    def _grounded(self) -> str:
        return '' if self.node.phase == 'running' else f'nothing flies: {self.node.phase}'

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        refusal = self._grounded()
        if not refusal and request.data != self.paused:
            self.paused, self.steps = request.data, 0
            if self.paused:
                self.node.say_paused()
            else:
                self.node.resume()
        done = 'paused' if request.data else 'running'
        return _answer(response, refusal, f'{done} at tick {self.node.plant.tick}')

    def _on_step(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        refusal = self._grounded() or ('' if self.paused else 'not paused: pause first')
        tick, asked = self.node.plant.tick, self.node.values['step_ticks']
        if not refusal:
            fresh = not self.steps
            self.steps += asked
            if fresh:
                self.node.go_on()
        return _answer(response, refusal, f'{asked} ticks from tick {tick}')

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        refusal = self._grounded()
        tick = self.node.plant.tick
        if not refusal:
            self.node.reset()
        return _answer(response, refusal, f'reset at tick {tick}')

    def _on_abort(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        refusal = self._grounded() if self.node.phase != 'waiting' else ''
        tick = self.node.plant.tick
        if not refusal:
            self.node.abort('abort asked for')
        return _answer(response, refusal, f'aborted at tick {tick}')
