"""ROS 2 interface of the robot: nodes, clients, and conversion between messages and core types."""

import sys
from typing import Any

# Importing a message class imports its generator with a grammar and parser, which takes a tenth of the start-up time of
# a command. Only builds need the generator; message classes work without it.
_modules: dict[str, Any] = sys.modules
_modules.setdefault('rosidl_generator_py.generate_py_impl', None)
