"""Values of drives by axis and IDN, through the service channel of a robot that is up."""

from typing import Protocol

from delta3_pacdrive.controller.service_texts import value_in


class Asks(Protocol):
    """Who asks the drives, as an operator does."""

    def drive(self, request: str) -> str:
        """Return the sentence that a request is answered with; raises ProgramError if it is refused."""


class DriveValues:
    """The values are read and written one after the other; raises ProgramError where a drive refuses."""

    def __init__(self, operator: Asks) -> None:
        self._operator = operator

    def read(self, axis: str, idn: str) -> float:
        """Return a value, in its unit."""
        return value_in(self._operator.drive(f'{axis} read {idn}'))

    def write(self, axis: str, idn: str, value: float) -> None:
        """Write a value, in its unit."""
        self._operator.drive(f'{axis} write {idn} {value!r}')
