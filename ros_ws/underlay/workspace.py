# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The colcon build of `ros_ws`.

The build links to the sources, so it is repeated only after a change of metadata, or for a new or
deleted file.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any, Dict, List, Mapping, Sequence

from host import SetupError
from layers import digest, say

METADATA = ('package.xml', 'setup.py', 'setup.cfg')


def package_digest(package: Path) -> str:
    """Return a hash of the inputs of the build of `package`."""
    files: List[str] = []
    for folder, folders, names in os.walk(str(package)):
        folders[:] = [
            x for x in folders if x[0] != '.' and x != '__pycache__' and x[-9:] != '.egg-info'
        ]
        names = [x for x in names if x[0] != '.' and x[-4:] != '.pyc']
        files += [os.path.relpath(os.path.join(folder, name), str(package)) for name in names]
    contents = [(package / x).read_bytes() for x in METADATA if (package / x).is_file()]
    return digest('\n'.join(sorted(files)).encode(), *contents)


class Workspace:
    """The folders of a colcon workspace and the record of what is built."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._record_file = path / 'install' / '.rpo_build.json'

    def packages(self) -> List[Path]:
        """Return the source packages."""
        return sorted(path.parent for path in self.path.glob('src/*/package.xml'))

    def _record(self) -> Dict[str, Any]:
        try:
            return dict(json.loads(self._record_file.read_text()))
        except (OSError, ValueError):
            return {}

    def outdated(self) -> List[str]:
        """Return the names of the packages that must be built."""
        record = self._record()
        return [
            package.name
            for package in self.packages()
            if record.get(package.name) != [package_digest(package), self._built(package.name)]
        ]

    def _built(self, name: str) -> List[str]:
        """Return the existing files of a built package: its marks and its executables."""
        install = self.path / 'install' / name
        marks = [install / 'share' / name / 'package.xml', self.path / 'build' / name]
        executables = sorted((install / 'lib' / name).glob('*'))
        return [str(x.relative_to(self.path)) for x in [*marks, *executables] if x.exists()]

    def wipe(self) -> None:
        """Remove everything built."""
        for name in ('build', 'install', 'log'):
            shutil.rmtree(str(self.path / name), ignore_errors=True)

    def build(self, python: Path, environ: Mapping[str, str], names: Sequence[str]) -> None:
        """Build the packages `names`; a second try builds all of them from the start."""
        say(f'building {", ".join(names)}')
        before, mark = self._record(), self.path / 'install' / '.rpo_building'
        for last in (False, True):
            if mark.exists():  # a build was interrupted, or has failed just now
                self.wipe()
                names, before = [x.name for x in self.packages()], {}
            mark.parent.mkdir(parents=True, exist_ok=True)
            mark.touch()
            if self._colcon(python, environ, names):
                break
            if last:
                raise SetupError(
                    'The colcon build of ros_ws failed (its messages are above, and in '
                    'ros_ws/log/latest_build/): correct that package, then run the same command '
                    'again.'
                )
            say('the build failed; building all packages from the start')
        done = {x.name: [package_digest(x), self._built(x.name)] for x in self.packages()}
        record = {**before, **{name: done[name] for name in names}}
        draft = self._record_file.with_suffix('.new')
        draft.write_text(json.dumps(record, indent=1) + '\n')
        os.replace(str(draft), str(self._record_file))
        mark.unlink()

    def _colcon(self, python: Path, environ: Mapping[str, str], names: Sequence[str]) -> bool:
        command = [str(python), '-m', 'colcon', 'build', '--symlink-install']
        command += ['--base-paths', 'src', '--packages-select', *names]
        command += ['--event-handlers', 'console_cohesion-']
        env = {
            **environ,
            'COLCON_DEFAULTS_FILE': os.devnull,
            'PYTHONWARNINGS': 'ignore',
            'PATH': f'{python.parent}:{environ["PATH"]}',
        }
        return subprocess.run(command, cwd=str(self.path), env=env).returncode == 0
