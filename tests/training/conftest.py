# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is dear to make and many tests read: small proofs, once a session. Nobody changes them."""

from __future__ import annotations

from functools import partial

import pytest


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a campaign, of a short flight if none is given; its path."""
    from campaign_documents import write_campaign

    return partial(write_campaign, tmp_path)


@pytest.fixture
def loaded(write):
    """Return a function that writes such a campaign and returns it."""
    from rpo.montecarlo import config

    return lambda *flown, **changes: config.load(write(*flown, **changes))


@pytest.fixture(scope='session')
def sound(tmp_path_factory):
    """The folder of a proof of a few cells, all of whose claims are proven."""
    from proofs import BOX, problem_of, proof_of

    return proof_of(problem_of('allround', half=BOX), tmp_path_factory.mktemp('sound') / 'proof')


@pytest.fixture(scope='session')
def proofs(tmp_path_factory):
    """A small proof of each kind; one claim of the first is refuted."""
    from proofs import KINDS, problem_of_kind, proof_of

    return {
        kind: proof_of(problem_of_kind(kind), tmp_path_factory.mktemp(kind) / 'proof')
        for kind in KINDS
    }
