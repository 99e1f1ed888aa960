"""Identifies the dependencies of the bits of a run apart from the sources; imports nothing of the package."""

import hashlib
import platform
from importlib import metadata


def maker():
    """Return a short digest of all dependencies of the bits except the sources."""
    import llvmlite.binding as llvm

    packages = [
        f'{name} {metadata.version(name)}' for name in ('numba', 'llvmlite', 'numpy', 'scipy', 'ruckig')
    ]
    facts = [
        platform.python_version(),
        platform.machine(),
        *platform.libc_ver(),
        llvm.get_host_cpu_name(),
        llvm.get_host_cpu_features().flatten(),
        *packages,
    ]
    return hashlib.sha256(' '.join(facts).encode()).hexdigest()[:16]
