"""Facts about the installed package: where ROS 2 finds it, what it declares, what its modules import."""

import ast
import importlib
import os
import re
import subprocess
import sys
from importlib import metadata, util
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from delta3_pacdrive.kernel import WITHOUT_KERNELS

PACKAGE = 'delta3_pacdrive'
SOURCE = Path(__file__).parents[1]
MARKER = f'share/ament_index/resource_index/packages/{PACKAGE}'
EXECUTABLES = ['delta3', 'unit_robot', 'transformation_task', 'mc4_drive', 'plant', 'bringup', 'record']
MODULES = [path.relative_to(SOURCE) for path in sorted((SOURCE / PACKAGE).rglob('*.py'))]
CORE_MODULES = [
    '.'.join(path.with_suffix('').parts).removesuffix('.__init__')
    for path in MODULES
    if path.parts[1] not in ('nodes', 'cli')
]
CONFIGURATION = [path.relative_to(SOURCE) for path in sorted((SOURCE / 'config').rglob('*.*'))]
ROSDEP_KEYS = {'PyYAML': 'python3-yaml'}  # the other keys are python3- and the distribution's name
OPTIONAL = {'toppra', 'mujoco'}  # of the extra "test": benchmarks compare with them where they are installed
WITHOUT_ROSDEP_KEY = {'rosbags', 'ruckig'}  # named in a comment of package.xml
DISTRIBUTIONS = {'yaml': 'PyYAML', 'mpl_toolkits': 'matplotlib'}  # the others bear the name that is imported


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
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def modules_after_import(name, folder):
    """Return the top-level names that a fresh interpreter has loaded after the import of ``name``."""
    program = f'import sys, {name}; print(*sys.modules)'
    loaded = output_of([sys.executable, '-P', '-c', program], folder).split()
    return {module.partition('.')[0] for module in loaded}


def is_ros(name):
    return name.endswith('_msgs') or name in {'rclpy', 'rcl_interfaces', 'std_srvs', 'builtin_interfaces'}


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


def test_the_readme_gives_the_reason_for_every_dependency(requirements):
    lines = (SOURCE / 'README.md').read_text(encoding='utf-8').splitlines()
    for name in requirements:
        item = re.compile(rf'\s*[-*|]\s*[\[`*]*{re.escape(name)}\b\W*\w+(\W+\w+)+', re.IGNORECASE)
        assert any(item.match(line) for line in lines), f'README.md has no list item or table row on {name}'


def test_package_xml_declares_every_dependency(requirements):
    declared = {depend.text for depend in package_xml().iter('exec_depend')}
    text = (SOURCE / 'package.xml').read_text(encoding='utf-8')
    comments = ' '.join(re.findall('<!--.*?-->', text, re.DOTALL))
    for name in requirements:
        if name in WITHOUT_ROSDEP_KEY:
            assert name in comments
        else:
            assert ROSDEP_KEYS.get(name, f'python3-{name}') in declared


@pytest.mark.parametrize('path', MODULES, ids=str)
def test_every_import_is_of_a_declared_dependency(path, requirements):
    declared = {depend.text for depend in package_xml().iter('exec_depend')} | set(requirements) | OPTIONAL
    imported = set()
    for node in ast.walk(ast.parse((SOURCE / path).read_bytes())):
        if isinstance(node, ast.Import):
            imported.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            imported.add(node.module)
    names = {name.partition('.')[0] for name in imported} - sys.stdlib_module_names - {PACKAGE}
    assert {DISTRIBUTIONS.get(name, name) for name in names} <= declared


@pytest.mark.parametrize('name', CORE_MODULES)
def test_a_core_module_is_free_of_ros(name, distribution, tmp_path):
    assert not [loaded for loaded in modules_after_import(name, tmp_path) if is_ros(loaded)]


def test_the_command_line_starts_without_heavy_modules(distribution, tmp_path):
    loaded = modules_after_import(f'{PACKAGE}.cli.main', tmp_path)
    assert not loaded & {'numpy', 'numba', 'rclpy', 'matplotlib'}


@pytest.mark.parametrize('path', MODULES, ids=str)
def test_no_kernel_depends_on_what_the_cache_of_kernels_does_not_look_at(path):
    """An edit of a study or of a command must not cost a compilation; one of a formula must."""
    text = (SOURCE / path).read_text(encoding='utf-8')
    studies = [f'{PACKAGE}.{folder}' for folder in WITHOUT_KERNELS]
    inside = bool(WITHOUT_KERNELS.intersection(path.parts))
    assert '@kernel' not in text if inside else '@kernel' not in text or not any(s in text for s in studies)
