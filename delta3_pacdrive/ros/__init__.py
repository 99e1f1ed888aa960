"""The robot on ROS 2: its nodes, and what turns messages into the values of the core and back."""

import sys
from typing import Any

# Every message class loads the generator that made it, with a grammar and its parser: a tenth of what a
# command takes to start. It is there for builds, and the classes do without it where it cannot be loaded.
_modules: dict[str, Any] = sys.modules
_modules.setdefault('rosidl_generator_py.generate_py_impl', None)
