"""Start one robot: its nodes, restarted when they end unexpectedly, and RViz if wanted.

    ros2 launch delta3_pacdrive delta3.launch.py namespace:=cell2 rviz:=true

``delta3 up`` starts the same nodes with real-time scheduling, and watches the bus.
"""

import atexit
import shutil
import tempfile
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from delta3_pacdrive import parameters
from delta3_pacdrive.ros.wire import discovery, domain, frames

PACKAGE = 'delta3_pacdrive'
CHOICE = ['true', 'false']
ARGUMENTS = [
    DeclareLaunchArgument('namespace', default_value='', description='namespace of the robot'),
    DeclareLaunchArgument(
        'parameters',
        default_value='',
        description='parameter file or packaged name, as for delta3 up --parameters; empty: the default of delta3 up',
    ),
    DeclareLaunchArgument(
        'frame_prefix',
        default_value='',
        description='text before the frame base and the links of the robot, such as robot1/',
    ),
    DeclareLaunchArgument('rviz', default_value='false', choices=CHOICE, description='also start RViz'),
    DeclareLaunchArgument(
        'use_sim_time',
        default_value='false',
        choices=CHOICE,
        description='parameter of all nodes; robot_visualization then publishes bus time on /clock unless another '
        'node publishes it. The nodes of the robot use bus time in both cases',
    ),
]
RESPAWN = {'respawn': True, 'respawn_delay': 1.0, 'respawn_max_retries': 20}
SHOWN_TOPICS = (
    'markers',
    'robot_description',
    'tcp/actual',
)  # by the layout, which names them without a namespace


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the nodes."""
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=_nodes)])


def _nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes for the values of the arguments; raises Delta3Error for a wrong value."""
    namespace, given, prefix, rviz, sim_time = (
        LaunchConfiguration(argument.name).perform(context) for argument in ARGUMENTS
    )
    domain.namespace(namespace)
    frames.checked_prefix(prefix)
    robot = parameters.load(parameters.of_run(given or None))
    discovery.keep_to_this_machine()  # in the environment of all processes started here, RViz included
    folder = Path(tempfile.mkdtemp(prefix='delta3-launch-'))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    values = str(parameters.write(robot, folder / 'robot.yaml'))
    clock = {'use_sim_time': sim_time == 'true'}
    common = clock | ({frames.PREFIX: prefix} if prefix else {})

    def node(executable: str, name: str = '', **own: int) -> Node:
        return Node(
            package=PACKAGE,
            executable=executable,
            name=name or executable,
            namespace=namespace.rstrip('/'),
            parameters=[values, common | own],
            **RESPAWN,
        )

    nodes = [
        node('plant'),
        *(node('mc4_drive', f'mc4_drive_{axis}', axis=axis) for axis in range(1, len(robot.axes) + 1)),
        node('transformation_task'),
        node('unit_robot'),
        node('robot_visualization'),
    ]
    if rviz == 'true':
        layout = parameters.config_directory() / 'layouts' / 'delta3.rviz'
        shown = Node(
            package='rviz2',
            executable='rviz2',
            name='rviz2',
            namespace=namespace.rstrip('/'),
            arguments=['-d', str(layout), '-f', f'{prefix}base'],
            parameters=[clock],
            remappings=[(f'/{topic}', topic) for topic in SHOWN_TOPICS],
        )
        nodes.append(shown)
    return nodes
