"""Tests of the installed package: discovery by ROS 2, declarations and imports of modules."""

import ast
import functools
import importlib
import os
import re
import subprocess
import sys
from importlib import metadata, util
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from cases import for_each
from delta3_pacdrive.numerics import kernel

PACKAGE = 'delta3_pacdrive'
SOURCE = Path(__file__).parents[1]
MARKER = f'share/ament_index/resource_index/packages/{PACKAGE}'
EXECUTABLES = [
    'delta3', 'unit_robot', 'transformation_task', 'mc4_drive', 'plant', 'robot_visualization', 'bringup', 'record'
]  # fmt: skip
MODULES = [path.relative_to(SOURCE) for path in sorted((SOURCE / PACKAGE).rglob('*.py'))]
CONFIGURATION = [path.relative_to(SOURCE) for path in sorted((SOURCE / 'config').rglob('*.*'))]
ROSDEP_KEYS = {
    'PyYAML': 'python3-yaml',
    'rosbags': 'python3-rosbags-pip',
    'backports.zstd': 'python3-backports-zstd-pip',
}  # the other keys are python3- and the distribution's name
# of the extra "test", where benchmarks compare with them, and of those for single commands
OPTIONAL = {
    'pyarrow',
    'h5py',
    'dask',
    'distributed',
    'optuna',
    'toppra',
    'mujoco',
    'viser',
    'trimesh',
    'websockets',
    'msgspec',
}
WITHOUT_ROSDEP_KEY = {'ruckig'}  # named in a comment of package.xml
DISTRIBUTIONS = {
    'yaml': 'PyYAML',
    'mpl_toolkits': 'matplotlib',
    'backports': 'backports.zstd',
}  # the others bear the name that is imported


@pytest.fixture(scope='module')
def distribution():
    try:
        return metadata.distribution(PACKAGE)
    except metadata.PackageNotFoundError:
        pytest.skip(f'{PACKAGE} is not installed in {sys.prefix}: pip install .')


@pytest.fixture(scope='module')
def prefix(distribution):
    """Return where ROS finds the package: a sourced install folder of colcon, else this environment."""
    candidates = [*os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep), sys.prefix]
    found = [Path(candidate) for candidate in candidates if Path(candidate, MARKER).is_file()]
    assert found, f'no {MARKER} in {candidates} (pip install -e leaves such files out: use pip install .)'
    return found[0]


@pytest.fixture(scope='module')
def requirements(distribution):
    """Return the names of the distributions that every installation needs."""
    lines = [line for line in distribution.requires or [] if 'extra ==' not in line]
    return [re.match(r'[\w.-]+', line)[0] for line in lines]


def package_xml():
    return ET.parse(SOURCE / 'package.xml').getroot()


def output_of(command, folder):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def modules_after_import(name, folder):
    """Return the top-level names that a fresh interpreter has loaded after the import of ``name``."""
    program = f'import sys, {name}; print(*sys.modules)'
    loaded = output_of([sys.executable, '-P', '-c', program], folder).split()
    return {module.partition('.')[0] for module in loaded}


def is_ros(name):
    return name.endswith(('_msgs', '_interfaces')) or name in {'rclpy', 'std_srvs'}


def test_the_ament_index_finds_the_package(prefix, monkeypatch):
    packages = pytest.importorskip('ament_index_python.packages', reason='the extra "ros" is not installed')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(prefix))
    assert Path(packages.get_package_prefix(PACKAGE)) == prefix
    assert Path(packages.get_package_share_directory(PACKAGE), 'package.xml').is_file()


def test_one_version_in_the_distribution_and_in_package_xml(distribution, prefix):
    installed = ET.parse(prefix / 'share' / PACKAGE / 'package.xml').getroot()
    assert installed.findtext('version') == distribution.version
    assert package_xml().findtext('version') == distribution.version


@pytest.mark.parametrize('name', EXECUTABLES)
def test_ros2_run_finds_the_executable(prefix, name):
    path = prefix / 'lib' / PACKAGE / name
    assert path.is_file()
    assert os.access(path, os.X_OK)


def test_an_executable_runs_in_the_environment_it_is_installed_in(prefix, tmp_path):
    link = tmp_path / 'link'
    link.symlink_to(prefix / 'lib' / PACKAGE / 'delta3')
    assert output_of([link, '--help'], tmp_path)


@pytest.mark.parametrize('name', sorted(set(EXECUTABLES) - {'delta3'}))
def test_no_common_name_lands_on_the_command_path(distribution, name):
    assert not Path(sys.prefix, 'bin', name).exists()


def test_the_installed_modules_are_those_of_the_source_tree(distribution):
    root = Path(util.find_spec(PACKAGE).origin).parents[1]
    assert {path.relative_to(root) for path in (root / PACKAGE).rglob('*.py')} == set(MODULES)
    changed = [path for path in MODULES if (root / path).read_bytes() != (SOURCE / path).read_bytes()]
    assert not changed, 'the sources have changed since the installation: pip install .'


