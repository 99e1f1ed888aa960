"""Access to drive values by axis and IDN through the service channel of a running robot."""

from typing import Protocol

from delta3_pacdrive.controller.service_texts import value_in


class ServiceChannel(Protocol):
    """A client of the service channel, such as an operator."""

    def drive(self, request: str) -> str:
        """Return the reply to a request; raises ProgramError if it is rejected."""


class DriveValues:
    """Reads and writes values one at a time; raises ProgramError if a drive rejects the access."""

    def __init__(self, operator: ServiceChannel) -> None:
        self._operator = operator

    def read(self, axis: str, idn: str) -> float:
        """Return a value, in its unit."""
        return value_in(self._operator.drive(f'{axis} read {idn}'))

    def write(self, axis: str, idn: str, value: float) -> None:
        """Write a value, in its unit."""
        self._operator.drive(f'{axis} write {idn} {value!r}')
