"""Installation steps that pyproject.toml cannot express: the layout that ROS 2 requires below the prefix.

The prefix is a virtual environment (pip) or the install folder of colcon. The marker goes into the ament index,
package.xml, config/ and launch/ into share/, the executables into lib/delta3_pacdrive/, where ``ros2 run`` finds them.
"""

import atexit
import shutil
import tempfile
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.dist_info import dist_info
from setuptools.command.editable_wheel import editable_wheel

try:
    from setuptools.command.bdist_wheel import bdist_wheel
except ImportError:  # setuptools before 70.1
    try:
        from wheel.bdist_wheel import bdist_wheel
    except ImportError:  # colcon builds no wheel
        bdist_wheel = None

PACKAGE = 'delta3_pacdrive'
COMMAND_LINE = {'delta3': f'{PACKAGE}.cli.main:main'}
EXECUTABLES = {
    'unit_robot': f'{PACKAGE}.ros.nodes.start:unit_robot',
    'transformation_task': f'{PACKAGE}.ros.nodes.start:transformation_task',
    'mc4_drive': f'{PACKAGE}.ros.nodes.start:mc4_drive',
    'plant': f'{PACKAGE}.ros.nodes.start:plant',
    'robot_visualization': f'{PACKAGE}.ros.nodes.start:robot_visualization',
    'bringup': f'{PACKAGE}.cli.main:bringup',
    'record': f'{PACKAGE}.cli.main:record',
}
# A wheel installs scripts into bin/ only, where names such as "plant" are too common. These launchers (shell first,
# then Python) go to lib/delta3_pacdrive/ and start the interpreter of their environment.
LAUNCHER = """\
#!/bin/sh
''':'
file=$(readlink -f -- "$0")
bin=${{file%/lib/*}}/bin
for python in "$bin/python3" "$bin/python"; do
    [ -x "$python" ] && exec "$python" "$0" "$@"
done
exec python3 "$0" "$@"
'''
import sys

from {module} import {function}

sys.exit({function}())
"""


def console_scripts(scripts: dict[str, str]) -> dict[str, list[str]]:
    """Return the entry points of scripts."""
    return {'console_scripts': [f'{name} = {target}' for name, target in scripts.items()]}


def launchers(folder: Path) -> list[str]:
    """Write one launcher per executable into ``folder``; return their paths."""
    paths = []
    for name, target in (COMMAND_LINE | EXECUTABLES).items():
        module, _, function = target.partition(':')
        path = folder / name
        path.write_text(LAUNCHER.format(module=module, function=function), encoding='utf-8')
        path.chmod(0o755)
        paths.append(str(path))
    return paths


def for_wheel(command: type, *, with_launchers: bool = False) -> type:
    """Return a command of pip that installs only ``delta3`` into bin/."""

    class Command(command):
        def initialize_options(self) -> None:
            super().initialize_options()
            self.distribution.entry_points = console_scripts(COMMAND_LINE)
            if with_launchers:
                # outside the source tree: build/lib would keep modules that were deleted in the sources
                scratch = Path(tempfile.mkdtemp(prefix=f'{PACKAGE}-'))
                atexit.register(shutil.rmtree, scratch, ignore_errors=True)
                self.distribution.get_option_dict('build')['build_base'] = (
                    'setup.py',
                    str(scratch / 'build'),
                )
                self.distribution.get_option_dict('egg_info')['egg_base'] = ('setup.py', str(scratch))
                self.distribution.data_files.append((f'lib/{PACKAGE}', launchers(scratch)))

    return Command


commands = {'dist_info': for_wheel(dist_info), 'editable_wheel': for_wheel(editable_wheel)}
if bdist_wheel is not None:
    commands['bdist_wheel'] = for_wheel(bdist_wheel, with_launchers=True)

setup(
    packages=[*find_packages(include=[PACKAGE, f'{PACKAGE}.*']), f'{PACKAGE}.config'],
    package_dir={f'{PACKAGE}.config': 'config'},  # data only: importlib.resources.files(PACKAGE) / 'config'
    package_data={
        PACKAGE: ['py.typed'],
        f'{PACKAGE}.studies.report_page': ['assets/*'],
        f'{PACKAGE}.config': ['*.yaml', '*.xml', 'programs/*.yaml', 'layouts/*'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/launch', glob('launch/*.launch.py')),
        (f'share/{PACKAGE}/config', glob('config/*.yaml') + glob('config/*.xml')),
        (f'share/{PACKAGE}/config/programs', glob('config/programs/*.yaml')),
        (f'share/{PACKAGE}/config/layouts', glob('config/layouts/*')),
    ],
    python_requires='>=3.11',
    zip_safe=False,
    entry_points=console_scripts(COMMAND_LINE | EXECUTABLES),
    cmdclass=commands,
)
