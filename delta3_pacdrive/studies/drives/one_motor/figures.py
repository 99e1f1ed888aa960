"""Figures 8.2 to 8.4 of the thesis, with signals instead of block diagrams."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.studies.framework.figure_style import (
    AXIS_COLOURS,
    COLOURS,
    column_of_panels,
    panel_title,
    titled_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from delta3_pacdrive.studies.drives.one_motor.study import SingleRun
    from delta3_pacdrive.studies.framework.report_folder import Drawings

BLACK: dict[str, Any] = {'color': '#111111', 'linewidth': 1.0}
THIN: dict[str, Any] = {'linewidth': 1.0}


def by_name(found: SingleRun) -> Drawings:
    """Return the drawing function of each figure by file name."""
    return {
        'figure_8_2_motor_and_drive.png': partial(motor_and_drive, found),
        'figure_8_3_phase_currents.png': partial(phase_currents, found),
        'figure_8_4_torques.png': partial(torques, found),
    }


def _legend(axes: Axes, columns: int = 1) -> None:
    axes.legend(loc='best', frameon=False, fontsize=8, ncols=columns)


def motor_and_drive(found: SingleRun) -> Figure:
    """Figure 8.2: shaft position at bus, MC-4 and motor, with speed and current."""
    figure = titled_figure(
        f'Figure 8.2: one MC-4, one motor: {found.program}, arm {found.axis}', 7.0, parse_math=False
    )
    labels = ('position [rad]', 'deviation [mrad]', 'speed [rad/s]', 'current [A]')
    position, error, speed, current = column_of_panels(figure, labels)
    rows = found.driven
    time = found.time_s[rows]
    position.step(time, found.command[rows], where='post', label='command on the bus', **BLACK)
    position.plot(time, found.position[rows], label='shaft', color=AXIS_COLOURS[0], **THIN)
    error.plot(
        time, 1e3 * found.position_error[rows], label='set point less shaft', color=AXIS_COLOURS[0], **THIN
    )
    apart = found.in_robot[rows] - found.position[rows]
    error.plot(time, 1e3 * apart, label='shaft in the robot less this one', color=AXIS_COLOURS[1], **THIN)
    speed.plot(time, found.speed_reference[rows], label='reference', **BLACK)
    speed.plot(time, found.speed[rows], label='shaft', color=AXIS_COLOURS[0], **THIN)
    current.plot(time, found.current_reference[rows], label='reference', **BLACK)
    current.plot(time, found.current[rows], label='$I_{eff}$', color=AXIS_COLOURS[0], **THIN)
    for axes in (position, error, speed, current):
        _legend(axes, 2)
    return figure


def phase_currents(found: SingleRun) -> Figure:
    """Figure 8.3: currents of the three phases, and the effective current."""
    figure = titled_figure(
        f'Figure 8.3: currents of the motor: {found.program}, arm {found.axis}', 5.6, parse_math=False
    )
    phases, effective, voltage = column_of_panels(figure, ('current [A]', 'current [A rms]', 'voltage [V]'))
    rows = found.driven
    time = found.time_s[rows]
    for n, colour in enumerate(AXIS_COLOURS):
        phases.plot(time, found.phase_currents[rows, n], label=f'$I_{{{n + 1}s}}$', color=colour, **THIN)
    effective.plot(time, found.current[rows], label='$I_{eff}$', **BLACK)
    voltage.plot(time, found.voltage[rows], label='of a phase, rms', color=COLOURS[4], **THIN)
    for axes in (phases, effective, voltage):
        _legend(axes, 3)
    return figure


def torques(found: SingleRun) -> Figure:
    """Figure 8.4: torque of the motor less friction, load and coupling accelerates the shaft."""
    figure = titled_figure(
        f'Figure 8.4: motor with the coupling as input: {found.program}, arm {found.axis}',
        5.6,
        parse_math=False,
    )
    all_torques, shaft = column_of_panels(figure, ('torque [N m]', 'torque [N m]'))
    rows = found.driven
    time = found.time_s[rows]
    parts = (
        ('$K_m I_{eff}$', found.torque),
        ('friction', found.friction),
        (r'$\tau_{load} / k_r$', found.load),
        ('CE d', found.coupling),
    )
    for (label, values), colour in zip(parts, COLOURS, strict=False):
        all_torques.plot(time, values[rows], label=label, color=colour, **THIN)
    rest = found.torque - found.friction - found.load - found.coupling
    shaft.plot(time, rest[rows], label='remainder', **BLACK)
    inertial = found.inertia_kg_m2 * found.acceleration[rows]
    shaft.plot(time, inertial, label='inertia times acceleration', color=COLOURS[5], linewidth=0.8)
    for axes in (all_torques, shaft):
        _legend(axes, 2)
    panel_title(shaft, f'shaft and load: {1e4 * found.inertia_kg_m2:.3f} kg cm2', parse_math=False)
    return figure