def test_the_configuration_is_installed_for_python_and_for_ros(prefix):
    parameters = importlib.import_module(f'{PACKAGE}.parameters')
    for path in CONFIGURATION:
        content = (SOURCE / path).read_bytes()
        assert (parameters.config_directory().parent / path).read_bytes() == content
        assert (prefix / 'share' / PACKAGE / path).read_bytes() == content


def test_the_documentation_gives_the_reason_for_every_dependency(requirements):
    lines = (SOURCE / 'docs' / 'architecture.md').read_text(encoding='utf-8').splitlines()
    for name in requirements:
        item = re.compile(rf'\s*[-*|]\s*[\[`*]*{re.escape(name)}\b\W*\w+(\W+\w+)+', re.IGNORECASE)
        assert any(item.match(line) for line in lines), (
            f'docs/architecture.md has no list item or table row on {name}'
        )


def test_package_xml_declares_every_dependency(requirements):
    declared = {depend.text for depend in package_xml().iter('exec_depend')}
    text = (SOURCE / 'package.xml').read_text(encoding='utf-8')
    comments = ' '.join(re.findall('<!--.*?-->', text, re.DOTALL))
    for name in requirements:
        if name in WITHOUT_ROSDEP_KEY:
            assert name in comments
        else:
            assert ROSDEP_KEYS.get(name, f'python3-{name}') in declared


def test_tested_lower_bounds_are_the_declared_ones(distribution):
    tried = dict(
        re.findall(r'^([\w.-]+)==(\S+)', (SOURCE / 'test/lower_bounds.txt').read_text(), re.MULTILINE)
    )
    own_extras = [line for line in distribution.requires if line.startswith(PACKAGE)]
    asked = dict(
        re.match(r'([\w.-]+)>=([\d.]+)', line).groups()
        for line in set(distribution.requires) - set(own_extras)
    )
    assert tried.items() <= asked.items()
    unconditional = [re.match(r'[\w.-]+', line)[0] for line in distribution.requires if 'extra' not in line]
    assert set(unconditional) <= tried.keys()


def test_package_xml_names_the_ros_packages_that_are_used_and_no_other():
    named = {depend.text for depend in package_xml().iter('exec_depend') if 'python3-' not in depend.text}
    files = [*MODULES, *(SOURCE / 'launch').iterdir()]
    text = ''.join((SOURCE / path).read_text(encoding='utf-8') for path in files)
    names = r'rclpy|\w+_msgs|\w+_interfaces|std_srvs|launch\w*'
    used = set(re.findall(rf'^\s*(?:from|import) ({names})\b', text, re.MULTILINE))
    assert named == used | {'rmw_fastrtps_cpp'}


@for_each('path', MODULES)
def test_every_import_is_of_a_declared_dependency(path, requirements):
    declared = {depend.text for depend in package_xml().iter('exec_depend')} | set(requirements) | OPTIONAL
    imported = set()
    for node in ast.walk(ast.parse((SOURCE / path).read_bytes())):
        if isinstance(node, ast.Import):
            imported.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            imported.add(node.module)
    names = (
        {name.partition('.')[0] for name in imported} - sys.stdlib_module_names - {PACKAGE, 'compression'}
    )  # of Python 3.14
    assert {DISTRIBUTIONS.get(name, name) for name in names} <= declared


def imports_of(path):
    """Return all imports of a file, at any place in it: modules, and names that may be modules."""
    found = set()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f'{path}: the graph of imports knows absolute ones only'
            found.add(node.module)
            found.update(f'{node.module}.{alias.name}' for alias in node.names)
    # a package's own file is imported with each of its modules
    return found | {name.rpartition('.')[0] for name in found if '.' in name}


@functools.cache
def import_graph(root):
    """Return the imports of each module below a folder, by the names of the modules."""
    graph = {}
    for path in sorted((root / PACKAGE).rglob('*.py')):
        name = '.'.join(path.relative_to(root).with_suffix('').parts).removesuffix('.__init__')
        graph[name] = imports_of(path)
    return graph


def ways_to_ros(graph, start):
    """Return the way from a module to each ROS module that it imports, directly or not."""
    ways, open_ends, seen = [], [[start]], {start}
    while open_ends:
        way = open_ends.pop()
        for name in sorted(graph.get(way[-1], ())):
            if is_ros(name.partition('.')[0]):
                ways.append([*way, name])
            elif name in graph and name not in seen:
                seen.add(name)
                open_ends.append([*way, name])
    return ways


ROS_ROOMS = ('ros', 'bringup', 'verification', 'benchmarks', 'cli')
DOORS = (
    f'{PACKAGE}.scripting.connected_link',
)  # scripts reach a robot that is up through ``connect``, which loads ROS then


def is_core(name):
    return name.removeprefix(f'{PACKAGE}.').split('.')[0] not in ROS_ROOMS


