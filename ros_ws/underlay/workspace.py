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
from layers import digest, say, write_record

METADATA = ('package.xml', 'setup.py', 'setup.cfg')


def package_digest(package: Path) -> str:
    """Return a hash of the inputs of the build of `package`."""
    files = []
    for path in package.rglob('*'):
        name = str(path.relative_to(package))
        made = any(part[0] == '.' or part[-9:] == '.egg-info' for part in Path(name).parts)
        if path.is_file() and path.suffix != '.pyc' and not made:
            files.append(name)
    contents = [(package / x).read_bytes() for x in METADATA if (package / x).is_file()]
    return digest('\n'.join(sorted(files)).encode(), *contents)


class Workspace:
    """The folders of a colcon workspace and the record of what is built.

    While a build runs, and after one that was interrupted or has failed, there is no record.
    """

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
        return [x.name for x in self.packages() if record.get(x.name) != self._state(x)]

    def _state(self, package: Path) -> List[Any]:
        """Return the hash of a package, and what of it is built: its marks and executables."""
        install = self.path / 'install' / package.name
        marks = [
            install / 'share' / package.name / 'package.xml',
            self.path / 'build' / package.name,
        ]
        executables = sorted((install / 'lib' / package.name).glob('*'))
        built = [str(x.relative_to(self.path)) for x in [*marks, *executables] if x.exists()]
        return [package_digest(package), built]

    def wipe(self) -> None:
        """Remove everything built."""
        for name in ('build', 'install', 'log'):
            shutil.rmtree(str(self.path / name), ignore_errors=True)

    def build(self, python: Path, environ: Mapping[str, str], names: Sequence[str]) -> None:
        """Build the packages `names`; without a record, or at a second try, all from the start."""
        record = self._record()
        if record:
            say(f'building {", ".join(names)}')
            self._record_file.unlink()
        if not record or not self._colcon(python, environ, names):
            say('building all packages from the start')
            self.wipe()
            names = [x.name for x in self.packages()]
            if not self._colcon(python, environ, names):
                raise SetupError(
                    'The colcon build of ros_ws failed (its messages are above, and in '
                    'ros_ws/log/latest_build/): correct that package, then run the same command '
                    'again.'
                )
        done = {x.name: self._state(x) for x in self.packages() if x.name in names}
        write_record(self._record_file, {**record, **done})

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
