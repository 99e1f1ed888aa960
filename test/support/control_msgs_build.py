"""Builds ``control_msgs`` or ``tf2_msgs``, as far as the robot needs them: the package index has no wheels of them.

The generators of the ROS wheels write C from the fields below, a C++ compiler makes one Python extension of it, into a
folder for PYTHONPATH. Names and types of fields are those of Jazzy (control_msgs 5), so that bytes on the wire are
the same; constants are there as far as the robot uses them.

    python test/support/control_msgs_build.py FOLDER [PACKAGE]
"""

import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

PACKAGE = 'control_msgs'
CONTROL_FIELDS = {
    'msg/JointTolerance.msg': 'string name, float64 position, float64 velocity, float64 acceleration',
    'msg/JointComponentTolerance.msg': 'string joint_name, uint16 component, float64 position, float64 velocity, '
    'float64 acceleration',
    'action/FollowJointTrajectory.action': 'trajectory_msgs/JointTrajectory trajectory, '
    'trajectory_msgs/MultiDOFJointTrajectory multi_dof_trajectory, JointTolerance[] path_tolerance, '
    'JointComponentTolerance[] component_path_tolerance, JointTolerance[] goal_tolerance, '
    'JointComponentTolerance[] component_goal_tolerance, builtin_interfaces/Duration goal_time_tolerance, '
    '---, int32 error_code, int32 SUCCESSFUL = 0, int32 INVALID_GOAL = -1, int32 INVALID_JOINTS = -2, '
    'int32 OLD_HEADER_TIMESTAMP = -3, int32 PATH_TOLERANCE_VIOLATED = -4, int32 GOAL_TOLERANCE_VIOLATED = -5, '
    'string error_string, ---, std_msgs/Header header, string[] joint_names, '
    'trajectory_msgs/JointTrajectoryPoint desired, trajectory_msgs/JointTrajectoryPoint actual, '
    'trajectory_msgs/JointTrajectoryPoint error, string[] multi_dof_joint_names, '
    'trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_desired, '
    'trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_actual, '
    'trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_error',
    'msg/JointTrajectoryControllerState.msg': 'std_msgs/Header header, string[] joint_names, '
    'trajectory_msgs/JointTrajectoryPoint reference, trajectory_msgs/JointTrajectoryPoint feedback, '
    'trajectory_msgs/JointTrajectoryPoint error, trajectory_msgs/JointTrajectoryPoint output, '
    'string[] multi_dof_joint_names, trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_reference, '
    'trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_feedback, '
    'trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_error, '
    'trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_output, float64 speed_scaling_factor',
    'msg/JointJog.msg': 'std_msgs/Header header, string[] joint_names, float64[] displacements, '
    'float64[] velocities, float64 duration',
    'msg/MotionArgument.msg': 'string name, float64 value',
    'msg/MotionPrimitive.msg': 'int8 UNKNOWN=-1, int8 LINEAR_JOINT=0, int8 LINEAR_CARTESIAN=50, '
    'int8 CIRCULAR_CARTESIAN=51, int8 type -1, float64 blend_radius, MotionArgument[] additional_arguments, '
    'geometry_msgs/PoseStamped[] poses, float64[] joint_positions',
    'msg/MotionPrimitiveSequence.msg': 'MotionPrimitive[] motions',
    'action/ExecuteMotionPrimitiveSequence.action': 'MotionPrimitiveSequence trajectory, ---, '
    'int32 SUCCESSFUL = 0, int32 INVALID_GOAL = -1, int32 OLD_HEADER_TIMESTAMP = -3, int32 error_code, '
    'string error_string, ---, uint8 current_primitive_index',
}
FIELDS = {
    PACKAGE: CONTROL_FIELDS,
    'tf2_msgs': {'msg/TFMessage.msg': 'geometry_msgs/TransformStamped[] transforms'},
}
NEEDED = (
    'action_msgs', 'builtin_interfaces', 'geometry_msgs', 'service_msgs', 'std_msgs', 'trajectory_msgs',
    'unique_identifier_msgs',
)  # fmt: skip
KINDS = (
    'generator_c',
    'generator_py',
    'typesupport_c',
    'typesupport_fastrtps_c',
    'typesupport_introspection_c',
)
RUNTIME = (
    'fastcdr', 'rcutils', 'rosidl_runtime_c', 'rosidl_typesupport_c', 'rosidl_typesupport_fastrtps_c',
    'rosidl_typesupport_fastrtps_cpp', 'rosidl_typesupport_introspection_c', 'rmw',
)  # fmt: skip
GENERATORS = (
    'em', 'rosidl_adapter', 'rosidl_generator_c', 'rosidl_generator_py', 'rosidl_generator_type_description',
    'rosidl_typesupport_c', 'rosidl_typesupport_fastrtps_c', 'rosidl_typesupport_introspection_c',
)  # fmt: skip
TYPE_SUPPORTS = ('rosidl_typesupport_fastrtps_c', 'rosidl_typesupport_introspection_c')
COMPILE_S = 600.0


