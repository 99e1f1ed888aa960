"""Cell cases of ``delta3 faults``: simulate each case of ``fault_cases`` and check its outcome."""

from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.errors import Delta3Error, RobotFault
from delta3_pacdrive.parameters import MODEL_CONTROLLER, Parameters, load
from delta3_pacdrive.scripting.simulation import simulate
from delta3_pacdrive.verification.fault_catalogue.cell_cases import CASES, IN_CELL, CellCase, Notice

LONGEST_S = 20.0


@dataclass(frozen=True)
class CellOutcome:
    """Outcome of a case."""

    case: CellCase
    notice: Notice
    outcomes: dict[str, int]  # number of parts by outcome
    end_s: float  # bus time since the start of the script
    tcp_error_m: float  # maximum
    problem: str = ''  # error that ended the script, or empty

    @property
    def as_expected(self) -> bool:
        """Whether detection and outcomes of parts are as expected."""
        case, notice = self.case, self.notice
        detected = notice.code == case.code and case.sentence in notice.sentence
        parts = all(self.outcomes.get(name) == count for name, count in case.outcomes.items())
        return detected and parts and not self.problem

    def to_row(self) -> dict[str, Any]:
        """Return the row of the catalogue; times are bus times."""
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
    """Return the cases with a text in their line."""
    return [case for case in CASES if only in case.line]


def run_case(case: CellCase, parameters: Parameters) -> CellOutcome:
    """Simulate a case; errors are part of the outcome."""
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
        return CellOutcome(case, notice, {}, 0.0, 0.0, problem=problem)
    meta, error_m = robot.trace.meta, robot.trace.meta['figures']['tcp_error_max_m']
    return CellOutcome(case, notice, meta['cell']['outcomes'], end_s, error_m, problem=problem)


def robot_of(path: str | None) -> Parameters:
    """Return the robot of a parameter file; default: the nominal robot with the model-based controller."""
    return load(path or MODEL_CONTROLLER)
