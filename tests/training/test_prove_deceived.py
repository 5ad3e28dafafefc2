# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The checker of proofs is not deceived: by folders that were changed so that they say more."""

from __future__ import annotations

import copy
import io
import shutil
import tracemalloc
import zipfile
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import yaml
from invoking import invoke
from landing import rest_at_landing
from proofs import KINDS, SAMPLE

from rpo.montecarlo.outputs import digest_of
from rpo.proof import check as checker
from rpo.proof import flights, proving
from rpo.proof.cells import VALUES
from rpo.proof.check import check, why_outside
from rpo.proof.claims import values_of
from rpo.proof.folder import TEXTS, Folder, cells_of, write_arrays
from rpo.proof.problem import Problem, Settings
from rpo.reports.proof import report_of
from rpo_core.chain.flight import fly
from rpo_core.control.controller import dumps, load_controller
from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import load_scenario


@pytest.fixture
def copy_of(proofs, tmp_path):
    """Return a function that copies the folder of a kind."""

    def copied(kind):
        return shutil.copytree(proofs[kind].path, tmp_path / kind)

    return copied


def faults(path):
    """Return what the checker says of a folder: its faults, or why it cannot be read."""
    try:
        return check(Folder.open(path), SAMPLE).faults
    except InputError as error:
        return [str(error)]


def stamp(path):
    """Write the digest that fits the premises of a folder."""
    texts = Problem.of_texts([(path / name).read_text() for name in TEXTS]).texts
    recorded = yaml.safe_load((path / 'versions.yaml').read_text())
    recorded['files_sha256'] = digest_of(*texts)
    (path / 'versions.yaml').write_text(yaml.safe_dump(recorded))


def edit(path, change):
    """Change the document of a YAML file in place."""
    document = yaml.safe_load(path.read_text())
    document = change(document) or document
    path.write_text(yaml.safe_dump(document, sort_keys=False))


def edit_arrays(path, change):
    """Change the arrays of a file in place."""
    with np.load(path) as saved:
        arrays = {name: saved[name] for name in saved.files}
    change(arrays)
    np.savez(path, **arrays)


def widen(path, half_m):
    """Let a folder say that it is about a larger box."""
    edit(path / 'proof.yaml', lambda document: document['half'].__setitem__(0, half_m))
    stamp(path)


@pytest.mark.parametrize('kind', KINDS)
def test_a_true_folder_has_no_fault(proofs, kind):
    assert faults(proofs[kind].path) == []


@pytest.mark.parametrize(
    ('kind', 'made'), list(zip(KINDS, ('set_faults', 'merging_faults'), strict=True))
)
def test_each_kind_of_proof_has_its_own_check_of_tubes(proofs, monkeypatch, kind, made):
    called = set()
    for name in ('set_faults', 'merging_faults'):
        monkeypatch.setattr(checker, name, lambda *_, n=name: called.add(n) or iter(()))
    assert check(proofs[kind], SAMPLE).faults == [] and called == {made}


@pytest.mark.parametrize('last_s', [np.nan, 0.0, -0.1, -np.inf])
@pytest.mark.parametrize('kind', KINDS)
def test_a_cell_without_a_tube_covers_nothing(copy_of, kind, last_s):
    """A hundred metres, held by a cell that nobody flew."""
    path = copy_of(kind)

    def unseen(arrays):
        for name in ('centre', 'half', 'values', 'boxes'):
            arrays[name] = arrays[name][:1]
        arrays['half'][0, 0] = 200.0
        arrays['values'][0, VALUES.index('last_s')] = last_s

    edit_arrays(path / ('planar.npz' if kind == 'together' else 'x.npz'), unseen)
    widen(path, 100.0)
    assert faults(path)


def test_a_negative_box_is_refused(copy_of):
    """0 ± -0.6 m reads like 0 ± 0.6 m, and would be a point."""
    path = copy_of('together')
    edit(path / 'proof.yaml', lambda document: document['half'].__setitem__(0, -0.6))
    (sentence,) = faults(path)
    assert '`half` must be a finite number >= 0' in sentence


