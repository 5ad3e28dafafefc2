# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Exports say the same as the kernel: read by others, compiled, run without us, read back."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import fuzzylite
import numpy as np
import pytest
from core_strategies import functions, systems
from hypothesis import given, settings
from hypothesis import strategies as st
from invoking import invoke, refused

from rpo.exports import FORMATS, formats, text_of
from rpo_core.control.controller import FuzzyController, load_controller, parse
from rpo_core.control.fuzzy import FuzzySystem
from rpo_core.files.validation import InputError

CONTROLLERS = ['allround', 'paper_ga']
GRID = np.linspace(-1.0, 1.0, 101)


@pytest.fixture(params=CONTROLLERS)
def controller(request):
    return load_controller(request.param)


def surface_of(system):
    """Return the kernel's outputs (101, 101), a row for each velocity error."""
    return np.array([[system.output(e, v) for e in GRID] for v in GRID])


def test_json_holds_the_file_and_pyfuzzylite_agrees_with_fll_on_the_grid(controller):
    document = json.loads(text_of(controller, 'json'))
    assert parse(document['controller']) == controller
    assert document['triangles']['force']['Z'][1] == 0.0 and len(document['rules']) == 25
    engine = fuzzylite.FllImporter().from_string(text_of(controller, 'fll'))
    e, v = np.meshgrid(GRID, GRID)
    engine.input_variable('position_error').value = e.ravel()
    engine.input_variable('velocity_error').value = v.ravel()
    engine.process()
    theirs = np.asarray(engine.output_variable('force').value).reshape(e.shape)
    assert np.abs(theirs - surface_of(controller.system)).max() < 1e-13


@settings(max_examples=15)
@given(
    systems(parts=functions, samples=st.sampled_from([3, 101, 201])),
    st.lists(st.floats(1e-3, 1e3), min_size=3, max_size=3),
    st.sampled_from(['fis', 'fll']),
    st.text(max_size=30).filter(str.isprintable),
)
def test_any_controller_is_read_back_bit_for_bit(tmp_path_factory, system, scales, suffix, note):
    built = FuzzyController('mine', system, *scales, description=note)
    path = tmp_path_factory.mktemp('back') / f'mine.{suffix}'
    path.write_text(text_of(built, suffix), encoding='utf-8')
    assert formats.load(path) == built


@pytest.mark.parametrize('name', FORMATS)
def test_the_command_writes_the_text(name, tmp_path):
    path = tmp_path / 'new' / f'mine.{name}'
    done = invoke('export', 'handmade', '--to', name, '--output', path)
    beside = ['mine.h', 'mine_test.c', 'mine_test.txt'] if name == 'c' else []
    written = [str(path), *(str(path.with_name(each)) for each in beside)]
    assert (done.exit_code, done.stdout.split()) == (0, written)
    controller = replace(load_controller('handmade'), name='mine' if beside else 'handmade')
    text = path.read_text().replace('/* handmade: ', '/* mine: ')
    assert text == text_of(controller, name)
    printed = invoke('export', 'handmade', '--to', name, '-o', '-').stdout
    assert printed == text_of(load_controller('handmade'), name)


@pytest.mark.skipif(shutil.which('cc') is None, reason='cc is not installed')
def test_the_stages_of_a_run_are_c_that_is_compiled_as_the_header_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    changes = ('--set', 'duration_s=20')
    invoke('simulate', 'paper_test_measured', *changes, '-o', 'run')
    assert invoke('export', 'run', '--to', 'c', '-o', 'flight.c').exit_code == 0
    command, program = re.findall(
        r'^   (?:Test: )? +(cc .*_test .*|\./.*)$', Path('flight.h').read_text(), re.M
    )
    subprocess.run(command.split(), check=True, timeout=60)
    done = subprocess.run(program.split(), capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, '201 ticks: every bit is equal\n')
    invoke('export', 'paper_test_measured', '--to', 'c', *changes, '-o', 'again.c')
    assert Path('again_test.txt').read_text() == Path('flight_test.txt').read_text()


FIS = text_of(load_controller('handmade'), 'fis')
PLAIN = re.sub('%.*', '', FIS)
FLL = text_of(load_controller('handmade'), 'fll')


