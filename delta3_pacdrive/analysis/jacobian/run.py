"""The Jacobian experiments from their settings to their folder: what is compared, what is written."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from delta3_pacdrive import parameters as core
from delta3_pacdrive.analysis import figure_style
from delta3_pacdrive.analysis.jacobian import condition, figures, report, study_figures
from delta3_pacdrive.analysis.jacobian.causes import causes
from delta3_pacdrive.analysis.jacobian.mapping import Pose, inexact, joint_motion
from delta3_pacdrive.analysis.jacobian.motion import load, source_file
from delta3_pacdrive.analysis.jacobian.sensitivity import sensitivities, tolerance
from delta3_pacdrive.analysis.jacobian.study import Settings, Trial
from delta3_pacdrive.analysis.provenance import Provenance, digest, write_json
from delta3_pacdrive.errors import ParameterError, ReportError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from delta3_pacdrive.analysis.jacobian.motion import Motion
    from delta3_pacdrive.parameters import Parameters

    OnProgress = Callable[[str, int, int], None]

REPORT = 'report.json'
ERROR_MAX_M = 0.1  # beyond that it is another robot, or millimetres were meant
STEPS = 3  # of the progress per trajectory; and two for the workspace


def run(settings: Settings, folder: Path, command: str, on_progress: OnProgress) -> dict[str, Any]:
    """Compare, write everything into the folder and return the report.

    ``on_progress`` is called with a stage in words, what is done and all of it.

    Raises
    ------
    Delta3Error
        An input cannot be read or does not fit, an error is no length's, or a file cannot be written.

    """
    robot = core.load(settings.parameters)
    if not settings.errors:
        raise ParameterError('the inexact lengths need at least one error')
    for symbol, error in settings.errors.items():
        if not abs(error) <= ERROR_MAX_M:
            raise ParameterError(
                f'the error of {symbol} is {error:g} m, but must be between {-ERROR_MAX_M:g} and {ERROR_MAX_M:g} m'
            )
    wrong = inexact(robot.kinematics, settings.errors)
    steps = STEPS * len(settings.inputs) + 2
    trials: list[Trial] = []
    inputs: list[str] = []
    for number, text in enumerate(settings.inputs):
        on_progress(f'trajectory {text}', STEPS * number, steps)
        motion = load(text, robot, settings.signals)
        if motion.name in (trial.motion.name for trial in trials):
            raise ReportError(f'two inputs are called {motion.name}, and so would be their figures')
        on_progress(f'{motion.name}: sensitivities', STEPS * number + 1, steps)
        inputs.append(f'{text} {digest(source_file(text))}')
        trials.append(_trial(motion, robot, wrong, settings.pose))
    provenance = Provenance.of(command, robot, settings.parameters, inputs)
    on_progress('poses across the workspace', steps - 2 - len(trials), steps)
    found = condition.sweep(robot.kinematics)
    document = report.document(trials, found, settings, robot, provenance)
    tables = report.write_tables(trials, found, folder, provenance)
    pictures = []
    for number, trial in enumerate(trials):
        on_progress(f'{trial.motion.name}: figures', steps - 1 - len(trials) + number, steps)
        drawings = figures.by_name(trial, report.error_text(settings.errors, mathematical=True), provenance)
        pictures += figure_style.save(drawings, folder, provenance.lines())
    on_progress('figures of the workspace', steps - 1, steps)
    drawings = {
        'sensitivities.png': partial(study_figures.sensitivities, trials, provenance),
        'deviation_over_condition.png': partial(
            study_figures.deviation_over_condition, found, robot.kinematics, provenance
        ),
    }
    pictures += figure_style.save(drawings, folder, provenance.lines())
    document['files'] = [str(path) for path in (folder / REPORT, *tables, *pictures)]
    write_json(document, folder / REPORT)
    return document


def _trial(motion: Motion, robot: Parameters, wrong: core.Kinematics, pose: Pose) -> Trial:
    nominal = robot.kinematics
    return Trial(
        motion,
        joint_motion(motion, nominal, pose),
        joint_motion(motion, wrong, pose),
        condition.of_motion(motion, nominal),
        condition.worst_direction(motion.theta, motion.tcp, nominal, pose),
        sensitivities(motion, nominal),
        tolerance(motion, nominal, pose),
        causes(motion, nominal),
    )