def test_a_folder_is_of_one_problem_and_of_this_code(copy_of, monkeypatch):
    path = copy_of('together')
    found = Folder.open(path)
    found.refuse_other_code()
    assert found.others() == []
    for name in ('notes.txt', 'counterexample_peace.yaml', 'more.npz'):
        (path / name).write_text('certified')
    assert found.others() == ['counterexample_peace.yaml', 'more.npz', 'notes.txt']
    for key, word in (('numpy', 'libraries'), ('code_sha256', 'code')):
        other = shutil.copytree(path, path.parent / key)
        edit(other / 'versions.yaml', lambda document, key=key: document.update({key: '1.0'}))
        with pytest.raises(InputError, match=f'was begun with other {word}'):
            Folder.open(other).refuse_other_code()
    edit(path / 'proof.yaml', lambda document: document['half'].__setitem__(0, 0.7))
    (sentence,) = faults(path)
    assert 'must be as they were when it was begun' in sentence


LIES = {
    'bound': lambda s: s['claims']['mean_error_norm_m'].update(bound=0.1),
    'unit': lambda s: s['claims']['mean_error_norm_m'].update(unit='mm'),
    'statement': lambda s: s['claims']['mean_error_norm_m'].update(statement='error, for ever'),
    'verdict': lambda s: s['claims']['slew_per_axis_n_s'].update(verdict='proven'),
    'flown': lambda s: s['claims']['mean_error_norm_m'].update(found=0.01),
    'start': lambda s: s['claims']['mean_error_norm_m'].update(start=[0.1] * 6),
    'no start': lambda s: s['claims']['mean_error_norm_m'].update(found=0.01, start=[]),
    'limit': lambda s: s['claims']['mean_error_norm_m'].update(limit=0.6),
    'another claim': lambda s: s['claims'].update(
        peace=copy.deepcopy(s['claims']['mean_error_norm_m'])
    ),
    'a field': lambda s: s['claims']['mean_error_norm_m'].update(certified=True),
    'no claim': lambda s: s['claims'].pop('mean_error_norm_m') and None,
    'range': lambda s: s['ranges']['force_n'].update(high=0.01),
    'range of a unit': lambda s: s['ranges']['force_n'].update(unit='mN'),
    'another range': lambda s: s['ranges'].update(fuel=dict(s['ranges']['force_n'])),
    'cells': lambda s: s['cells'].update(planar=10**6),
    'rest': lambda s: s['rest'].update(radius_m=0.01),
    'no rest': lambda s: s.update(rest=None),
    'rest is not a number': lambda s: s['rest'].update(rate=float('nan')),
    'rest is infinite': lambda s: s['rest'].update(speed_m_s=float('inf')),
    'list': lambda s: [s],
    'claims are a list': lambda s: s.update(claims=list(s['claims'].values())),
    'a claim is a list': lambda s: s['claims'].update(mean_error_norm_m=[1.0]),
    'ranges are nothing': lambda s: s.update(ranges=None),
    'start is a text': lambda s: s['claims']['mean_error_norm_m'].update(start='here'),
}


@pytest.mark.parametrize('lie', LIES)
def test_a_summary_says_what_follows(copy_of, lie):
    path = copy_of('together')
    edit(path / 'summary.yaml', LIES[lie])
    assert faults(path)


FLOWN = ('flown', 'start', 'no start')


@pytest.mark.parametrize('lie', [*FLOWN, 'bound', 'unit', 'another claim', 'range', 'list'])
def test_a_report_says_what_follows_from_the_cells_and_flies_again(copy_of, lie):
    path = copy_of('together')
    edit(path / 'summary.yaml', LIES[lie])
    with pytest.raises(InputError, match='its flight reaches' if lie in FLOWN else None):
        report_of(path)


@pytest.mark.parametrize('name', ['summary.yaml', 'controller.yaml', 'scenario.yaml', 'proof.yaml'])
def test_a_key_that_is_given_twice_is_refused(copy_of, name):
    path = copy_of('together')
    lines = (path / name).read_text().splitlines()
    (path / name).write_text('\n'.join([lines[0], *lines]))
    assert 'is given twice' in faults(path)[0]


def test_cells_that_lie_on_each_other_are_found(copy_of):
    """The cheap half of the cells a hundred times: the mean energy would be another."""
    path = copy_of('together')

    def repeated(arrays):
        order = [0, 1, *100 * [int(arrays['values'][:, VALUES.index('energy_high_n2s')].argmin())]]
        for name in ('centre', 'half', 'values', 'boxes'):
            arrays[name] = arrays[name][order]

    edit_arrays(path / 'planar.npz', repeated)
    assert 'some of it twice' in faults(path)[0]


