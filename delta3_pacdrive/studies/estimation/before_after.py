"""Comparison of model and robot on a recording, with the parameters before and after an estimation.

Both models receive the recorded commands. Compared are the current (figure 11.6) and the norm of the TCP error
(figure 11.8), computed in the same way from the shafts of robot and models. No model can reproduce the noise of the
robot's sensors. The current is therefore also compared in the frequency band of the motion, where there is little
noise, and the rms caused by sensor noise alone is reported as the floor.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.signal import butter, sosfiltfilt

from delta3_pacdrive import kinematics
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.estimation.problem import BAND_HZ
from delta3_pacdrive.studies.estimation.replay_model import Replay
from delta3_pacdrive.studies.framework.figure_style import COLOURS, dress, titled_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AT_FLOOR = 1.1  # times the floor: only noise remains
NOISE_RUNS = 3  # runs of the new model with sensor noise; their mean is the floor
SMALL: dict[str, Any] = {'fontsize': 8, 'frameon': False}


@dataclass(frozen=True)
class Course:
    """Signals of the robot or of a model."""

    current: Floats  # [A], shape (n, 3)
    error_norm: Floats  # of the TCP [m], shape (n,)


@dataclass(frozen=True)
class BeforeAfter:
    """Recording, and models with the old and the new parameters on its commands."""

    time_s: Floats  # shape (n,)
    robot: Course
    before: Course
    after: Course
    cycle_time_s: float
    # current caused by sensor noise alone [A], shape (runs, n, 3); None without noise
    noise: Floats | None = None

    def rms(self) -> dict[str, dict[str, float | None]]:
        """Rms of model less robot before and after, their ratio, and the floor, by compared signal [SI]."""
        section = butter(4, BAND_HZ, fs=1.0 / self.cycle_time_s, output='sos')
        found: dict[str, dict[str, float | None]] = {}
        for name in ('current_a', 'current_in_the_band_of_the_motion_a', 'tcp_error_norm_m'):
            before, after = (self._apart(name, model, section) for model in (self.before, self.after))
            found[name] = {
                'before': before,
                'after': after,
                'factor': before / max(after, 1e-300),
                'floor': self._floor(name, section),
            }
        return found

    def _floor(self, name: str, section: Floats) -> float | None:
        if self.noise is None or 'current' not in name:
            return None
        noise = sosfiltfilt(section, self.noise, axis=1) if 'band' in name else self.noise
        return float(np.sqrt(np.mean(noise**2)))

    def _apart(self, name: str, model: Course, section: Floats) -> float:
        if name == 'tcp_error_norm_m':
            apart = model.error_norm - self.robot.error_norm
        else:
            apart = model.current - self.robot.current
            if 'band' in name:
                apart = sosfiltfilt(section, apart, axis=0)
        return float(np.sqrt(np.mean(apart**2)))


def compare(trace: Trace, before: Parameters, after: Parameters) -> BeforeAfter:
    """Run both models on the commands of a recording with one sample per bus cycle."""
    replays = [Replay(trace, parameters, ideal_encoder=False) for parameters in (before, after)]
    rows = replays[0].rows
    commands = trace['motor_command'][rows]

    def course(signals: Any) -> Course:
        return Course(signals['current'], error_norm(signals['motor_position'], commands, before))

    robot = course({name: trace[name][rows] for name in ('current', 'motor_position')})
    old, new = (course(replay.run({})) for replay in replays)
    noise = replays[1].noise({}, NOISE_RUNS) if replays[1].is_noisy else None
    return BeforeAfter(
        time_s=trace.time_s[rows],
        robot=robot,
        before=old,
        after=new,
        cycle_time_s=before.bus.cycle_time_s,
        noise=noise,
    )


def error_norm(positions: Floats, commands: Floats, parameters: Parameters) -> Floats:
    """Norm of the TCP error [m]: delayed and interpolated commands (7.3) less the shafts.

    Commands and answers of a row belong to the same cycle, so the cycle of feedback does not count.
    """
    delay = parameters.set_point_delay_cycles
    cycles = np.arange(len(commands), dtype=np.float64)
    ago = np.clip(cycles - delay, 0.0, None)
    delayed = np.column_stack([np.interp(ago, cycles, column) for column in commands.T])
    ratio = parameters.dynamics.gear_ratio
    command, actual = (
        kinematics.forward(shafts / ratio, parameters.kinematics) for shafts in (delayed, positions)
    )
    return np.asarray(np.linalg.norm(actual - command, axis=1))


def sentences(found: BeforeAfter) -> list[str]:
    """Return the deviations of the model from the robot before and after, as sentences."""
    texts = {
        'current_a': ('current', 'A', 1.0),
        'current_in_the_band_of_the_motion_a': (f'current below {BAND_HZ:g} Hz', 'A', 1.0),
        'tcp_error_norm_m': ('norm of the TCP error', 'mm', 1e3),
    }
    rows, lines = found.rms(), []
    for name, (text, unit, scale) in texts.items():
        before, after, factor = (float(rows[name][key] or 0.0) for key in ('before', 'after', 'factor'))
        sentence = (
            f'{text}: model less robot {scale * before:.3g} {unit} rms before, {scale * after:.3g} after: '
            f'{factor:.2g} times less'
        )
        floor = rows[name]['floor']
        if floor is not None:
            rest = ', which explains the remainder' if after <= AT_FLOOR * floor else ''
            sentence += f'; sensor noise alone causes {scale * floor:.3g}{rest}'
        lines.append(sentence)
    return lines


def current(found: BeforeAfter) -> Figure:
    """Figure 11.6 before and after: currents of the robot and of the models with old and new parameters."""
    figure = titled_figure('Figure 11.6: motor currents, before and after the estimation', 6.4)
    grid = figure.subplots(3, 2, sharex=True, sharey='row')
    for i, row in enumerate(grid):
        for axes, model, title in zip(row, (found.before, found.after), ('before', 'after'), strict=True):
            axes.plot(found.time_s, found.robot.current[:, i], color=COLOURS[1], linewidth=0.8, label='robot')
            axes.plot(found.time_s, model.current[:, i], color=COLOURS[0], linewidth=0.8, label='model')
            dress(axes, title if i == 0 else '', ylabel=f'motor {i + 1} [A]' if title == 'before' else '')
    for axes in grid[-1]:
        axes.set_xlabel('time [s]')
    grid[0, 1].legend(ncols=2, **SMALL)
    return figure


def tcp_error(found: BeforeAfter) -> Figure:
    """Figure 11.8 before and after: norm of the TCP error of robot and model."""
    figure = titled_figure('Figure 11.8: norm of the TCP error, before and after the estimation', 3.6)
    row = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, model, title in zip(row, (found.before, found.after), ('before', 'after'), strict=True):
        axes.plot(found.time_s, 1e3 * found.robot.error_norm, color=COLOURS[1], linewidth=0.8, label='robot')
        axes.plot(found.time_s, 1e3 * model.error_norm, color=COLOURS[0], linewidth=0.8, label='model')
        dress(axes, title, xlabel='time [s]', ylabel='norm [mm]' if title == 'before' else '')
    row[1].legend(ncols=2, **SMALL)
    return figure


def drawings(found: BeforeAfter) -> dict[str, Any]:
    """Return the drawing function of each figure by file name."""
    return {
        'figure_11_06_before_after.png': partial(current, found),
        'figure_11_08_before_after.png': partial(tcp_error, found),
    }
