"""The signal chain from the plan to the arms, with the rate of every part, as the parameters have them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

import delta3_pacdrive as d3
from delta3_pacdrive.studies.framework.figure_style import AXIS_COLOURS, DPI

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BLUE, ORANGE, GREEN = AXIS_COLOURS
INK, MUTED = '#222222', '#666666'
HEIGHT = 0.62
TASK_Y, LOOP_Y, OBSERVER_Y, PLANT_Y = 5.55, 3.55, 2.25, 0.75
BUS_Y, FORWARD_Y = 4.65, 4.15
MASTER_X, KINEMATICS_X, ERROR_X = 3.6, 6.1, 8.75
INTERPOLATION_X, POSITION_X, VELOCITY_X, FILTER_X, CURRENT_X, WINDING_X = 1.1, 2.73, 4.36, 5.99, 7.62, 9.1
LOOP_WIDTH = 1.2
OBSERVER_X, GEAR_X, ARMS_X = 4.1, 7.6, 4.1
LEFT_X, RIGHT_X = 0.3, 9.78


def make() -> Figure:
    """Draw the chain."""
    robot = d3.load_parameters()
    bus, drive = robot.bus, robot.drive
    figure = Figure(figsize=(8.0, 5.0), dpi=DPI, facecolor='white')
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, 10.0), ylim=(0.1, 6.35))
    axes.axis('off')
    frame(axes, 5.0, 6.25, 'PacDrive controller', BLUE)
    frame(axes, 1.7, 4.85, 'MC-4, one for each axis', ORANGE)
    frame(axes, 0.2, 1.55, 'plant', GREEN)

    box(axes, 1.15, TASK_Y, 1.6, 'UnitRobot', 'plans a program')
    box(axes, MASTER_X, TASK_Y, 1.7, 'virtual master', ms(bus.cycle_time_s))
    box(axes, KINEMATICS_X, TASK_Y, 1.8, 'inverse kinematics', ms(bus.cycle_time_s))
    box(axes, ERROR_X, TASK_Y, 1.7, 'following error', ms(bus.cycle_time_s))
    arrow(axes, [(1.95, TASK_Y), (MASTER_X - 0.85, TASK_Y)], 'plan')
    arrow(axes, [(MASTER_X + 0.85, TASK_Y), (KINEMATICS_X - 0.9, TASK_Y)], 'x, y, z')
    arrow(axes, [(KINEMATICS_X + 0.9, TASK_Y), (ERROR_X - 0.85, TASK_Y)], '')
    arrow(axes, [(KINEMATICS_X, TASK_Y - HEIGHT / 2), (KINEMATICS_X, BUS_Y), (LEFT_X - 0.08, BUS_Y),
                 (LEFT_X - 0.08, LOOP_Y), (INTERPOLATION_X - LOOP_WIDTH / 2, LOOP_Y)], '')  # fmt: skip
    text(axes, 3.0, BUS_Y + 0.03, f'SERCOS: MDT, {ms(bus.cycle_time_s)}')

    loops = [
        (INTERPOLATION_X, 'interpolation', drive.position_period_s),
        (POSITION_X, 'position P', drive.position_period_s),
        (VELOCITY_X, 'velocity PI', drive.velocity_period_s),
        (FILTER_X, 'notches, limit', drive.velocity_period_s),
        (CURRENT_X, 'current PI', drive.current_period_s),
        (WINDING_X, 'winding', drive.current_period_s),
    ]
    for x, name, period_s in loops:
        box(axes, x, LOOP_Y, LOOP_WIDTH, name, us(period_s))
    signals = (r'$\theta_m^*$', r'$\omega^*$', '', '$I^*$', '$U$')
    for (left, *_), (right, *_), symbol in zip(loops[:-1], loops[1:], signals, strict=True):
        arrow(axes, [(left + LOOP_WIDTH / 2, LOOP_Y), (right - LOOP_WIDTH / 2, LOOP_Y)], symbol)
    for x, name in ((VELOCITY_X, 'FF_vel'), (FILTER_X, 'FF_curr or S-0-0081')):
        arrow(axes, [(INTERPOLATION_X, LOOP_Y + HEIGHT / 2), (INTERPOLATION_X, FORWARD_Y), (x, FORWARD_Y),
                     (x, LOOP_Y + HEIGHT / 2)], '', MUTED)  # fmt: skip
        text(axes, x - 0.82, FORWARD_Y + 0.02, name, MUTED)
    under = LOOP_Y - HEIGHT / 2 - 0.22
    arrow(axes, [(WINDING_X, LOOP_Y - HEIGHT / 2), (WINDING_X, under), (CURRENT_X, under),
                 (CURRENT_X, LOOP_Y - HEIGHT / 2)], '', MUTED)  # fmt: skip

    box(axes, OBSERVER_X, OBSERVER_Y, 3.0, 'encoder and shaft observer', us(drive.current_period_s))
    for x, symbol in ((POSITION_X, r'$\theta_m$'), (VELOCITY_X, r'$\omega$')):
        arrow(axes, [(x, OBSERVER_Y + HEIGHT / 2), (x, LOOP_Y - HEIGHT / 2)], '', MUTED)
        text(axes, x + 0.18, 2.8, symbol)
    arrow(axes, [(OBSERVER_X - 1.5, OBSERVER_Y), (LEFT_X + 0.1, OBSERVER_Y), (LEFT_X + 0.1, 5.05), (ERROR_X, 5.05),
                 (ERROR_X, TASK_Y - HEIGHT / 2)], '')  # fmt: skip
    text(axes, 1.45, OBSERVER_Y + 0.03, f'AT, {ms(bus.cycle_time_s)}')

    box(axes, GEAR_X, PLANT_Y, 2.0, '$K_m$, friction, brake, gear', us(drive.current_period_s))
    box(axes, ARMS_X, PLANT_Y, 2.2, 'three coupled arms', us(drive.current_period_s))
    arrow(
        axes,
        [
            (WINDING_X + LOOP_WIDTH / 2, LOOP_Y),
            (RIGHT_X, LOOP_Y),
            (RIGHT_X, PLANT_Y),
            (GEAR_X + 1.0, PLANT_Y),
        ],
        '',
    )
    text(axes, 8.95, 1.85, f'$I_{{eff}}$, 16 in {ms(bus.exchange_period_s)}')
    arrow(axes, [(GEAR_X - 1.0, PLANT_Y), (ARMS_X + 1.1, PLANT_Y)], r'$\tau$')
    arrow(axes, [(ARMS_X, PLANT_Y + HEIGHT / 2), (ARMS_X, OBSERVER_Y - HEIGHT / 2)], '')
    text(axes, 4.72, 1.22, f'shafts, {ms(bus.exchange_period_s)}')
    return figure


def ms(seconds: float) -> str:
    """Return a period in milliseconds."""
    return f'{1e3 * seconds:g} ms'


def us(seconds: float) -> str:
    """Return a period in microseconds."""
    return f'{1e6 * seconds:g} us'


def frame(axes: Axes, bottom: float, top: float, name: str, colour: str) -> None:
    """Draw what belongs together."""
    axes.add_patch(FancyBboxPatch((0.1, bottom), 9.8, top - bottom, 'round,pad=0,rounding_size=0.08',
                                  facecolor=colour, alpha=0.08, edgecolor='none'))  # fmt: skip
    axes.text(9.8, top - 0.08, name, fontsize=10, color=colour, ha='right', va='top', weight='bold')


def box(axes: Axes, x: float, y: float, width: float, name: str, below: str) -> None:
    """Draw one part with its name and its period."""
    axes.add_patch(FancyBboxPatch((x - width / 2, y - HEIGHT / 2), width, HEIGHT,
                                  'round,pad=0,rounding_size=0.06', facecolor='white', edgecolor=INK,
                                  linewidth=1.0, zorder=3))  # fmt: skip
    axes.text(x, y + 0.12, name, fontsize=9, color=INK, ha='center', va='center', zorder=4)
    axes.text(x, y - 0.15, below, fontsize=8, color=MUTED, ha='center', va='center', zorder=4)


def text(axes: Axes, x: float, y: float, words: str, colour: str = INK) -> None:
    """Write above a line."""
    axes.text(x, y, words, fontsize=8.5, color=colour, ha='center', va='bottom', zorder=4)


def arrow(axes: Axes, points: list[tuple[float, float]], name: str, colour: str = INK) -> None:
    """Draw a line with corners that ends in an arrow, and what goes along it above its first part."""
    axes.plot(*zip(*points[:-1], strict=True), color=colour, linewidth=1.0, solid_joinstyle='miter', zorder=2)
    style = {'arrowstyle': '-|>', 'color': colour, 'linewidth': 1.0, 'shrinkA': 0, 'shrinkB': 0}
    axes.annotate('', points[-1], points[-2], arrowprops=style, zorder=2)
    (x0, y0), (x1, _) = points[:2]
    text(axes, (x0 + x1) / 2, y0 + 0.05, name)
