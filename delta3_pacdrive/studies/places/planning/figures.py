"""Figures of a plan: virtual master and slaves, position and velocity path, support points (Fig. 6.2 to 6.4)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.temperature import continuous_torque
from delta3_pacdrive.studies.framework.figure_style import (
    AXIS_COLOURS,
    COLOURS,
    DASHED,
    MUTED,
    NORM_COLOUR,
    WHOLE,
    column_of_panels,
    dress,
    figure_of_program,
    frame_path,
    keep_span,
    legend_above,
    panel_title,
    path_axes,
)
from delta3_pacdrive.studies.framework.report_folder import Drawings
from delta3_pacdrive.studies.places.planning.evaluation import QUANTITIES
from delta3_pacdrive.studies.places.planning.study import PlanStudy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM, RPM = 1e3, 60.0 / (2.0 * np.pi)
INK = '#222222'
LINE: dict[str, Any] = {'linewidth': 1.6, 'solid_capstyle': 'round'}
LIMIT: dict[str, Any] = {'color': MUTED, 'linewidth': 0.9, 'linestyle': DASHED}
SPEED_MAP = 'viridis'
CURVE_SAMPLES = 200  # of the S1 curve
MARKED = 0.4  # share of the longest move: instant marked in master and slaves
MOVES_MARKED = 40  # maximum number of moves with marked boundaries
QUANTITY_COLOURS = dict(
    zip(
        QUANTITIES,
        (
            *COLOURS[:4],
            '#F0A030',
            COLOURS[5],
            NORM_COLOUR,
            '#3A3A3A',
            '#C2185B',
            '#FB9A99',
            '#A6A000',
            '#17BECF',
            '#8C564B',
            '#CFCFCF',
            '#5B8C5A',
        ),
        strict=True,
    )
)


def by_name(found: PlanStudy, parameters: Parameters) -> Drawings:
    """Return the drawing functions of the figures by file name."""
    return {
        'virtual_master.png': partial(virtual_master, found),
        'position_and_velocity.png': partial(position_and_velocity, found),
        'path_points.png': partial(path_points, found),
        'over_path.png': partial(over_path, found),
        'motors.png': partial(motors, found, parameters),
        'limits.png': partial(limits, found),
        'continuous_torque.png': partial(continuous, found, parameters),
    }


def virtual_master(found: PlanStudy) -> Figure:
    """Draw the virtual master (distance over time) and the slaves x, y, z over the distance (Fig. 6.2)."""
    s = found.samples
    figure = figure_of_program('Virtual master and slaves', found.planned.name, 6.6)
    grid = figure.add_gridspec(4, 2, width_ratios=(1.0, 1.0))
    master = figure.add_subplot(grid[:, 0])
    slaves = [figure.add_subplot(grid[0, 1])]
    slaves += [figure.add_subplot(grid[n, 1], sharex=slaves[0]) for n in (1, 2)]
    speed = figure.add_subplot(grid[3, 1], sharex=slaves[0])
    longest = max(found.rows, key=lambda row: row.length_m)
    marked = int(np.searchsorted(s.time_s, longest.start_s + MARKED * longest.duration_s))
    time, distance = float(s.time_s[marked]), MM * float(s.distance_m[marked])
    master.plot(s.time_s, MM * s.distance_m, color=INK, **LINE)
    master.plot([time, time, s.time_s[-1]], [0.0, distance, distance], **LIMIT)
    master.plot(time, distance, 'o', color=NORM_COLOUR, markersize=7, zorder=5)
    panel_title(master, 'master: distance s of the TCP motion')
    master.set(xlabel='time from program start [s]', ylabel='s [mm]', xlim=(s.time_s[0], s.time_s[-1]))
    master.set_ylim(bottom=0.0)
    for n, axes in enumerate(slaves):
        values = MM * s.position_m[:, n]
        axes.plot(MM * s.distance_m, values, color=AXIS_COLOURS[n], **LINE)
        axes.axvline(distance, **LIMIT)
        axes.plot(distance, values[marked], 'o', color=NORM_COLOUR, markersize=6, zorder=5)
        axes.set_ylabel(f'{"xyz"[n]} [mm]')
        keep_span([axes], 1.0)
    panel_title(slaves[0], 'slaves: position over the distance')
    speed.plot(MM * s.distance_m, s.speed_m_s, color=INK, **LINE)
    speed.axvline(distance, **LIMIT)
    speed.set(ylabel='speed [m/s]', xlabel='s [mm]', xlim=(0.0, max(MM * s.distance_m[-1], 1e-3)))
    for axes in (master, *slaves, speed):
        dress(axes)
        axes.ticklabel_format(useOffset=False)
    for axes in slaves:
        axes.tick_params(labelbottom=False)
    figure.align_ylabels([*slaves, speed])
    return figure


def position_and_velocity(found: PlanStudy) -> Figure:
    """Draw distance, speed, acceleration and jerk of the TCP over time (Fig. 6.3)."""
    s = found.samples
    figure = figure_of_program('Position and velocity path', found.planned.name, 7.2)
    labels = ['distance [mm]', 'speed [m/s]', 'acceleration [m/s$^2$]', 'jerk [m/s$^3$]']
    panels = column_of_panels(figure, labels)
    _mark_moves(found, panels)
    panels[0].plot(s.time_s, MM * s.distance_m, color=INK, **LINE)
    panels[1].plot(s.time_s, s.tcp_speed_m_s, color=AXIS_COLOURS[0], **LINE)
    panels[1].plot(s.time_s, s.speed_limit_m_s, **LIMIT)
    pairs = (
        (panels[2], s.acceleration_m_s2, s.tcp_acceleration_m_s2, s.acceleration_limit_m_s2),
        (panels[3], s.jerk_m_s3, s.tcp_jerk_m_s3, s.jerk_limit_m_s3),
    )
    for axes, along, norm, limit in pairs:
        axes.plot(s.time_s, norm, color=COLOURS[5], linewidth=2.4, label='norm in space')
        axes.plot(s.time_s, along, color=AXIS_COLOURS[0], linewidth=1.2, label='along the path')
        axes.plot(s.time_s, limit, label='limit of the program', **LIMIT)
        axes.plot(s.time_s, -limit, **LIMIT)
    _legend_below(figure, panels[2])
    return figure


def path_points(found: PlanStudy) -> Figure:
    """Draw the path in space, coloured by the TCP speed, with the ends of its polynomials (Fig. 6.4)."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    s = found.samples
    figure = figure_of_program('Points of the path', found.planned.name, 6.2)
    axes = path_axes(figure, 0.08, 0.86)
    axes.set_position((-0.05, 0.08, 1.0, 0.86))  # leaves room for the labels of z
    points = MM * s.position_m
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    norm = Normalize(0.0, max(float(s.tcp_speed_m_s.max()), 1e-9))
    lines = Line3DCollection(pieces, cmap=SPEED_MAP, norm=norm, linewidth=2.6, **WHOLE)
    lines.set_array(0.5 * (s.tcp_speed_m_s[1:] + s.tcp_speed_m_s[:-1]))
    axes.add_collection3d(lines, autolim=False)
    joints = MM * _joints(found)
    axes.plot(*joints.T, 'o', markersize=3.4, markerfacecolor='white', markeredgecolor=INK, markeredgewidth=0.8,
              linestyle='none', label='points of the path', **WHOLE)  # fmt: skip
    ends: dict[str, Any] = {'linestyle': 'none', 'markerfacecolor': 'none', 'markeredgewidth': 1.6, **WHOLE}
    axes.plot(*points[:1].T, 'o', color=AXIS_COLOURS[2], markersize=11, label='start', **ends)
    axes.plot(*points[-1:].T, 'x', color=AXIS_COLOURS[1], markersize=7, label='end', **ends)
    frame_path(axes, points)
    figure.legend(loc='lower left', bbox_to_anchor=(0.02, 0.01), ncols=3, frameon=False, fontsize=9)
    below = figure.add_axes((0.66, 0.065, 0.3, 0.022))
    bar = figure.colorbar(ScalarMappable(norm, SPEED_MAP), cax=below, orientation='horizontal')
    bar.set_label('TCP speed [m/s]', fontsize=9)
    bar.ax.tick_params(labelsize=8)
    return figure


