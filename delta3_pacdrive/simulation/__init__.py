"""The whole machine in one loop, without ROS: the control and plant code of the nodes, cycle by cycle."""

from delta3_pacdrive.simulation.run import placed, plan_of, require_homed, run
from delta3_pacdrive.simulation.warm_up import (
    compile_kernels,
    load_cyclic_kernels,
    load_kernels,
    precompile,
    precompile_parts,
)

__all__ = [
    'compile_kernels',
    'load_cyclic_kernels',
    'load_kernels',
    'placed',
    'plan_of',
    'precompile',
    'precompile_parts',
    'require_homed',
    'run',
]
