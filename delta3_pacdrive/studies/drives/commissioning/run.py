"""Commissioning of a running robot: measured margins, inertia and friction; gains that are applied and verified."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import Delta3Error, TuningError
from delta3_pacdrive.parameters import ARMS, RATED_PAYLOAD_KG, Parameters
from delta3_pacdrive.parameters.notch import Notch, notches
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.studies.drives.commissioning import figures, report
from delta3_pacdrive.studies.drives.commissioning.mechanics import Mechanics, friction_strokes, identify
from delta3_pacdrive.studies.drives.commissioning.plant import plant_of
from delta3_pacdrive.studies.drives.commissioning.responses import AxisResponse, responses, stroke, usable
from delta3_pacdrive.studies.drives.commissioning.robot import RunningRobot
from delta3_pacdrive.studies.drives.commissioning.study import (
    AxisMargins,
    Measurement,
    Outcome,
    Proposed,
    Results,
    Settings,
)
from delta3_pacdrive.studies.drives.loops.response import margins
from delta3_pacdrive.studies.drives.tuning import drive_gains, gains
from delta3_pacdrive.studies.drives.tuning.candidates import Candidates, Gains, Least
from delta3_pacdrive.studies.drives.tuning.proposal import Targets, propose_measured, spread
from delta3_pacdrive.studies.framework import study as studies
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder

# margins of a second measurement may fall short of the proposed ones by the errors of both
SHORT_DEG, SHORT_DB = 3.0, 1.0
BEFORE, AFTER = 'before', 'after'


@dataclass
class Study(studies.Study):
    """Commissioning in a report folder; ``connect`` opens the robot, whose motion is then exclusive."""

    settings: Settings
    connect: Callable[[], AbstractContextManager[RunningRobot]]

    def __post_init__(self) -> None:
        """Check the settings; raises TuningError."""
        chosen = self.settings
        given = {'phase_deg': chosen.phase_margin_deg, 'gain_db': chosen.gain_margin_db}
        self._targets = Targets(**{name: value for name, value in given.items() if value is not None})
        if chosen.apply:
            drive_gains.require_same_robot(chosen.namespace, self.folder)

    def run(self) -> dict[str, Any]:
        """Measure, propose, apply and verify; write the results and return the report; raises Delta3Error."""
        with self.connect() as robot:
            found, folder = self._run(robot)
        self.on_progress('tables and figures', 0, 0)
        document = report.summary(found)
        text, tables = report.text(document), report.tables(found)
        return folder.results('Commissioning of the drives', document, text, tables, figures.by_name(found))

    def _run(self, robot: RunningRobot) -> tuple[Results, ReportFolder]:
        own = with_actual_gains(robot)
        folder = ReportFolder(
            self.folder, Provenance.of(self.command, own, f'robot {self.settings.namespace}')
        )
        folder.make()
        angles = robot.angles_rad()
        before, mechanics = measure(robot, own, self.on_progress)
        found = Results(
            angles_rad=angles,
            tcp_m=kinematics.forward(np.array(angles), own.kinematics).tolist(),
            parameters=own,
            mechanics=mechanics,
            measured={BEFORE: before},
            proposed=None,
            outcome=None,
        )
        if self.settings.propose:
            found = replace(found, proposed=self._propose(found))
            self._write(found.proposed, folder)
        if self.settings.apply and found.proposed is not None:
            found = self._apply(robot, found, found.proposed)
        return found, folder

    def _propose(self, found: Results) -> Proposed:
        own, mechanics = found.parameters, found.mechanics
        plant = plant_of(
            found.measured[BEFORE].responses,
            mechanics,
            own.motor.torque_constant_n_m_a,
            _shares(mechanics, own),
        )
        inertia = float(np.mean([one.inertia_kg_m2.value for one in mechanics]))
        gears = [one.gear.resonance_hz for one in mechanics if one.gear is not None]
        resonance = float(np.mean(gears)) if gears else None
        proposed, least = propose_measured(
            own, self._targets, plant, inertia, resonance, on_progress=self.on_progress
        )
        return Proposed(self._targets, proposed, least, _gains(own))

    def _write(self, proposed: Proposed | None, folder: ReportFolder) -> None:
        if proposed is not None:
            kept = f'{proposed.targets.phase_deg:g} deg and {proposed.targets.gain_db:g} dB with the measured axes'
            gains.write(proposed.gains, kept, folder.path / gains.FILE, folder.provenance)
            folder.add(folder.path / gains.FILE)

    def _apply(self, robot: RunningRobot, found: Results, proposed: Proposed) -> Results:
        """Apply the gains, measure again, and restore the previous gains if the margins are not kept."""
        folder, own = self.folder, proposed.gains.of(found.parameters)
        drive_gains.apply(proposed.gains.values(), robot.channel, self.settings.namespace, folder)
        try:
            measured = _responses(robot, own, AFTER, self.on_progress)
            after = _measurement(measured, found.mechanics, own, AFTER)
        except (Delta3Error, KeyboardInterrupt) as error:
            drive_gains.undo(robot.channel, folder)
            if isinstance(error, KeyboardInterrupt):
                raise
            raise type(error)(f'{error}; the previous gains are restored in all drives') from error
        found = replace(found, measured=found.measured | {AFTER: after})
        if reason := _worse(found.measured[BEFORE].least, after.least, proposed.targets):
            drive_gains.undo(robot.channel, folder)
            sentence = f'{reason}: the previous gains are restored in all drives'
            return replace(found, outcome=Outcome(False, sentence))
        back = 'delta3 tune --undo' + ('' if str(folder) == 'tuning' else f' --output {folder}')
        return replace(found, outcome=Outcome(True, f'the gains are in all drives; undo with {back}'))


def measure(
    robot: RunningRobot, own: Parameters, on_progress: studies.OnProgress
) -> tuple[Measurement, list[Mechanics]]:
    """Return margins and mechanics of the axes of a robot at its pose; raises Delta3Error."""
    angles = robot.angles_rad()
    measured, mechanics = _responses(robot, own, BEFORE, on_progress), []
    for response in measured:
        on_progress(f'friction of axis{response.axis + 1}', response.axis, ARMS)
        record = robot.record(friction_strokes(response.axis), excited=False)
        mechanics.append(identify(response, record, angles, own))
    return _measurement(measured, mechanics, own, BEFORE), mechanics


def _responses(
    robot: RunningRobot, own: Parameters, which: str, on_progress: studies.OnProgress
) -> list[AxisResponse]:
    found = []
    for axis in range(ARMS):
        on_progress(f'excitation of axis{axis + 1}, {which}', axis, ARMS)
        pose = own.dynamics.gear_ratio * robot.angles_rad()[axis]
        found.append(responses(robot.record(stroke(axis), excited=True), pose, own))
    return found


def with_actual_gains(robot: RunningRobot) -> Parameters:
    """Return the parameters of the robot with the gains of its drives; raises TuningError if these differ."""
    names = [
        *_gains(robot.parameters).values(),
        *(f'notch_2_{name}' for name in Notch._fields),
        *('current_gain_v_a', 'current_integral_gain_v_a_s'),
    ]
    values: dict[str, float] = {}
    for axis in DRIVES:
        for name in names:
            idn = drive_gains.idn_of(name)
            value = robot.channel.read(axis, idn)
            if values.setdefault(name, value) != value:
                raise TuningError(
                    f'{axis} has {idn} = {value:g} instead of {values[name]:g} as {DRIVES[0]}: the search needs equal '
                    'gains in all drives'
                )
    return robot.parameters.replace(**{f'drive__{name}': value for name, value in values.items()})


def _gains(own: Parameters) -> Gains:
    drive = own.drive
    return Gains(
        drive.velocity_gain_a_s_rad,
        drive.velocity_integral_gain_a_rad,
        drive.position_gain_rad_s_rad,
        notches(drive)[0],
    )


def _shares(mechanics: list[Mechanics], own: Parameters) -> tuple[float, float, float]:
    """Return the inertias of the pose and of the lightest and heaviest mode of the workspace, relative to the pose."""
    model = float(np.mean([one.model_inertia_kg_m2 for one in mechanics]))
    loads = spread(own, max(RATED_PAYLOAD_KG, own.dynamics.payload_mass_kg))
    return 1.0, loads[0].inertia_kg_m2 / model, loads[-1].inertia_kg_m2 / model


def _measurement(
    measured: list[AxisResponse], mechanics: list[Mechanics], own: Parameters, which: str
) -> Measurement:
    plant = plant_of(measured, mechanics, own.motor.torque_constant_n_m_a, _shares(mechanics, own))
    least = Candidates(own, plant).least([_gains(own)])
    return Measurement(measured, [_margins(one, which) for one in measured], least)


def _margins(response: AxisResponse, which: str) -> AxisMargins:
    loop = response.cascade
    inside = usable(loop)
    hertz = loop.frequencies_hz[inside]
    found = margins(hertz, loop.values[inside]) if len(hertz) > 1 else None
    return AxisMargins(
        gains=which,
        axis=response.axis + 1,
        phase_margin_deg=found.phase_margin_deg if found else None,
        crossover_hz=found.crossover_hz if found else None,
        gain_margin_db=found.gain_margin_db if found else None,
        gain_margin_hz=found.gain_margin_hz if found else None,
        band_low_hz=float(hertz[0]) if len(hertz) else None,
        band_high_hz=float(hertz[-1]) if len(hertz) else None,
    )


def _worse(before: Least, after: Least, targets: Targets) -> str:
    """Return why the margins after a change are not acceptable; empty if they are."""
    if not after.stable[0]:
        return 'with the applied gains a loop is not stable somewhere in the workspace'
    for name, value, old, target, short, unit in (
        ('phase', after.phase_deg[0], before.phase_deg[0], targets.phase_deg, SHORT_DEG, 'deg'),
        ('gain', after.gain_db[0], before.gain_db[0], targets.gain_db, SHORT_DB, 'dB'),
    ):
        if value < target - short and value < old:
            return (
                f'with the applied gains the {name} margin is {value:.1f} {unit}, less than {old:.1f} {unit} before '
                f'and more than {short:g} {unit} below the required {target:g} {unit}'
            )
    return ''