def _joints(found: PlanStudy) -> Floats:
    """Return the ends of the polynomials of the path [m], shape (n, 3)."""
    plan = found.planned.plan
    order = plan.tables.order[: len(found.rows)]
    points = []
    for number in dict.fromkeys(order.tolist()):
        move = plan.moves[number]
        ends = np.append(move.segments[:, 0], move.length_m)
        points.append(move.sample(np.unique(ends.clip(0.0, move.length_m)))[:, 0])
    return np.concatenate(points)


def over_path(found: PlanStudy) -> Figure:
    """Draw speed, acceleration, jerk and curvature over the distance along the path."""
    s = found.samples
    distance = MM * s.distance_m
    figure = figure_of_program('Over the path', found.planned.name, 7.2)
    labels = ['TCP speed [m/s]', 'TCP acceleration\n[m/s$^2$]', 'TCP jerk [m/s$^3$]', 'curvature [1/m]']
    panels = column_of_panels(figure, labels, 'distance along the path [mm]')
    for row in found.rows[1:] if len(found.rows) <= MOVES_MARKED else ():
        begin = MM * float(s.distance_m[np.searchsorted(s.move, row.number)])
        for axes in panels:
            axes.axvline(begin, color='#E6E6E6', linewidth=1.0, zorder=0)
    values = (
        (s.tcp_speed_m_s, s.speed_limit_m_s),
        (s.tcp_acceleration_m_s2, s.acceleration_limit_m_s2),
        (s.tcp_jerk_m_s3, s.jerk_limit_m_s3),
    )
    for axes, (value, limit) in zip(panels, values, strict=False):
        axes.plot(distance, value, color=AXIS_COLOURS[0], **LINE)
        axes.plot(distance, limit, **LIMIT)
        axes.set_ylim(bottom=0.0)
    panels[3].plot(distance, s.curvature_1_m, color=NORM_COLOUR, **LINE)
    keep_span([panels[3]], 0.1)
    return figure