def test_norms_need_a_tube(copy_of):
    """A vertical cell that nothing is known of, beside norms of the others."""
    path = copy_of('together')

    def unknown(arrays):
        arrays['values'][0, 1], arrays['values'][0, 2:] = 0.0, np.inf

    edit_arrays(path / 'vertical.npz', unknown)
    assert any('norms are bounded without a tube' in fault for fault in faults(path))


ARRAYS = {
    'nan': lambda a: a['values'].__setitem__((0, 5), np.nan),
    'infinite half': lambda a: a['half'].__setitem__((0, 0), np.inf),
    'negative bound': lambda a: a['values'].__setitem__((0, 5), -1.0),
    'negative half': lambda a: a.update(half=-a['half']),
    'float32': lambda a: a.update(values=a['values'].astype(np.float32)),
    'big endian': lambda a: a.update(values=a['values'].astype('>f8')),
    'complex': lambda a: a.update(values=a['values'].astype(complex)),
    'object': lambda a: a.update(values=a['values'].astype(object)),
    'no rows': lambda a: a.update({k: a[k][:0] for k in ('centre', 'half', 'values', 'boxes')}),
    'fewer boxes': lambda a: a.update(boxes=a['boxes'][:1]),
    'scalar': lambda a: a.update(tail=np.array(1.0)),
    'one reach for all ticks': lambda a: a.update(reach=np.zeros((2, 1, a['reach'].shape[2]))),
    'more': lambda a: a.update(more=np.zeros(3)),
    'missing': lambda a: a.pop('tail'),
    'half a cell': lambda a: a['values'].__setitem__((0, 0), 0.5),
    'a time without end': lambda a: a['values'].__setitem__((0, 1), np.inf),
}


@pytest.mark.parametrize('lie', ARRAYS)
@pytest.mark.parametrize('kind', rest_at_landing(KINDS))
def test_arrays_are_read_strictly(copy_of, kind, lie):
    path = copy_of(kind)
    name = 'planar.npz' if kind == 'together' else 'x.npz'
    edit_arrays(path / name, ARRAYS[lie])
    (sentence,) = faults(path)
    assert name in sentence and '\n' not in sentence


MUCH = 2**23  # numbers: 64 MiB, which deflate to a thousandth
LONG_HEADER = b'\x93NUMPY\x02\x00' + (2**26).to_bytes(4, 'little') + b' ' * 2**26


