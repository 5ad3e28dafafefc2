# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Services of std_srvs that steer a simulation: pause, step, reset, abort.

A call returns at once; `run_status` reports when the request is done.
"""

from __future__ import annotations

from std_srvs.srv import SetBool, Trigger

from rpo_core.wire.statuses import PAUSED, RUNNING, WAITING
from rpo_sim.pacing import Loop

Answer = SetBool.Response | Trigger.Response


def _answer(response: Answer, refusal: str, done: str) -> Answer:
    response.success = not refusal
    response.message = refusal or done
    return response


class SimulatorControl:
    """The plant's services `~/pause`, `~/step`, `~/reset` and `~/abort`."""

    def __init__(self, loop: Loop) -> None:
        self.loop = loop
        loop.create_service(SetBool, '~/pause', self._on_pause)
        loop.create_service(Trigger, '~/step', self._on_step)
        loop.create_service(Trigger, '~/reset', self._on_reset)
        loop.create_service(Trigger, '~/abort', self._on_abort)

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        refusal = self.loop.no_run
        if not refusal:
            self.loop.pause(request.data)
        done = PAUSED if request.data else RUNNING
        return _answer(response, refusal, f'{done} at tick {self.loop.tick}')

    def _on_step(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        loop = self.loop
        refusal, tick, requested = loop.not_paused, loop.tick, loop.values['step_ticks']
        if not refusal:
            loop.step(requested)
        return _answer(response, refusal, f'{requested} ticks from tick {tick}')

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        refusal, tick = self.loop.no_run, self.loop.tick
        if not refusal:
            self.loop.reset()
        return _answer(response, refusal, f'reset at tick {tick}')

    def _on_abort(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        refusal = self.loop.no_run if self.loop.phase != WAITING else ''
        tick = self.loop.tick
        if not refusal:
            self.loop.abort('abort requested')
        return _answer(response, refusal, f'aborted at tick {tick}')
