"""Replaces the ``ros2`` command line, which the package index does not have, as far as the pages use it.

    ros2 run PACKAGE EXECUTABLE [ARGUMENTS]
    ros2 launch FILE [NAME:=VALUE]
    ros2 launch PACKAGE FILE [NAME:=VALUE]
    ros2 topic pub --once TOPIC TYPE YAML
    ros2 topic echo --once TOPIC
    ros2 service call SERVICE TYPE
    ros2 param set NODE NAME VALUE

Like the real one it finds packages through AMENT_PREFIX_PATH, publishes when a subscriber is present, and prints the
response.
"""

import dataclasses
import importlib
import os
import runpy
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import rclpy
import yaml
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

WAIT_S = 20.0


def interface(name):
    """Return the class of ``package/msg/Name``."""
    package, kind, name = name.split('/')
    return getattr(importlib.import_module(f'{package}.{kind}'), name)


def fill(message, values):
    """Set the fields of a message from a mapping."""
    for key, value in values.items():
        if isinstance(value, dict):
            fill(getattr(message, key), value)
        else:
            setattr(message, key, type(getattr(message, key))(value))
    return message


def path_of(package, executable):
    """Return the path of an executable of a package."""
    for prefix in os.environ['AMENT_PREFIX_PATH'].split(os.pathsep):
        path = Path(prefix) / 'lib' / package / executable
        if path.exists():
            return path
    sys.exit(f'No executable found: {package} {executable}')


def run(package, executable, *arguments):
    """Become an executable of a package."""
    path = path_of(package, executable)
    os.execv(path, [str(path), *arguments])


@dataclasses.dataclass
class LaunchNode:
    """An action of a launch file: a process. Respawns are not carried out."""

    package: str
    executable: str
    name: str
    namespace: str = ''
    parameters: list = dataclasses.field(default_factory=list)
    arguments: list = dataclasses.field(default_factory=list)
    remappings: list = dataclasses.field(default_factory=list)
    respawn: bool = False
    respawn_delay: float = 0.0
    respawn_max_retries: int = -1


@dataclasses.dataclass
class Namespace:
    """An action of a launch file: the namespace of all that follows in its group."""

    name: str


@dataclasses.dataclass
class Argument:
    """An action of a launch file: an argument of the command line."""

    name: str
    default_value: str
    description: str
    choices: list | None = None


@dataclasses.dataclass
class Configuration:
    """The value of an argument."""

    name: str

    def perform(self, context):
        """Return the value."""
        return context[self.name]


@dataclasses.dataclass
class Function:
    """An action of a launch file: a function of the arguments that returns actions."""

    function: Callable


class Group(list):
    """The contents of a launch file: actions, and groups of them."""


MODULES = {
    'launch': {'LaunchDescription': Group, 'LaunchContext': dict},
    'launch.actions': {'DeclareLaunchArgument': Argument, 'GroupAction': Group, 'OpaqueFunction': Function},
    'launch.substitutions': {'LaunchConfiguration': Configuration},
    'launch_ros': {},
    'launch_ros.actions': {'Node': LaunchNode, 'PushRosNamespace': Namespace},
}


def nodes_of(actions, given, namespace=''):
    """Return the nodes of actions with absolute namespaces; ``given`` has the arguments and gets their defaults."""
    nodes = []
    for action in actions:
        match action:
            case Argument(name, default, _, choices):
                value = given.setdefault(name, default)
                if choices and value not in choices:
                    raise ValueError(f'argument {name} is {value!r}, but must be one of {choices}')
            case Namespace(name):
                namespace = f'{namespace}/{name}'
            case Function(function):
                nodes += nodes_of(function(given), given, namespace)
            case Group():
                nodes += nodes_of(action, given, namespace)
            case LaunchNode():
                absolute = action.namespace.startswith('/')
                own = action.namespace if absolute else f'{namespace}/{action.namespace}'.rstrip('/')
                nodes.append(dataclasses.replace(action, namespace=own))
    return nodes


def launched(path, given):
    """Return the nodes of a launch file for arguments."""
    for name, contents in MODULES.items():
        sys.modules[name] = ModuleType(name)
        vars(sys.modules[name]).update(contents)
    return nodes_of(runpy.run_path(path)['generate_launch_description'](), given)


