"""Jacobian study: comparison of joint motions, causes of their differences other than wrong lengths, and the report."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive.errors import ParameterError, ReportError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Kinematics
from delta3_pacdrive.studies.framework import study as studies
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.runs.inputs import with_digests
from delta3_pacdrive.studies.thesis.jacobian import condition, figures, report
from delta3_pacdrive.studies.thesis.jacobian.deviation import Deviation
from delta3_pacdrive.studies.thesis.jacobian.mapping import (
    inexact,
    joint_motion,
    with_printed_jacobian_dot,
    without_jacobian_dot,
)
from delta3_pacdrive.studies.thesis.jacobian.motion import Motion, load
from delta3_pacdrive.studies.thesis.jacobian.sensitivity import sensitivities, tolerance
from delta3_pacdrive.studies.thesis.jacobian.study import (
    LATE,
    PRINTED_JACOBIAN_DOT,
    WITHOUT_JACOBIAN_DOT,
    Cause,
    Course,
    Results,
    Settings,
    Trial,
)

ERROR_MAX_M = 0.1  # a larger error means another robot, or a value in millimetres
CONSECUTIVE = 1.5  # largest distance of consecutive samples, in sample times


def causes(motion: Motion, kinematics: Kinematics) -> list[Cause]:
    """Return the deviations by a bus cycle between TCP and joints, by omitting Jdot, and by (4.15) as printed."""
    rows = []
    for name, quantity, _, calculated, recorded in _compared(motion, kinematics):
        found = Deviation.of(calculated, recorded).summary()
        rows.append(Cause(name, quantity, found['of_peak']['max'], found['momentary']['max']))
    return rows


def courses(motion: Motion, kinematics: Kinematics) -> list[Course]:
    """Return the deviations of ``causes`` over time."""
    found = []
    for name, quantity, rows, calculated, recorded in _compared(motion, kinematics):
        values = np.full((len(motion.time_s), 3), np.nan)
        values[rows] = Deviation.of(calculated, recorded).of_peak
        found.append(Course(name, quantity, values))
    return found


def _compared(motion: Motion, kinematics: Kinematics) -> list[tuple[str, str, Any, Floats, Floats]]:
    """Return for each cause name, quantity, rows in which it is defined, calculated and recorded values there."""
    exact = joint_motion(motion, kinematics)
    pairs = np.flatnonzero(np.diff(motion.time_s) < CONSECUTIVE * motion.period_s)
    now, before = pairs + 1, pairs
    without, printed = (
        make(motion, kinematics) for make in (without_jacobian_dot, with_printed_jacobian_dot)
    )
    every = slice(None)
    return [
        (LATE, 'velocity', now, exact.velocity[now], motion.thetadot[before]),
        (LATE, 'acceleration', now, exact.acceleration[now], motion.thetaddot[before]),
        (WITHOUT_JACOBIAN_DOT, 'acceleration', every, without, motion.thetaddot),
        (PRINTED_JACOBIAN_DOT, 'acceleration', every, printed, motion.thetaddot),
    ]


@dataclass
class Study(studies.Study):
    """Jacobian study in a report folder."""

    settings: Settings
    robot: core.Parameters = field(init=False)

    def __post_init__(self) -> None:
        """Read the parameters and reject errors that no length can have; raises ParameterError."""
        self.robot = core.load(self.settings.parameters)
        errors = self.settings.errors
        if not errors:
            raise ParameterError('at least one error of a length is required')
        for symbol, error in errors.items():
            if not abs(error) <= ERROR_MAX_M:
                raise ParameterError(
                    f'the error of {symbol} is {error:g} m, but must be between {-ERROR_MAX_M:g} and {ERROR_MAX_M:g} m'
                )
        self._wrong = inexact(self.robot.kinematics, errors)

    def run(self) -> dict[str, Any]:
        """Run the study, write its results to the folder and return the report; raises Delta3Error."""
        chosen = self.settings
        steps = 2 * len(chosen.inputs) + 1
        trials: list[Trial] = []
        for number, text in enumerate(chosen.inputs):
            self.on_progress(f'trajectory {text}', 2 * number, steps)
            motion = load(text, self.robot, chosen.signals)
            if motion.name in (trial.motion.name for trial in trials):
                raise ReportError(
                    f'two inputs have the name {motion.name}: their figures would have the same file names'
                )
            self.on_progress(f'{motion.name}: sensitivities', 2 * number + 1, steps)
            trials.append(self._trial(motion))
        origin = Provenance.of(self.command, self.robot, chosen.parameters, with_digests(chosen.inputs))
        self.on_progress('poses across the workspace', steps - 1, steps)
        found = Results(trials, condition.sweep(self.robot.kinematics))
        document = report.summary(found, chosen, self.robot)
        self.on_progress('tables and figures', 0, 0)
        return ReportFolder(self.folder, origin).results(
            'Joint motion through the Jacobian',
            document,
            report.text(document),
            report.tables(found),
            figures.by_name(
                found,
                report.error_text(chosen.errors, True),
                self.robot.kinematics,
                report.plausibility(chosen.errors),
            ),
        )

    def _trial(self, motion: Motion) -> Trial:
        nominal, pose = self.robot.kinematics, self.settings.pose
        return Trial(
            motion=motion,
            exact=joint_motion(motion, nominal, pose),
            inexact=joint_motion(motion, self._wrong, pose),
            condition=condition.of_motion(motion, nominal),
            worst=condition.worst_direction(motion.theta, motion.tcp, nominal, pose),
            sensitivities=sensitivities(motion, nominal),
            tolerance=tolerance(motion, nominal, pose),
            causes=causes(motion, nominal),
            courses=courses(motion, nominal),
        )
