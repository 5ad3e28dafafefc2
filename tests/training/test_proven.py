# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One source for what the pages say of proofs: what ships, and where it comes from."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from invoking import refused
from proofs import problem_of

from rpo.analysis.comparison import CONTROLLERS
from rpo.proof import proven
from rpo.proof.folder import Folder
from rpo_core import files
from rpo_core.control.controller import load_controller
from rpo_core.files import DEFAULT_CONTROLLER

DOCS = Path(__file__).parents[2] / 'docs'
TRAINING_BOX = (100.0, 100.0, 100.0, 0.0, 0.0, 0.0)


def test_both_pages_say_what_the_file_of_results_says():
    page = (DOCS / 'proof.md').read_text()
    block = page.partition('<!-- proven: begin -->')[2].partition('<!-- proven: end -->')[0]
    assert block.strip() == proven.markdown(proven.shipped()).strip()
    table = (DOCS / 'compare.md').read_text().partition('| proof |')[2]
    column = dict(re.findall(r'^\| (\w+) \|.*\| ([^|]+) \|$', table.partition('\n\n')[0], re.M))
    assert column == {name: proven.proof_of(load_controller(name)) for name in CONTROLLERS}


def test_a_result_is_of_numbers_and_of_no_name():
    posed = load_controller(DEFAULT_CONTROLLER)
    scales = posed.position_scale_m
    assert proven.proof_of(replace(posed, position_scale_m=scales + 1e-9)) == proven.NO_PROOF
    renamed = replace(load_controller(DEFAULT_CONTROLLER), name='mine', provenance={})
    assert proven.proof_of(renamed) == 'proven'


@pytest.mark.parametrize(
    ('verdicts', 'said'),
    [
        (('proven', 'proven', 'proven'), 'proven'),
        (('proven', 'open', 'refuted'), 'refuted: speed'),
        (('open', 'open', 'proven'), 'open: arrival, slew'),
        (('proven',), 'open: slew, speed'),
    ],
)
def test_a_condition_that_the_proof_leaves_open_is_not_proven(monkeypatch, verdicts, said):
    keys = ('mean_error_norm_m', 'slew_per_axis_n_s', 'mean_speed_norm_m_s')
    figures = {'proven': (0.4, 0.3), 'open': (0.6, 0.3), 'refuted': (0.4, 0.6)}
    claims = tuple(
        proven.ProvenClaim(key, key, 'm', 0.5, *figures[verdict])
        for key, verdict in zip(keys, verdicts, strict=False)
    )
    controller = load_controller('paper_ga')
    digest = proven.numbers_of(controller)
    monkeypatch.setattr(
        proven, 'shipped', lambda: (proven.Proof('paper_ga', digest, 'c', 'c', 'd', claims),)
    )
    head, *names = re.split(': |, ', proven.proof_of(controller))
    expected, *those = re.split(': |, ', said)
    assert (head, sorted(names)) == (expected, sorted(those))


def changed(kind):
    """Return a problem that is not that of `rpo prove NAME`, or is."""
    problem = problem_of('allround', TRAINING_BOX)
    own = problem.settings
    return {
        'box': problem_of('allround'),
        'claims': replace(problem, settings=replace(own, claims=('slew_per_axis_n_s',))),
        'moving': replace(problem, settings=replace(own, mass_share=0.1)),
        'numbers': replace(problem, controller=replace(problem.controller, position_scale_m=61.0)),
        'unfinished': problem,
    }[kind]


@pytest.mark.parametrize(
    ('kind', 'said'),
    [
        ('box', 'must be that of `rpo prove NAME`'),
        ('claims', 'must be that of `rpo prove NAME`'),
        ('moving', 'must be that of `rpo prove NAME`'),
        ('numbers', 'has other numbers than the one that ships as allround'),
        ('unfinished', 'is not finished'),
    ],
)
def test_what_is_not_a_checked_proof_of_the_box_is_not_written(tmp_path, kind, said):
    Folder.create(tmp_path / 'f', changed(kind))
    assert said in refused('prove', '--check', tmp_path / 'f', '--publish')


def test_a_proof_of_the_box_is_published_in_the_place_of_the_older_one(tmp_path, monkeypatch):
    """The file and the page that ship are what their own results give."""
    (tmp_path / 'a' / 'proofs').mkdir(parents=True)
    (tmp_path / 'docs').mkdir()
    page, kept = tmp_path / 'docs' / 'proof.md', proven.PATH.read_text()
    page.write_text((DOCS / 'proof.md').read_text())
    monkeypatch.setattr(proven, 'PATH', tmp_path / 'a' / 'proofs' / 'proven.yaml')
    shipped = proven.shipped()
    proven.write(shipped)
    assert proven.PATH.read_text() == kept
    monkeypatch.setattr(proven, 'shipped', lambda: files.load(proven.PATH, proven.parse))
    proven.publish(shipped[0])
    assert (proven.PATH.read_text(), page.read_text()) == (kept, (DOCS / 'proof.md').read_text())
    proven.publish(replace(shipped[0], claims=()))
    assert proven.shipped() == (replace(shipped[0], claims=()), *shipped[1:])
    assert page.read_text() != (DOCS / 'proof.md').read_text()
