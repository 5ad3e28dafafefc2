# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Proof that a flight happened as logged: every stage of it recomputed, compared bit for bit.

`verify` is all that others need. What is computed comes from the scenario and the controller that
the log carries; a stage that the chain of the scenario does not have cannot be checked here.
"""

from rpo_log.errors import ExitCode
from rpo_log.verify.verification import Verification
from rpo_log.verify.verifier import verify

__all__ = ['ExitCode', 'Verification', 'verify']