def command_of(node, folder):
    """Return the command line that launch_ros makes of a node, with parameter files in the folder."""
    line = [str(path_of(node.package, node.executable)), *node.arguments, '--ros-args']
    line += ['-r', f'__node:={node.name}', '-r', f'__ns:={node.namespace or "/"}']
    for one, other in node.remappings:
        line += ['-r', f'{one}:={other}']
    for values in filter(None, node.parameters):
        line += ['--params-file', values if isinstance(values, str) else file_of(node, values, folder)]
    return line


def file_of(node, values, folder):
    """Write parameters of a node into a file; return its path."""
    with tempfile.NamedTemporaryFile('w', suffix='.yaml', dir=folder, delete=False) as file:
        yaml.safe_dump({f'{node.namespace}/{node.name}': {'ros__parameters': values}}, file)
    return file.name


def launch(path, arguments):
    """Start the nodes of a launch file; end them with Ctrl-C."""
    nodes = launched(path, dict(argument.split(':=', 1) for argument in arguments))
    with tempfile.TemporaryDirectory() as folder:
        started = [subprocess.Popen(command_of(node, folder)) for node in nodes]
        for process in started:
            print(
                f'[INFO] [{Path(process.args[0]).name}]: process started with pid [{process.pid}]', flush=True
            )
        try:
            signal.pause()
        except KeyboardInterrupt:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            for process in started:
                process.send_signal(signal.SIGINT)
            for process in started:
                process.wait()


def launch_file(package, name):
    """Return the path of a launch file of a package."""
    for prefix in os.environ['AMENT_PREFIX_PATH'].split(os.pathsep):
        for path in (Path(prefix) / 'share' / package).rglob(name):
            return str(path)
    sys.exit(f"file '{name}' was not found in the share directory of package '{package}'")


def wait(node, condition, what):
    """Spin until a condition holds."""
    deadline = time.monotonic() + WAIT_S
    while not condition():
        if time.monotonic() > deadline:
            sys.exit(f'not within {WAIT_S:g} s: {what}')
        rclpy.spin_once(node, timeout_sec=0.05)


def publish(node, topic, kind, text):
    """Publish one message."""
    publisher = node.create_publisher(interface(kind), topic, 10)
    wait(node, publisher.get_subscription_count, f'a subscription of {topic}')
    publisher.publish(fill(interface(kind)(), yaml.safe_load(text)))
    publisher.wait_for_all_acked()


def echo(node, topic):
    """Print the next message of a topic, or the latched one."""
    wait(node, lambda: topic in dict(node.get_topic_names_and_types()), f'topic {topic}')
    (kind,) = dict(node.get_topic_names_and_types())[topic]
    offered = node.get_publishers_info_by_topic(topic)[0].qos_profile
    heard = []
    qos = QoSProfile(depth=1, durability=offered.durability, reliability=offered.reliability)
    node.create_subscription(interface(kind), topic, heard.append, qos)
    wait(node, lambda: heard, f'a message of {topic}')
    for field in heard[0].get_fields_and_field_types():
        print(f'{field}: {getattr(heard[0], field)}')
    print('---')


def call(node, service, kind, request):
    """Call a service; return its response."""
    client = node.create_client(kind, service)
    wait(node, client.service_is_ready, f'service {service}')
    future = client.call_async(request)
    wait(node, future.done, f'an answer of {service}')
    return future.result()


def main():
    """Run the command."""
    match sys.argv[1:]:
        case ['run', package, executable, *arguments]:
            run(package, executable, *arguments)
        case ['launch', path, *arguments] if path.endswith('.py'):
            launch(path, arguments)
        case ['launch', package, name, *arguments]:
            launch(launch_file(package, name), arguments)
        case ['topic', 'pub', '--once', topic, kind, text]:
            rclpy.init()
            publish(rclpy.create_node('stand_in'), topic, kind, text)
        case ['topic', 'echo', '--once', topic]:
            rclpy.init()
            echo(rclpy.create_node('stand_in'), topic)
        case ['service', 'call', service, kind]:
            rclpy.init()
            print(call(rclpy.create_node('stand_in'), service, interface(kind), interface(kind).Request()))
        case ['param', 'set', name, parameter, text]:
            rclpy.init()
            request = SetParameters.Request()
            request.parameters = [Parameter(parameter, value=float(text)).to_parameter_msg()]
            response = call(rclpy.create_node('stand_in'), f'{name}/set_parameters', SetParameters, request)
            if not response.results[0].successful:
                sys.exit(f'Setting parameter failed: {response.results[0].reason}')
        case _:
            sys.exit(f'not known to this stand-in: {sys.argv[1:]}')


if __name__ == '__main__':
    main()
