# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Services to steer a simulation: pause, step, reset, abort; and the standard ones.

The first use std_srvs. A call returns at once; `run_status` reports when the request is done.

The standard ones are those of the package `simulation_interfaces`, where it is installed. The
wheels have no such package: tests use a double of its messages, and what goes over DDS with the
real one is not tested. Sources: simulation_interfaces 1.x, srv/*.srv and action/SimulateSteps.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from rpo_core.wire.statuses import ENDED, PAUSED, RUNNING, WAITING
from rpo_sim.pacing import Loop

PACKAGE = 'simulation_interfaces'
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


def offer(loop: Loop) -> StandardControl | None:
    """Offer the standard services of a plant; None: the package is not installed."""
    try:
        parts = [import_module(f'{PACKAGE}.{part}') for part in ('msg', 'srv', 'action')]
    except ImportError:
        return None
    return StandardControl(loop, *parts)


class StandardControl:
    """The services of the standard that a plant has, and its action `~/simulate_steps`.

    A step is a tick. Steps that were asked for by others meanwhile are waited for too.
    """

    def __init__(self, loop: Loop, msg: ModuleType, srv: ModuleType, action: ModuleType) -> None:
        self.loop, self.msg, self.action = loop, msg, action
        self._waiting: list[Future] = []
        for kind, name, answer in (
            (srv.GetSimulatorFeatures, 'get_simulator_features', self._on_features),
            (srv.GetSimulationState, 'get_simulation_state', self._on_state),
            (srv.SetSimulationState, 'set_simulation_state', self._on_set_state),
            (srv.ResetSimulation, 'reset_simulation', self._on_reset),
            (srv.StepSimulation, 'step_simulation', self._on_step),
        ):
            loop.create_service(kind, f'~/{name}', answer)
        ActionServer(
            loop,
            action.SimulateSteps,
            '~/simulate_steps',
            self._on_steps,
            cancel_callback=lambda _goal: CancelResponse.ACCEPT,
        )
        self._already = srv.SetSimulationState.Response.ALREADY_IN_TARGET_STATE
        self._incorrect = srv.SetSimulationState.Response.INCORRECT_TRANSITION

    def moved(self) -> None:
        """React to a tick that passed, and to the end of a run."""
        waiting, self._waiting = self._waiting, []
        for future in waiting:
            future.set_result(None)

    def _fill(self, response: Any, code: int, error: str = '') -> Any:
        response.result.result, response.result.error_message = code, error
        return response

    def _ok(self, response: Any) -> Any:
        return self._fill(response, self.msg.Result.RESULT_OK)

    @property
    def _state(self) -> int:
        """State of the simulation; before the first tick, and after the last, it is stopped."""
        states = self.msg.SimulationState
        if self.loop.phase != RUNNING:
            return int(states.STATE_STOPPED)
        return int(states.STATE_PAUSED if self.loop.paused else states.STATE_PLAYING)

    def _on_features(self, _request: Any, response: Any) -> Any:
        known = self.msg.SimulatorFeatures
        response.features.features = [
            known.SIMULATION_RESET, known.SIMULATION_STATE_GETTING, known.SIMULATION_STATE_SETTING,
            known.SIMULATION_STATE_PAUSE, known.STEP_SIMULATION_SINGLE,
            known.STEP_SIMULATION_MULTIPLE, known.STEP_SIMULATION_ACTION,
        ]  # fmt: skip
        response.features.custom_info = 'a step is a tick; docs/faults.md, Pause, step, reset'
        return response

    def _on_state(self, _request: Any, response: Any) -> Any:
        response.state.state = self._state
        return self._ok(response)

    def _on_set_state(self, request: Any, response: Any) -> Any:
        loop, states, wanted = self.loop, self.msg.SimulationState, request.state.state
        if wanted == self._state:
            return self._fill(response, self._already, 'it is in this state already')
        if wanted == states.STATE_QUITTING and loop.phase not in ENDED:
            loop.abort('quitting, by request')
        elif wanted not in (states.STATE_PLAYING, states.STATE_PAUSED):
            unsupported = self.msg.Result.RESULT_FEATURE_UNSUPPORTED
            return self._fill(response, unsupported, 'only playing, paused and quitting; or reset')
        elif loop.phase != RUNNING:
            reason = f'no run in progress ({loop.phase}): it begins when all peers have answered'
            return self._fill(response, self._incorrect, reason)
        else:
            loop.pause(wanted == states.STATE_PAUSED)
        return self._ok(response)

    def _on_reset(self, request: Any, response: Any) -> Any:
        result, kind = self.msg.Result, type(request)
        if request.scope not in (kind.SCOPE_DEFAULT, kind.SCOPE_ALL):
            reason = 'time and state are reset together: SCOPE_DEFAULT or SCOPE_ALL'
            return self._fill(response, result.RESULT_FEATURE_UNSUPPORTED, reason)
        if self.loop.no_run:
            return self._fill(response, result.RESULT_INCORRECT_STATE, self.loop.no_run)
        self.loop.reset()
        return self._ok(response)

    def _refusal(self) -> str:
        return self.loop.not_paused or ('not paused: pause first' if self.loop.steps else '')

    async def _passes(self, steps: int) -> str:
        """Let ticks pass; return why they did not all pass, or ''."""
        loop, last = self.loop, self.loop.tick + steps
        loop.step(steps)
        while loop.steps and loop.phase == RUNNING:
            self._waiting.append(Future())
            await self._waiting[-1]
        return '' if loop.tick >= last else f'{loop.phase} at tick {loop.tick}'

    async def _on_step(self, request: Any, response: Any) -> Any:
        reason = self._refusal() or await self._passes(int(request.steps))
        if reason:
            return self._fill(response, self.msg.Result.RESULT_OPERATION_FAILED, reason)
        return self._ok(response)

    async def _on_steps(self, goal: Any) -> Any:
        """Pass the ticks of a goal one by one: feedback after each, and a request may cancel it."""
        steps, feedback = int(goal.request.steps), self.action.SimulateSteps.Feedback()
        result, reason = self.action.SimulateSteps.Result(), self._refusal()
        done = 0
        while done < steps and not (reason or goal.is_cancel_requested):
            reason = await self._passes(1)
            if not reason:
                done += 1
                feedback.completed_steps, feedback.remaining_steps = done, steps - done
                goal.publish_feedback(feedback)
        if goal.is_cancel_requested and not reason:
            goal.canceled()
            return self._fill(result, self.msg.Result.RESULT_OPERATION_FAILED, 'cancelled')
        if reason:
            goal.abort()
            return self._fill(result, self.msg.Result.RESULT_OPERATION_FAILED, reason)
        goal.succeed()
        return self._ok(result)
