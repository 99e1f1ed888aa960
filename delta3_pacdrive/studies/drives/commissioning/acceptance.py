"""Acceptance of a running robot: checks with values and limits, figures, and a protocol as HTML and JSON."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from typing import Annotated, Any, Protocol

import numpy as np

from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.drive.operation_data import OF_PARAMETER, TABLE
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.service_channel import format_idn
from delta3_pacdrive.studies.drives.commissioning import figures
from delta3_pacdrive.studies.drives.commissioning.robot import ProgramRun, RestRecord, RunningRobot
from delta3_pacdrive.studies.drives.commissioning.run import BEFORE, measure, with_actual_gains
from delta3_pacdrive.studies.drives.commissioning.study import Measurement
from delta3_pacdrive.studies.framework import study as studies
from delta3_pacdrive.studies.framework.columns import Column, TextColumn, csv_table, text_table, to_dict
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder

SAME = 1e-9  # relative difference of a parameter in a drive from the file
INERTIA_SHARE, FRICTION_SHARE = 0.1, 0.25  # largest deviation from the model
BRAKE_RAD = 0.02  # largest motion of a shaft under its brake
NOISE_INCREMENTS = 8.0  # largest range of the encoder at rest under the brake


@dataclass(frozen=True)
class Settings:
    """Settings of an acceptance: test program and limits that depend on the application."""

    parameters: Parameters  # expected in the drives
    source: str | None  # file of them; None: packaged
    program: str = 'packaging'
    phase_margin_deg: float = 30.0
    gain_margin_db: float = 6.0
    tcp_error_m: float = 1e-3


class AcceptanceRobot(RunningRobot, Protocol):
    """A running robot with the motions of an acceptance; they raise ProgramError or RunError."""

    def run_program(self, program: str) -> ProgramRun:
        """Move to the start of a program, execute it, and return its figures."""

    def rest(self) -> RestRecord:
        """Disable the drives, record their encoders under the brakes, and enable them again."""

    def bus(self) -> dict[str, float]:
        """Return statistics of the bus: lost telegrams, cycles, and largest lateness of a cycle [s]."""


@dataclass(frozen=True)
class Check:
    """A checked value with its limit."""

    group: Annotated[str, Column('group')]
    name: Annotated[str, Column('check')]
    value: Annotated[float | None, Column('value')]
    unit: Annotated[str, Column('unit')]
    limit: Annotated[str, Column('limit')]
    passed: Annotated[bool, Column('passed')]

    @staticmethod
    def at_most(group: str, name: str, value: float | None, unit: str, limit: float) -> 'Check':
        """Return the check of a value with an upper limit."""
        passed = value is not None and abs(value) <= limit
        return Check(group, name, value, unit, f'at most {limit:g}', passed)

    @staticmethod
    def at_least(group: str, name: str, value: float | None, unit: str, limit: float) -> 'Check':
        """Return the check of a value with a lower limit."""
        return Check(group, name, value, unit, f'at least {limit:g}', value is not None and value >= limit)


@dataclass
class Study(studies.Study):
    """Acceptance in a report folder; ``connect`` opens the robot, whose motion is then exclusive."""

    settings: Settings
    connect: Callable[[], AbstractContextManager[AcceptanceRobot]]

    def run(self) -> dict[str, Any]:
        """Check the robot and write the protocol; return the summary. Raises Delta3Error."""
        chosen = self.settings
        with self.connect() as robot:
            self.on_progress('parameters of the drives', 0, 0)
            checks = list(_parameters(robot, chosen.parameters))
            own = with_actual_gains(robot)
            folder = ReportFolder(self.folder, Provenance.of(self.command, own, chosen.source))
            folder.make()
            measured, mechanics = measure(robot, own, self.on_progress)
            self.on_progress(f'program {chosen.program}', 0, 0)
            ran = robot.run_program(chosen.program)
            self.on_progress('encoders and brakes', 0, 0)
            resting = robot.rest()
            checks += [
                *_loops(measured, chosen),
                *_mechanics(mechanics, own),
                *_program(ran, own, chosen),
                *_rest(resting, own),
                *_drives(robot),
                *_bus(robot.bus(), own),
            ]
        passed = all(check.passed for check in checks)
        document = {
            'passed': passed,
            'date': datetime.now(UTC).isoformat(timespec='seconds'),
            'program': chosen.program,
            'checks': [to_dict(check) for check in checks],
        }
        drawings = {
            'loop.png': partial(figures.loop, BEFORE, measured),
            'inertia.png': partial(figures.inertia, measured, mechanics),
            'following_error.png': partial(figures.following_error, ran, chosen.program),
        }
        return folder.results(
            'Acceptance protocol', document, text(document), [csv_table('checks.csv', checks)], drawings
        )


def _parameters(robot: RunningRobot, expected: Parameters) -> Iterator[Check]:
    for axis in DRIVES:
        for source, idn in OF_PARAMETER.items():
            group, _, name = source.partition('.')
            wanted = float(getattr(getattr(expected, group), name))
            value, row = robot.channel.read(axis, format_idn(idn)), TABLE[idn]
            same = abs(value - wanted) <= SAME * max(abs(wanted), abs(value))
            yield Check(
                'parameters', f'{axis} {format_idn(idn)} {row.name}', value, row.unit, f'{wanted:.12g}', same
            )


def _loops(measured: Measurement, chosen: Settings) -> Iterator[Check]:
    for one in measured.margins:
        axis = f'axis{one.axis}'
        yield Check.at_least(
            'loops', f'{axis} phase margin', one.phase_margin_deg, 'deg', chosen.phase_margin_deg
        )
        yield Check.at_least('loops', f'{axis} gain margin', one.gain_margin_db, 'dB', chosen.gain_margin_db)


def _mechanics(mechanics: Sequence[Any], own: Parameters) -> Iterator[Check]:
    friction = own.motor.static_friction_n_m
    for one in mechanics:
        axis = DRIVES[one.axis]
        for name, value, model, share in (
            ('inertia', one.inertia_kg_m2.value, one.model_inertia_kg_m2, INERTIA_SHARE),
            ('Coulomb friction', one.static_friction_n_m.value, friction, FRICTION_SHARE),
        ):
            deviation = 100.0 * (value / model - 1.0) if model else None
            yield Check.at_most(
                'mechanics', f'{axis} {name}, deviation from the model', deviation, '%', 100.0 * share
            )


def _program(ran: ProgramRun, own: Parameters, chosen: Settings) -> Iterator[Check]:
    found, motor = ran.figures, own.motor
    yield Check.at_most(
        'program', 'TCP error', 1e3 * found['tcp_error_max_m'], 'mm', 1e3 * chosen.tcp_error_m
    )
    for number, axis in enumerate(DRIVES):
        worst = float(np.abs(ran.following_error_rad[:, number]).max(initial=0.0))
        limit = own.drive.following_error_limit_rad
        yield Check.at_most('program', f'{axis} following error, motor side', worst, 'rad', limit)
        for name, key, most in (
            ('peak current', 'current_peak_a', motor.peak_current_a),
            ('effective current', 'current_rms_a', motor.nominal_current_a),
        ):
            yield Check.at_most('program', f'{axis} {name}', found[key][number], 'A', most)


def _rest(resting: RestRecord, own: Parameters) -> Iterator[Check]:
    per_rad = own.bus.increments_per_rev / (2.0 * np.pi)
    for number, axis in enumerate(DRIVES):
        noise = float(per_rad * np.ptp(resting.position_rad[:, number]))
        yield Check.at_most('rest', f'{axis} range of the encoder', noise, 'increments', NOISE_INCREMENTS)
        yield Check.at_most(
            'rest', f'{axis} motion under its brake', resting.moved_rad[number], 'rad', BRAKE_RAD
        )


def _drives(robot: RunningRobot) -> Iterator[Check]:
    for axis in DRIVES:
        for name, idn, unit, limit in (
            ('diagnostic number', 'S-0-0390', '1', 0.0),
            ('lost MDT', 'S-0-0029', '1', 0.0),
            ('motor temperature', 'S-0-0383', 'degC', robot.channel.read(axis, 'S-0-0201')),
            ('amplifier temperature', 'S-0-0384', 'degC', robot.channel.read(axis, 'S-0-0200')),
        ):
            yield Check.at_most('drives', f'{axis} {name} {idn}', robot.channel.read(axis, idn), unit, limit)


def _bus(found: dict[str, float], own: Parameters) -> Iterator[Check]:
    yield Check.at_most('bus', 'lost telegrams', found['lost_telegrams'], '1', 0.0)
    latest = own.bus.outstanding_cycles_max * own.bus.cycle_time_s
    yield Check.at_most('bus', 'largest lateness of a cycle', 1e3 * found['lateness_s'], 'ms', 1e3 * latest)


def text(document: dict[str, Any]) -> list[str]:
    """Return the protocol as lines of text: parameters only if they differ."""
    checks = document['checks']
    parameters = [one for one in checks if one['group'] == 'parameters']
    shown = [one for one in checks if one['group'] != 'parameters' or not one['passed']]
    failed = sum(not one['passed'] for one in checks)
    same = sum(one['passed'] for one in parameters)
    return [
        f'ACCEPTED: {len(checks)} checks'
        if document['passed']
        else f'NOT ACCEPTED: {failed} of {len(checks)} checks failed',
        f'{document["date"]}, test program {document["program"]}',
        '',
        f'{same} of {len(parameters)} parameters in the drives are those of the file',
        *text_table(
            shown,
            [
                TextColumn('', lambda one: '' if one['passed'] else 'FAILED', '<'),
                TextColumn('check', '{name}', '<'),
                TextColumn('value', '{value:.4g}'),
                TextColumn('unit', '{unit}', '<'),
                TextColumn('limit', '{limit}', '<'),
            ],
        ),
        '',
    ]
