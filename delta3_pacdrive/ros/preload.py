"""What each process of nodes needs and would load for itself, which takes it longer than a bus cycle."""

import inspect
import sys

from rcl_interfaces import msg, srv
from rclpy.type_support import check_for_type_support
from type_description_interfaces.srv import GetTypeDescription

from delta3_pacdrive.ros.interfaces import SERVICES, TOPICS

LOGGING = 'rclpy', 'delta3_pacdrive.ros'  # packages from which a line may be logged
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
    """Load what turns messages of all types of the robot into bytes, once for all processes that are forked later."""
    topics, services = ({item.type for item in rows} for rows in (TOPICS, SERVICES))
    for interface in (*OF_EVERY_NODE, *topics, *services):
        check_for_type_support(interface)


def know_modules() -> None:
    """Tell ``inspect`` which module each file is that may log a line.

    A logger of rclpy looks for the file and line that it is called from. For a file that is not known yet ``inspect``
    walks all modules: some 50 ms for the first line of a process, which are 50 bus cycles where it is logged in one.
    """
    for name, module in tuple(sys.modules.items()):
        file = getattr(module, '__file__', None)
        if file and name.startswith(LOGGING):
            inspect.modulesbyfile[file] = name