@pytest.mark.parametrize(
    ('lie', 'said'),
    [
        ('rows', 'must hold arrays of at most 16777216 bytes'),
        ('shape', '`boxes` must be float64 of shape'),
        ('another', 'must hold the arrays centre'),
        ('object', 'is damaged: an array has'),
        ('header', 'is damaged: an array is not in version 1.0'),
        ('size', 'is damaged: an array has'),
    ],
)
def test_what_would_take_much_memory_is_refused_by_its_headers(copy_of, lie, said):
    """Three megabytes took three gigabytes before they were refused."""
    folder = Folder.open(copy_of('together'))
    path = folder.path / 'planar.npz'
    with np.load(path) as saved:
        arrays = {name: saved[name] for name in saved.files}
    if lie == 'rows':
        rows = MUCH // arrays['boxes'][0].size
        for name in ('centre', 'half', 'values', 'boxes'):
            arrays[name] = np.zeros((rows, *arrays[name].shape[1:]))
    elif lie in ('shape', 'another'):
        arrays['boxes' if lie == 'shape' else 'more'] = np.zeros(MUCH)
    elif lie == 'object':
        arrays['boxes'] = np.zeros(2, dtype=object)
    else:
        del arrays['boxes']
    np.savez_compressed(path, **arrays)
    if 'boxes' not in arrays:
        content = LONG_HEADER
        if lie == 'size':  # the header says more than there is
            whole = io.BytesIO()
            np.save(whole, np.zeros(1000))
            content = whole.getvalue().replace(b'(1000,)', b'(9999,)')
        with zipfile.ZipFile(path, 'a', zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            archive.writestr('boxes.npy', content)
    assert path.stat().st_size < 2**20
    tracemalloc.start()
    try:
        with pytest.raises(InputError) as refused:
            folder.cells('planar')
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert said in str(refused.value) and peak < 2**22


def test_a_link_is_refused(copy_of, tmp_path):
    """What it points to can be exchanged after the check."""
    path = copy_of('together')
    (path / 'planar.npz').rename(tmp_path / 'elsewhere.npz')
    (path / 'planar.npz').symlink_to(tmp_path / 'elsewhere.npz')
    assert 'is a symbolic link' in faults(path)[0]


def test_a_counterexample_is_one_of_the_flights(copy_of):
    """From outside the box, or under what is not asked for, a flight refutes nothing."""
    path = copy_of('together')
    (file,) = path.glob('counterexample_*.yaml')
    edit(file, lambda document: document.update(initial_position_m=[5.0, 0.0, 0.0]))
    assert 'starts outside the box' in faults(path)[0]
    file.unlink()
    assert faults(path) == []  # nothing is unknown: the flight follows from its start


def test_a_refuted_claim_has_its_flight_in_the_folder(proofs, monkeypatch):
    """Where it does not follow from its start."""
    monkeypatch.setattr(checker, '_flight', lambda *_: None)
    fault, *_ = faults(proofs['together'].path)
    assert fault.endswith('is refuted, and its flight is not in the folder')


def test_a_flight_of_a_claim_is_under_what_is_asked_for(proofs):
    problem = proofs['apart'].problem
    rng, base = np.random.default_rng(1), problem.scenario
    found = flights.vary(problem, rng, np.array(base.start))
    assert why_outside(problem, found) == ''
    harmonic = found.disturbance.harmonics[0]
    stronger = replace(found.disturbance, harmonics=(replace(harmonic, amplitude_n=0.005),))
    faster = replace(found.disturbance, harmonics=(replace(harmonic, angular_rate_rad_s=0.1),))
    required = replace(base.requirements, mean_window_s=20.0)
    for wrong, sentence in (
        (replace(found, mass_kg=found.mass_kg * 1.01), 'of another mass'),
        (replace(found, disturbance=stronger), 'under another disturbance'),
        (replace(found, disturbance=faster), 'under another disturbance'),
        (replace(found, requirements=required), 'of another scenario'),
        (replace(found, duration_s=2.0 * found.duration_s), 'of another scenario'),
        (replace(found, initial_velocity_m_s=(0.0, 0.0, 0.1)), 'outside the box'),
    ):
        assert sentence in why_outside(problem, wrong)


@pytest.mark.parametrize(
    ('name', 'key', 'least'),
    [('speed', 'hold_speed_per_axis_m_s', 0.009025), ('slew', 'slew_per_axis_n_s', 0.0971)],
)
def test_the_worst_flights_of_the_page(name, key, least):
    """They are flights of the box that the page is about, and reach what it says."""
    base, controller = load_scenario('paper_test'), load_controller('allround')
    half = (5.0, 5.0, 5.0, 0.06, 0.06, 0.06)
    settings = Settings(
        centre=base.start, half=half, mass_share=0.09, disturbance_share=1.0, axes_apart=True
    )
    problem = Problem.of(controller, base, settings)
    found = load_scenario(f'offline_training/proofs/paper_box_{name}.yaml')
    assert why_outside(problem, replace(found, name=base.name, description=base.description)) == ''
    assert least <= values_of(problem, fly(found, controller))[key] < problem.limits[key]


def test_what_was_flown_is_flown_again(copy_of):
    """Another flight than the one of the figure."""
    path = copy_of('apart')
    file = path / 'flown_mean_error_norm_m.yaml'
    edit(file, lambda document: document.update(initial_position_m=[0.5, 0.5, -0.5]))
    assert 'its flight reaches' in faults(path)[0]
    file.unlink()  # of an older version: the figure is not printed
    found = check(Folder.open(path), SAMPLE)
    claims = {claim.key: claim for claim in found.claims}
    assert found.faults == [] and claims['mean_error_norm_m'].start == ()


def test_what_is_held_for_ever_is_held_in_the_set_of_rest(proofs):
    """A flight that is in the set may go to its end, however small the tubes were before."""
    (claim,) = [
        c for c in check(proofs['together'], SAMPLE).claims if c.statement.endswith(', for ever')
    ]
    assert claim.bound >= proofs['together'].summary()['rest']['radius_m']


def test_axes_apart_hold_flights_of_any_signs(tmp_path):
    """A box about the target: x and y may have other signs, so half of the box is not enough."""
    base = replace(load_scenario('paper_test'), duration_s=20.0, requirements=None)
    half = (0.4, 0.4, 0.4, 0.02, 0.02, 0.02)
    settings = Settings(centre=(0.0,) * 6, half=half, axes_apart=True, coarseness=4.0)
    problem = Problem.of(load_controller('allround'), base, settings)
    folder = Folder.create(tmp_path / 'proof', problem)
    proving.prove(folder, 1, lambda *_: None, probes=8)
    for group, chosen in problem.groups.items():
        low, high = folder.cells(group).reach
        for start in flights.random_starts(problem, 8, 1):
            flight = fly(flights.vary(problem, np.random.default_rng(1), start), problem.controller)
            states = flight.states[:, list(chosen)]
            assert ((low <= states) & (states <= high)).all()


@pytest.fixture
def _few(monkeypatch):
    """Few looks in rational numbers, which take long."""
    monkeypatch.setattr(checker, 'Sample', partial(checker.Sample, ticks=1, surface=1))


def said(path, *options):
    words = ['prove', '--check', str(path), '--flights', '0', *options]
    run = invoke(*words)
    return run.exit_code, run.output


@pytest.mark.every_landing
@pytest.mark.usefixtures('_few')
def test_the_command_says_what_it_checked(copy_of):
    path = copy_of('together')
    (path / 'notes.txt').write_text('certified')
    code, text = said(path, '--cells', '1')
    assert code == 1  # a claim is refuted
    assert 'if the cells that were not drawn are right' in text
    assert 'Not checked: the tubes of 1 planar cells' in text
    assert 'Not checked: notes.txt' in text
    assert 'controller: `robust`, which does not ship' in text
    assert 'scenario: `small_together`, which does not ship' in text
    code, text = said(path, '--cells', '0', '--seed', '5', '--no-fail')
    assert code == 0 and 'not drawn' not in text and '--seed 5' in text


def test_what_is_wrong_has_no_headline(copy_of):
    path = copy_of('together')
    edit(path / 'summary.yaml', LIES['bound'])
    code, text = said(path, '--cells', '1', '--no-fail')
    assert code == 1 and 'WRONG: summary.yaml: `claims.mean_error_norm_m.bound` is 0.1' in text
    assert 'proven' not in text and 'Nothing wrong' not in text


@pytest.mark.slow
@pytest.mark.usefixtures('_few')
def test_another_controller_under_a_shipped_name_is_named(copy_of):
    """The proof is true of it: but it is not the one that ships."""
    path = copy_of('together')
    edit(path / 'controller.yaml', lambda document: document.update(name='allround'))
    edit(path / 'scenario.yaml', lambda document: document.update(name='paper_test'))
    for file in (*path.glob('flown_*'), *path.glob('counterexample_*')):
        edit(file, lambda document: document.update(name='paper_test'))
    stamp(path)
    code, text = said(path, '--cells', '1', '--no-fail')
    assert code == 0
    assert 'controller: named allround, and NOT the one that ships with this name' in text
    assert 'scenario: named paper_test, and NOT the one that ships with this name' in text
    other = replace(load_controller('handmade'), name='allround')
    (path / 'controller.yaml').write_text(dumps(other))
    stamp(path)
    assert faults(path)


def test_units_of_an_earlier_call_are_not_checked(proofs, tmp_path):
    """Who goes on with a folder is told what of it was there."""
    folder = Folder.create(tmp_path / 'proof', proofs['together'].problem)
    write_arrays(
        folder.path / 'parts' / 'planar_0000.npz', vars(proofs['together'].cells('planar'))
    )
    outcome = proving.prove(Folder.open(folder.path), 1, lambda *_: None, probes=20)
    assert outcome.resumed == {'vertical': (0, 1), 'planar': (1, 1)}


def test_a_damaged_unit_is_made_again(proofs, tmp_path):
    folder = Folder.create(tmp_path / 'proof', proofs['together'].problem)
    part = folder.path / 'parts' / 'planar_0000.npz'
    forged = dict(vars(proofs['together'].cells('planar')))
    forged['values'] = forged['values'] * np.nan
    write_arrays(part, forged)
    with pytest.raises(InputError):
        cells_of(part, folder.problem, 'planar')
    assert folder.done('planar', 0) is None