def test_a_file_in_units_brings_its_scales(tmp_path):
    """As a MATLAB user would write it: other words, ranges in units, feet within them."""
    scales, blocks = (60.0, 0.8, 0.25), re.split(r'^(?=\[)', PLAIN, flags=re.M)
    for i, (scale, block) in enumerate(zip(scales, blocks[2:5], strict=True), 2):
        block = block.replace('[-2.0', '[-1.0').replace('2.0]', '1.0]').replace("'L", "'far ")
        numbers = re.compile(r'(?<=[\[ ])-?\d+\.?\d*(?=[ \]])')
        blocks[i] = numbers.sub(lambda x, scale=scale: repr(float(x[0]) * scale), block)
    path = tmp_path / 'plant.fis'
    path.write_text(''.join(blocks))
    read, system = formats.load(path), load_controller('handmade').system
    assert read.scales == scales
    for e, v in np.random.default_rng(2).uniform(-1, 1, (50, 2)):
        assert read.system.output(e, v) == pytest.approx(system.output(e, v), abs=1e-12)


@pytest.mark.parametrize(
    ('suffix', 'text', 'message'),
    [
        ('fis', PLAIN, 'does not say `position_scale_m`: give --position-scale'),
        ('fis', '', 'must have System, Input1, Input2, Output1, Rules; it has none'),
        ('fis', 'hello', "not a line of such a file: 'hello'"),
        ('fis', FIS.replace('[Input2]', '[Input3]'), 'it has System, Input1, Input3, Output1'),
        ('fis', FIS.replace("'trimf'", "'gaussmf'", 1), 'term `LN` must be a triangle of 3 points'),
        ('fis', FIS.replace('-0.75 -0.2', '-0.75 -0.3'), 'term `SN` must mirror its opposite'),
        ('fis', FIS.replace('3 3, 3 (1) : 1', '3 4, 3 (1) : 1'), 'position Z) has two'),
        ('fis', FIS.replace('3 3, 3 (1)', f'3 {"9" * 5000}, 3 (1)'), 'words 1 to 5, weight 1'),
        ('fis', FIS.replace('[-2.0 -1.0', '[-0.5 -1.0', 1), 'right foot; got trimf [-0.5'),
        ('fis', FIS + '[Rules]', 'Output1, Rules, Rules'),
        ('fis', FIS + '[Extra]', 'Output1, Rules, Extra'),
        ('fis', FIS.replace('samples = 101', 'samples = 100'), '`samples` must be odd'),
        ('fll', FLL.replace('InputVariable', 'OutputVariable', 1), 'it has Engine, OutputVariable'),
        ('fll', FLL.replace('SN Triangle', 'LN Triangle', 1), 'the terms of `position_error`'),
        ('fll', FLL.replace('range: -1.0 1.0', 'range: -1.0', 1), 'must be two numbers'),
        ('xml', FIS, '`file name suffix` must be one of .fis, .fll'),
    ],
)  # fmt: skip
def test_files_of_another_shape_are_refused(suffix, text, message, tmp_path):
    path = tmp_path / f'other.{suffix}'
    path.write_text(text)
    sentence = refused('import', path, '-o', tmp_path / 'mine.yaml')
    assert sentence.startswith(f'rpo: {path}: ') and message in sentence
    assert not (tmp_path / 'mine.yaml').exists()


def test_scales_that_are_given_count_more_than_those_of_the_file(tmp_path):
    path = tmp_path / 'mine.fis'
    path.write_text(FIS)
    scales = ('--position-scale', 50, '--velocity-scale', 0.7, '--force-scale', 0.4)
    assert invoke('import', path, '-o', tmp_path / 'mine.yaml', *scales).exit_code == 0
    assert load_controller(tmp_path / 'mine.yaml').scales == (50.0, 0.7, 0.4)


@settings(max_examples=40)
@given(st.data(), st.sampled_from([(formats.read_fis, FIS), (formats.read_fll, FLL)]))
def test_spoilt_texts_are_read_or_refused(data, case):
    """Anything but an InputError would be a traceback for the user."""
    reader, text = case
    lines = text.splitlines()
    for _ in range(data.draw(st.integers(1, 3))):
        i = data.draw(st.integers(0, len(lines) - 1))
        change = data.draw(st.sampled_from(['cut', 'drop', 'twice', 'replace', 'character']))
        line = lines[i]
        at = data.draw(st.integers(0, max(len(line) - 1, 0)))
        lines[i : i + 1] = {
            'cut': [line[:at]],
            'drop': [],
            'twice': [line, line],
            'replace': [data.draw(st.text(max_size=12))],
            'character': [line[:at] + data.draw(st.characters()) + line[at + 1 :]],
        }[change]
        lines = lines or ['']
    try:
        built = formats.controller_of(reader('\n'.join(lines)), 'spoilt', (1.0, 1.0, 1.0))
    except InputError as error:
        assert str(error)
    else:
        assert isinstance(built.system, FuzzySystem)