def motors(found: PlanStudy, parameters: Parameters) -> Figure:
    """Draw arm angles, motor speeds, motor torques including friction, and gear torques, with their limits."""
    s, motor, gear, k = found.samples, parameters.motor, parameters.gear, parameters.kinematics
    figure = figure_of_program('Arms and motors', found.planned.name, 8.6)
    names = ['arm angle [deg]', 'motor speed [rpm]', 'motor torque [N m]', 'gear torque [N m]']
    panels = column_of_panels(figure, names)
    _mark_moves(found, panels)
    peak = motor.torque_constant_n_m_a * motor.peak_current_a
    nominal = motor.torque_constant_n_m_a * motor.nominal_current_a
    rows = (
        (np.degrees(s.arm_angle_rad), (k.arm_angle_min_deg, k.arm_angle_max_deg)),
        (RPM * s.motor_speed_rad_s, (-motor.max_speed_rpm, motor.max_speed_rpm)),
        (s.motor_torque_n_m, (-peak, peak)),
        (s.gear_torque_n_m, (-gear.acceleration_torque_n_m, gear.acceleration_torque_n_m)),
    )
    for axes, (values, bounds) in zip(panels, rows, strict=True):
        for i, colour in enumerate(AXIS_COLOURS):
            # axis 2 is wide: axis 3 may cover it
            width = 3.4 if i == 1 else 1.5
            axes.plot(s.time_s, values[:, i], color=colour, label=f'axis {i + 1}', linewidth=width)
        _bounds(axes, values, bounds, LIMIT)
    _bounds(panels[2], s.motor_torque_n_m, (-nominal, nominal), LIMIT | {'linestyle': (0, (1, 2))})
    legend_above(panels[0])
    panel_title(
        panels[2], 'dashed: limit (peak current), dotted: nominal current, where they are near', color=MUTED
    )
    panel_title(panels[3], 'at the output; dashed: acceleration torque', color=MUTED)
    return figure


