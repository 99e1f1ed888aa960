"""Build recipe for pip and for colcon.

Both lay the package out as ROS 2 wants it below the prefix (a virtual environment, or colcon's install
folder): the marker in the ament index, package.xml and config/ in share/, the executables in
lib/delta3_pacdrive/.
"""

import atexit
import shutil
import sys
import tempfile
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

if sys.version_info < (3, 11):  # noqa: UP036 (pip would complain about the first dependency that lacks a wheel)
    sys.exit(f'delta3_pacdrive needs Python 3.11 or later, but this is Python {sys.version.split()[0]}')
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
# Lower bounds are tried: test/lower_bounds.txt
# Wheels of ROS exist for Linux on x86-64 only. Elsewhere everything else is installed, and a command for a robot says
# what is missing.
_WHEELS = '; platform_system == "Linux" and platform_machine == "x86_64"'
ROS = [
    f'ros-jazzy-rclpy>=7.1.6{_WHEELS}',
    f'ros-jazzy-common-interfaces>=5.3.6{_WHEELS}',
    f'ros-jazzy-rmw-fastrtps-cpp>=8.4.3{_WHEELS}',
]
TEST = [
    'toppra>=0.6.3',
    'casadi>=3.6.5',
    'h5py>=3.10',
    'hypothesis>=6.98.15',
    'import-linter>=2.16',
    'mujoco>=4.0',
    'mypy>=2.4',
    'pillow>=10.2',
    'playwright>=1.65',
    'pyarrow>=15.0',
    'pytest>=7.4.4',
    'pytest-timeout>=2.2',
    'pytest-xdist>=3.8',
    'ruff>=0.17.5',
    'types-PyYAML>=6.0.12',
    'yourdfpy>=0.0.60',
]
VIEW = ['viser>=1.1', 'trimesh>=4.0', 'msgspec>=0.18', 'websockets>=13.1']
PARQUET = ['pyarrow>=15.0']
MATLAB = ['h5py>=3.10']
SWEEP = ['dask>=2024.1', 'distributed>=2024.1', 'pyarrow>=15.0', 'SALib>=1.5']
OPTIMISE = [*SWEEP, 'optuna>=4.0']
DOCS = ['furo>=2024.1.29', 'latex2mathml>=3.77', 'myst-parser>=2.0', 'sphinx>=7.2']
# A wheel can install scripts in bin/ only, where names like "plant" are too common. There, these launchers
# (shell first, then Python) go to lib/delta3_pacdrive/ and start the interpreter of their own environment.
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


data_files = [
    ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
    (f'share/{PACKAGE}', ['package.xml']),
    (f'share/{PACKAGE}/config', glob('config/*.yaml') + glob('config/*.xml')),
    (f'share/{PACKAGE}/config/programs', glob('config/programs/*.yaml')),
    (f'share/{PACKAGE}/config/layouts', glob('config/layouts/*')),
]
scripts = COMMAND_LINE | EXECUTABLES
options = {}
if 'bdist_wheel' in sys.argv or 'dist_info' in sys.argv or sys.argv[1:] == ['egg_info']:
    # The steps of pip. They work outside the source tree: a file deleted there must not survive in build/lib.
    scratch = Path(tempfile.mkdtemp(prefix=f'{PACKAGE}-'))
    atexit.register(shutil.rmtree, scratch, ignore_errors=True)
    options = {'build': {'build_base': str(scratch / 'build')}, 'egg_info': {'egg_base': str(scratch)}}
    data_files.append((f'lib/{PACKAGE}', launchers(scratch)))
    scripts = COMMAND_LINE
if 'editable_wheel' in sys.argv:
    scripts = COMMAND_LINE

setup(
    name=PACKAGE,
    version='0.1.0',
    description='A Delta-3 robot on a PacDrive motion controller, emulated in software, for ROS 2',
    maintainer='delta3_pacdrive maintainers',
    maintainer_email='maintainers@delta3-pacdrive.invalid',  # reaches nobody: there is no public address yet
    license='Apache-2.0',
    python_requires='>=3.11',
    classifiers=[
        'Intended Audience :: Science/Research',
        'Operating System :: OS Independent',
        'Programming Language :: Python :: 3',
        'Programming Language :: Python :: 3.11',
        'Programming Language :: Python :: 3.12',
        'Programming Language :: Python :: 3.13',
        'Topic :: Scientific/Engineering',
    ],
    packages=[*find_packages(include=[PACKAGE, f'{PACKAGE}.*']), f'{PACKAGE}.config'],
    package_dir={f'{PACKAGE}.config': 'config'},  # data only: importlib.resources.files(PACKAGE) / 'config'
    package_data={
        PACKAGE: ['py.typed'],
        f'{PACKAGE}.analysis.report_page': ['assets/*'],
        f'{PACKAGE}.config': ['*.yaml', '*.xml', 'programs/*.yaml', 'layouts/*'],
    },
    data_files=data_files,
    zip_safe=False,
    install_requires=[
        'backports.zstd>=1.0; python_version < "3.14"',
        'matplotlib>=3.8',
        'numba>=0.59',
        'numpy>=1.26',
        'psutil>=5.9.6',
        'PyYAML>=6.0.1',
        'rich>=13.7',
        'rosbags>=0.11.6',
        'ruckig>=0.12.2',
        'scipy>=1.11.2',
    ],
    extras_require={
        'ros': ROS,
        'view': VIEW,
        'parquet': PARQUET,
        'matlab': MATLAB,
        'sweep': SWEEP,
        'optimise': OPTIMISE,
        'test': TEST,
        'docs': DOCS,
        'all': ROS + VIEW + PARQUET + MATLAB + OPTIMISE + TEST + DOCS,
    },
    entry_points={'console_scripts': [f'{name} = {target}' for name, target in scripts.items()]},
    options=options,
)
