"""Stands in for the ``ros2`` command line, which the package index does not have, as far as the README uses it.

    ros2 run PACKAGE EXECUTABLE [ARGUMENTS]
    ros2 topic pub --once TOPIC TYPE YAML
    ros2 service call SERVICE TYPE
    ros2 param set NODE NAME VALUE

Like the real one it finds packages through AMENT_PREFIX_PATH, publishes when somebody listens, and prints the response.
"""

import importlib
import os
import sys
import time
from pathlib import Path

import rclpy
import yaml
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

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


def run(package, executable, *arguments):
    """Become an executable of a package."""
    for prefix in os.environ['AMENT_PREFIX_PATH'].split(os.pathsep):
        path = Path(prefix) / 'lib' / package / executable
        if path.exists():
            os.execv(path, [str(path), *arguments])
    sys.exit(f'No executable found: {package} {executable}')


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
        case ['topic', 'pub', '--once', topic, kind, text]:
            rclpy.init()
            publish(rclpy.create_node('stand_in'), topic, kind, text)
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


main()