def continuous(found: PlanStudy, parameters: Parameters) -> Figure:
    """Draw the S1 curve over the speed, and rms torque and speed of each motor in the first round."""
    s, motor = found.samples, parameters.motor
    figure = figure_of_program('Continuous torque', found.planned.name, 4.6)
    axes = figure.add_subplot(xlabel='motor speed [rpm]', ylabel='motor torque [N m]')
    speed = np.linspace(0.0, motor.max_speed_rad_s, CURVE_SAMPLES)
    axes.plot(
        RPM * speed,
        continuous_torque(speed, parameters),
        color=INK,
        label=f'S1 at {parameters.thermal.ambient_degc:g} degC',
        **LINE,
    )
    steps = np.gradient(s.time_s)
    for i, colour in enumerate(AXIS_COLOURS):
        rpm, torque = RPM * np.abs(s.motor_speed_rad_s[:, i]), np.abs(s.motor_torque_n_m[:, i])
        axes.plot(rpm, torque, '.', color=colour, markersize=1.5, alpha=0.4)
        mean = [np.sqrt(np.average(one**2, weights=steps)) for one in (rpm, torque)]
        axes.plot(*mean, 'o', color=colour, markeredgecolor='white', label=f'axis {i + 1}, rms')
    keep_span([axes], 0.1)
    axes.set_ylim(bottom=0.0)
    axes.legend(loc='upper right')
    return figure


def _bounds(axes: Axes, values: Floats, bounds: tuple[float, float], style: dict[str, Any]) -> None:
    """Draw those limits that are less than twice the largest value."""
    reach = 2.0 * float(np.abs(values).max())
    for bound in bounds:
        if abs(bound) <= reach:
            axes.axhline(bound, **style)


def limits(found: PlanStudy) -> Figure:
    """Draw the used share of each limit, and the leading limit."""
    from matplotlib.patches import Patch

    s = found.samples
    figure = figure_of_program('What limits the plan', found.planned.name, 5.6)
    upper, lower = column_of_panels(figure, ['share of the limit [%]', ''], height_ratios=(6, 1))
    _mark_moves(found, [upper])
    for quantity, values in s.used.items():
        if values.max() > 0.0:
            upper.plot(s.time_s, 100.0 * values, color=QUANTITY_COLOURS[quantity], linewidth=1.3)
    upper.axhline(100.0, **LIMIT)
    changes = np.flatnonzero(np.diff(s.leading)) + 1
    edges = np.concatenate([[0], changes, [len(s.leading) - 1]])
    for begin, end in pairwise(edges.tolist()):
        quantity = QUANTITIES[int(s.leading[begin])]
        lower.axvspan(s.time_s[begin], s.time_s[end], color=QUANTITY_COLOURS[quantity], linewidth=0.0)
    upper.set_ylim(0.0, 108.0)
    lower.set_yticks([])
    lower.grid(visible=False)
    panel_title(lower, 'the first limit that a faster plan would break')
    shown = [
        quantity
        for n, quantity in enumerate(QUANTITIES)
        if (s.leading == n).any() or (quantity in s.used and s.used[quantity].max() > 0.0)
    ]
    figure.legend(
        handles=[Patch(color=QUANTITY_COLOURS[quantity], label=quantity.value) for quantity in shown],
        loc='outside lower center',
        ncols=5,
        frameon=False,
        fontsize=9,
    )
    return figure


def _mark_moves(found: PlanStudy, panels: Sequence[Axes]) -> None:
    """Shade every other move unless there are too many."""
    if len(found.rows) > MOVES_MARKED:
        return
    for row in found.rows[1::2]:
        for axes in panels:
            axes.axvspan(row.start_s, row.start_s + row.duration_s, color='#F3F3F3', linewidth=0.0, zorder=0)


def _legend_below(figure: Figure, axes: Axes) -> None:
    figure.legend(
        *axes.get_legend_handles_labels(), loc='outside lower center', ncols=4, frameon=False, fontsize=9
    )
