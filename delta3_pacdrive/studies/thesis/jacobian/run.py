"""Jacobian study: comparison of joint motions and its report."""

from dataclasses import dataclass, field
from typing import Any

from delta3_pacdrive import parameters as core
from delta3_pacdrive.errors import ParameterError, ReportError
from delta3_pacdrive.studies.framework import study as studies
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.runs.inputs import with_digests
from delta3_pacdrive.studies.thesis.jacobian import condition, figures, report
from delta3_pacdrive.studies.thesis.jacobian.causes import causes, courses
from delta3_pacdrive.studies.thesis.jacobian.mapping import inexact, joint_motion
from delta3_pacdrive.studies.thesis.jacobian.motion import Motion, load
from delta3_pacdrive.studies.thesis.jacobian.sensitivity import sensitivities, tolerance
from delta3_pacdrive.studies.thesis.jacobian.study import Results, Settings, Trial

ERROR_MAX_M = 0.1  # a larger error means another robot, or a value in millimetres


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
