"""Preloading of slow imports and look-ups that would otherwise take longer than a bus cycle in each process."""

import inspect
import sys

from rcl_interfaces import msg, srv
from rclpy.type_support import check_for_type_support
from type_description_interfaces.srv import GetTypeDescription

from delta3_pacdrive.ros.wire.interfaces import SERVICES, TOPICS

LOGGING = 'rclpy', 'delta3_pacdrive.ros'  # packages that log
OF_EVERY_NODE = (
    msg.ParameterEvent,
    srv.DescribeParameters,
    srv.GetParameters,
    srv.GetParameterTypes,
    srv.ListParameters,
    srv.SetParameters,
    srv.SetParametersAtomically,
    GetTypeDescription,
)


def load_type_support() -> None:
    """Load the type support of all messages and services, once before processes are forked."""
    topics, services = ({item.type for item in rows} for rows in (TOPICS, SERVICES))
    for interface in (*OF_EVERY_NODE, *topics, *services):
        check_for_type_support(interface)


def know_modules() -> None:
    """Register the modules that log in the cache of ``inspect``.

    A logger of rclpy determines file and line of its caller. For an unknown file ``inspect`` walks all modules, which
    takes some 50 ms (50 bus cycles) for the first log line of a process.
    """
    for name, module in tuple(sys.modules.items()):
        file = getattr(module, '__file__', None)
        if file and name.startswith(LOGGING):
            inspect.modulesbyfile[file] = name
