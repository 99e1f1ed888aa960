"""The part of ``delta3 faults`` that is about cells: each case of ``fault_cases`` is simulated and judged."""

from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.cell.fault_cases import CASES, IN_CELL, CellCase, Notice
from delta3_pacdrive.cell.simulation import simulate
from delta3_pacdrive.errors import Delta3Error, RobotFault
from delta3_pacdrive.parameters import MODEL_CONTROLLER, Parameters, load
from delta3_pacdrive.peripherals import cell_file

LONGEST_S = 20.0


@dataclass(frozen=True)
class CellOutcome:
    """A case came to this.

    Attributes
    ----------
    case
        Which one.
    notice
        What the script has noticed.
    outcomes
        How many parts came to what.
    end_s
        Bus time of its end, since the script began [s].
    tcp_error_m
        How far the TCP was from its command at most [m].
    problem
        Why the script could not go on; empty if it could.

    """

    case: CellCase
    notice: Notice
    outcomes: dict[str, int]
    end_s: float
    tcp_error_m: float
    problem: str = ''

    @property
    def as_expected(self) -> bool:
        """Whether the script was told what it has to be told, and parts came to what they have to."""
        case, notice = self.case, self.notice
        told = notice.code == case.code and case.sentence in notice.sentence
        parts = all(self.outcomes.get(name) == count for name, count in case.outcomes.items())
        return told and parts and not self.problem

    def to_row(self) -> dict[str, Any]:
        """Return it for the table of the catalogue; times are bus times."""
        case, noticed_s = self.case, self.notice.time_s
        return {
            'case': case.text,
            'detected_s': None if noticed_s is None else max(noticed_s - case.begins_s, 0.0),
            'silent_s': None,
            'reported': self.notice.sentence,
            'exercised': False,
            'evidence': ', '.join(f'{count} {name}' for name, count in self.outcomes.items() if count),
            'deviation_m': self.tcp_error_m,
            'recovered_s': None if noticed_s is None or self.problem else max(self.end_s - noticed_s, 0.0),
            'reference_m': None,
            'problem': self.problem,
            'state': IN_CELL,
            'reaction': f'code {self.notice.code}' if self.notice.code else 'goes on',
            'expected': ' '.join(filter(None, [case.code, case.sentence])),
            'ok': self.as_expected,
            **RobotFault.facts(None),
        }


def cases(only: str = '') -> list[CellCase]:
    """Return the cases whose line holds a text."""
    return [case for case in CASES if only in case.line]


def run_case(case: CellCase, parameters: Parameters) -> CellOutcome:
    """Simulate a case; what goes wrong is in the outcome."""
    notice, problem = Notice(), ''
    robot, end_s = None, 0.0
    try:
        with simulate(
            parameters, cell=cell_file.parse(case.cell), name=case.text, longest_s=LONGEST_S
        ) as robot:
            case.script(robot, notice)
            robot.wait()
            end_s = robot.state().time_s
    except Delta3Error as error:
        problem = str(error)
    if robot is None:
        return CellOutcome(case, notice, {}, 0.0, 0.0, problem)
    meta = robot.trace.meta
    return CellOutcome(
        case, notice, meta['cell']['outcomes'], end_s, meta['figures']['tcp_error_max_m'], problem
    )


def robot_of(path: str | None) -> Parameters:
    """Return the robot of a parameter file; without one the nominal one, whose controller knows the model."""
    return load(path or MODEL_CONTROLLER)
