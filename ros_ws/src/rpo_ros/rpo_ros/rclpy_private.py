# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The private names of rclpy that this stack uses, and why: nowhere else.

They are those of rclpy 7.1 (Jazzy) and 9.1 (Kilted).
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNodeMixin, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future

RCLError = rclpy_implementation.RCLError
"""What a middleware that does not start raises; rclpy names it nowhere else."""


def overrides_of(node: Node) -> dict[str, Parameter]:
    """Return the parameters given to a node, by name; changes take effect at the declaration.

    rclpy has no other access to them. They are needed before the declaration: it refuses
    `real_time_factor:=20` (an int for a double) and does not report a misspelt name.
    """
    overrides: dict[str, Parameter] = getattr(node, '_parameter_overrides', {})
    return overrides


class Pending(Future):
    """A future that a signal handler may complete: one thread can take its lock twice.

    rclpy's own lock cannot: a signal that comes while a future is looked at would stop the node.
    """

    def __init__(self) -> None:
        super().__init__()
        self._lock = threading.RLock()


class Lifecycle(LifecycleNodeMixin):
    """The lifecycle of a `FlightNode`; refuses a transition that is not possible now.

    rclpy ends the process with such a transition, and names the state of a node nowhere else.
    """

    complain: Callable[[str], None]

    @property
    def label(self) -> str:
        """State of the lifecycle: unconfigured, inactive, active or finalized."""
        return str(self._state_machine.current_state[1])

    def destroy_node(self) -> None:
        """Destroy the node with its state machine, which rclpy leaves to the end of Python.

        It holds the node, and so the middleware: its threads would run while the process ends,
        where an `assurance` once died of SIGSEGV.
        """
        super().destroy_node()  # type: ignore[misc]
        if hasattr(self, '_state_machine'):  # else the node did not get ready
            self._state_machine.destroy_when_not_in_use()

    def _LifecycleNodeMixin__change_state(self, transition: int) -> TransitionCallbackReturn:
        possible = {number for number, *_ in self._state_machine.available_transitions}
        if transition not in possible:
            self.complain(f'a transition was refused: {transition} is not possible in {self.label}')
            return TransitionCallbackReturn.FAILURE
        return super()._LifecycleNodeMixin__change_state(transition)