def missing() -> str:
    """Return a message about missing requirements of the build, or an empty text."""
    if shutil.which('g++') is None:
        return 'there is no g++'
    for name in GENERATORS:
        if importlib.util.find_spec(name) is None:
            return f'there is no {name}'
    if not (Path(sysconfig.get_path('include')) / 'Python.h').is_file():
        return 'there is no Python.h'
    return ''


def build(folder: Path, name: str = PACKAGE) -> Path:
    """Build a package below a folder; return the entry for PYTHONPATH."""
    prefix = Path(sys.prefix)
    os.environ['AMENT_PREFIX_PATH'] = str(prefix)  # where the generators look for their templates
    package = folder / 'site' / name
    _generate(_write(folder / 'source', name), name, prefix / 'share', folder / 'generated')
    for path in (folder / 'generated' / 'py' / name).rglob('*.py'):
        target = package / path.relative_to(folder / 'generated' / 'py' / name)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, target)
    (package / '__init__.py').touch()
    _compile(folder / 'generated', prefix, package)
    return package.parent


def _write(source: Path, name: str) -> Path:
    for file, fields in FIELDS[name].items():
        path = source / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text('\n'.join(fields.split(', ')) + '\n', encoding='utf-8')
    return source


def _generate(source: Path, package: str, share: Path, into: Path) -> None:
    from rosidl_adapter import convert_to_idl
    from rosidl_generator_c.cli import GenerateC
    from rosidl_generator_py.cli import GeneratePython
    from rosidl_typesupport_c.cli import GenerateCTypesupport
    from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
    from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

    for name in FIELDS[package]:
        convert_to_idl(source, package, Path(name), into / 'idl')
    idl = [f'{into / "idl"}:{Path(name).with_suffix(".idl")}' for name in FIELDS[package]]
    for generator in (
        GenerateC('c'),
        GenerateFastRTPSCTypesupport('fastrtps_c'),
        GenerateIntrospectionCTypesupport('introspection_c'),
        GenerateCTypesupport('dispatch', typesupport_implementations=list(TYPE_SUPPORTS)),
        GeneratePython('py', typesupport_implementations=['rosidl_typesupport_c']),
    ):
        generator.generate(package, idl, [str(share)], into / generator.name / package)


def _compile(generated: Path, prefix: Path, package: Path) -> None:
    import numpy as np

    headers = [prefix / 'include', *(path for path in (prefix / 'include').iterdir() if path.is_dir())]
    headers += [*generated.iterdir(), Path(sysconfig.get_path('include')), Path(np.get_include())]
    options = ['-O0', '-fPIC', '-w', *(f'-I{path}' for path in headers)]
    objects = []
    for source in _joined(generated):
        objects.append(f'{source}.o')
        compiler = ['gcc'] if source.suffix == '.c' else ['g++', '-std=c++17']
        _run([*compiler, *options, '-c', str(source), '-o', objects[-1]])
    names = [f'{needed}__rosidl_{kind}' for needed in NEEDED for kind in KINDS] + list(RUNTIME)
    found = [name for name in names if (prefix / 'lib' / f'lib{name}.so').is_file()]
    link = ['g++', '-shared', '-Wl,--no-as-needed', f'-L{prefix / "lib"}', f'-L{package}']
    link += [f'-Wl,-rpath,{prefix / "lib"}:$ORIGIN', '-o']
    _run([*link, str(package / f'lib{package.name}.so'), *objects, *(f'-l{name}' for name in found)])
    # the middleware asks for libraries by these names: they lead to the one that holds everything
    names = [f'{package.name}__{kind}' for kind in TYPE_SUPPORTS]
    for name in names:
        soname = f'-Wl,-soname,lib{name}.so'
        _run([*link, str(package / f'lib{name}.so'), soname, f'-l{package.name}'])
    extension = package / f'{package.name}_s__rosidl_typesupport_c.so'
    entry = [item for item in objects if '_s.ep.' in item]
    _run([*link, str(extension), *entry, *(f'-l{name}' for name in (package.name, *names))])


def _joined(generated: Path) -> list[Path]:
    """Write one file that includes all sources of a generator, as most of the time goes into their headers.

    Descriptions have equal names for different contents, and the entry is linked alone: they stay as they are.
    """
    found = []
    for kind in sorted({path.relative_to(generated).parts[0] for path in generated.rglob('*.c*')}):
        for suffix in ('.c', '.cpp'):
            sources = sorted((generated / kind).rglob(f'*{suffix}'))
            alone = [path for path in sources if '__description' in path.name or '_s.ep.' in path.name]
            lines = [f'#include "{path}"\n' for path in sources if path not in alone]
            found += alone
            if lines:
                found.append(generated / f'{kind}{suffix}')
                found[-1].write_text(''.join(lines), encoding='utf-8')
    return found


def _run(command: list[str]) -> None:
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=COMPILE_S, check=False, env=os.environ
    )
    if done.returncode:
        raise RuntimeError(f'{command[0]} has failed on {command[-1]}: {done.stderr[-2000:]}')


if __name__ == '__main__':
    print(missing() or build(Path(sys.argv[1]), *sys.argv[2:]))