def test_core_modules_are_free_of_ros():
    graph = dict(import_graph(SOURCE))
    for door in DOORS:
        assert any(not is_core(name) for name in graph[door])
        graph[door] = {name for name in graph[door] if is_core(name)}
    ways = [way for name in graph if is_core(name) for way in ways_to_ros(graph, name)]
    assert not ways, '; '.join(' > '.join(way) for way in ways)
    assert not [
        (name, other)
        for name in graph
        if is_core(name)
        for other in graph[name]
        if other in graph and not is_core(other)
    ]


def test_ros_modules_are_not_loaded_with_the_core(distribution, tmp_path):
    """The graph agrees with the loaded modules: one interpreter imports all of the core."""
    names = [name for name in import_graph(SOURCE) if is_core(name)]
    assert len(names) > 80
    assert not [name for name in modules_after_import(', '.join(names), tmp_path) if is_ros(name)]


@pytest.mark.parametrize(
    ('files', 'way'),
    [
        ({'core.py': 'import rclpy\n'}, ['core', 'rclpy']),
        ({'core.py': 'def f():\n    from std_msgs.msg import String\n'}, ['core', 'std_msgs']),
        ({'core.py': f'from {PACKAGE} import other\n', 'other.py': 'import rclpy.node\n'}, ['core', 'other', 'rclpy']),
        (
            {
                'core.py': f'from {PACKAGE}.inner.deep import value\n',
                'inner/__init__.py': 'import rclpy\n',
                'inner/deep.py': '',
            },
            ['core', 'inner', 'rclpy'],
        ),
    ],
)  # fmt: skip
def test_import_graph_finds_ros_through_lazy_and_indirect_imports(files, way, tmp_path):
    for name, text in files.items():
        path = tmp_path / PACKAGE / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    found = ways_to_ros(import_graph(tmp_path), f'{PACKAGE}.core')
    assert found
    names = [name.removeprefix(f'{PACKAGE}.') for name in found[0]]
    assert [*names[:-1], names[-1].partition('.')[0]] == way


def test_the_command_line_starts_without_heavy_modules(distribution, tmp_path):
    loaded = modules_after_import(f'{PACKAGE}.cli.main', tmp_path)
    assert not loaded & {'numpy', 'numba', 'rclpy', 'matplotlib'}


def test_the_help_of_no_command_loads_heavy_modules(distribution, tmp_path):
    program = (
        'import contextlib, sys\n'
        'from delta3_pacdrive.cli.main import COMMANDS, main\n'
        'for command in COMMANDS:\n'
        '    with contextlib.suppress(SystemExit): main([command, "--help"])\n'
        'print("loaded:", *sys.modules)'
    )
    output = output_of([sys.executable, '-P', '-c', program], tmp_path)
    loaded = output.rpartition('loaded:')[2].split()
    assert not {'numpy', 'numba', 'scipy', 'rclpy', 'matplotlib', 'yaml', 'rich'}.intersection(loaded)


def test_clients_do_not_load_the_compiler(distribution, tmp_path):
    pytest.importorskip('rclpy', reason='the extra "ros" is not installed')
    loaded = modules_after_import(f'{PACKAGE}.ros.clients.robot_client', tmp_path)
    assert 'rclpy' in loaded
    assert not loaded & {'numba', 'scipy', 'matplotlib'}


def test_a_node_loads_no_generator_of_messages(distribution, tmp_path):
    pytest.importorskip('rclpy', reason='the extra "ros" is not installed')
    program = (
        'import sys\n'
        'from delta3_pacdrive.ros.clients.robot_client import OperatorNode\n'
        'import rclpy\n'
        'rclpy.init()\n'
        'OperatorNode(lambda seconds: None)\n'
        'print("loaded:", *sys.modules)'
    )
    loaded = output_of([sys.executable, '-P', '-c', program], tmp_path).rpartition('loaded:')[2].split()
    assert 'rosidl_generator_py.import_type_support_impl' in loaded
    assert not {'lark', 'em', 'rosidl_parser.parser'}.intersection(loaded)


def test_packages_outside_the_kernel_cache_have_no_kernels_and_are_above_all_that_have():
    """An edit of a report must not cost a compilation."""
    assert kernel.kernels() > 150
    sources = kernel.kernel_sources()
    assert {'kinematics.py', 'errors.py', 'robot/drive/mc4.py', 'simulation/cycle.py'} <= sources.keys()
    left_out = [path for name in kernel.WITHOUT_KERNELS for path in (SOURCE / PACKAGE / name).rglob('*.py')]
    assert len(left_out) > 200
    assert not [path for path in left_out if '\n@kernel\n' in path.read_text(encoding='utf-8')]
    for module, names in import_graph(SOURCE).items():
        package = module.split('.')[1] if '.' in module else ''
        if package not in ('', 'renamed_modules', *kernel.WITHOUT_KERNELS):
            above = {name.split('.')[1] for name in names if '.' in name}
            assert not above.intersection(kernel.WITHOUT_KERNELS), module
