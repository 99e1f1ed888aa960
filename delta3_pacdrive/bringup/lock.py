"""One robot in a namespace of a domain: the lock of a bring-up. Light, so that a second one is refused at once."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from delta3_pacdrive.errors import RunError, shown


@contextmanager
def only_one(namespace: str) -> Iterator[None]:
    """Hold the lock; raises RunError if another process of this user does, or if there can be none of that name."""
    domain = os.environ.get('ROS_DOMAIN_ID', '0')
    name = f'delta3_pacdrive_{os.getuid()}_domain{domain}_{namespace.strip("/").replace("/", ".")}.lock'
    path = Path(tempfile.gettempdir()) / name
    try:
        file = path.open('w')
    except OSError as error:
        raise RunError(f'namespace {shown(namespace)} is not valid: {error.strerror}') from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise RunError(f'a robot is already up in namespace {namespace} of domain {domain}') from None
        try:
            yield
        finally:
            path.unlink(missing_ok=True)
