"""``delta3 bench cell``: throughput and accuracy of picking from a belt at several belt speeds and part rates."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.cell.cell import Cell
from delta3_pacdrive.errors import ScriptError, WaitTimeoutError
from delta3_pacdrive.parameters import MODEL_CONTROLLER, Parameters, load
from delta3_pacdrive.scripting.simulation import Simulation, simulate
from delta3_pacdrive.studies.framework.figure_style import COLOURS, dress, titled_figure
from delta3_pacdrive.studies.framework.report_folder import Drawings, Table
from delta3_pacdrive.studies.framework.study import OnProgress, silent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SPEEDS_M_S = (0.3, 0.6, 1.0, 1.5)
RATES_PER_MIN = (30.0, 50.0, 70.0, 100.0)
SECONDS = 12.0
WINDOW_M = (0.45, 1.1)
SPACING_MIN_M = 0.07  # parts are 60 mm long
QUICK = {'speed_m_s': 4.0, 'acceleration_m_s2': 40.0, 'jerk_m_s3': 4000.0}
GRIP_S, RELEASE_S = 0.04, 0.02
TRAY_MM, ABOVE_MM, TOP_MM = [0, -200, -850], 40, 20
MISSES_SHARE = 0.99  # below this picked share, the robot misses parts
MM = 1e3


@dataclass(frozen=True)
class Row:
    """Figures at one belt speed and part rate."""

    speed_m_s: float
    rate_per_min: float
    picked: int
    offered: int
    picks_per_min: float | None  # from the first to the last placed part
    cycle_s: float | None  # shortest time between two placed parts
    error_rms_m: float | None  # distance from the centre of the part when gripped
    error_max_m: float | None
    stay_s: float  # time of a part in the window

    @property
    def share(self) -> float:
        """Picked share of the parts."""
        return self.picked / self.offered if self.offered else 1.0


def belt_cell(speed_m_s: float, rate_per_min: float, seconds: float) -> Cell:
    """Return a cell with a belt along x, a light barrier, parts at a rate, and a tray."""
    spacing_m = speed_m_s * 60.0 / rate_per_min
    count = int(seconds * rate_per_min / 60.0) + 2
    line = {
        'origin_mm': [-700, 100, -870],
        'length_mm': 1500,
        'encoder': {'bits': 14, 'circumference_mm': 200},
        'speed': [{'after_s': 0.0, 'speed_m_s': speed_m_s}],
        'barrier': {'at_mm': 200, 'delay_s': 0.0005},
        'stream': {'part': 'bar', 'count': count, 'spacing_m': spacing_m},
        'window_m': list(WINDOW_M),
    }
    valve = {'on_s': 0.005, 'off_s': 0.004}
    cup = {'output': 'gripper', 'diameter_mm': 60, 'vacuum_pa': 60000, 'build_up_s': 0.006, 'decay_s': 0.004}
    return cell_file.parse(
        {
            'name': f'{rate_per_min:g} parts a minute at {speed_m_s:g} m/s',
            'cup': cup | {'valve': valve},
            'parts': {'bar': {'mass_kg': 0.2, 'size_mm': [60, 40, 20], 'friction': 0.5}},
            'boxes': {'tray': {'at_mm': [0, -200, -870], 'clears_s': 0.02}},
            'belts': {'line': line},
        }
    )


def pick(robot: Simulation) -> bool:
    """Pick and place the next part; return whether it could be reached. Raises WaitTimeoutError without parts."""
    part = robot.part('line', timeout_s=3.0)
    try:
        with robot.track('line', part, **QUICK):
            robot.move_l(to_mm=[0, 0, ABOVE_MM], **QUICK)
            robot.move_l(to_mm=[0, 0, TOP_MM], **QUICK)
            robot.output('gripper', True, payload_kg=0.2)
            robot.dwell(GRIP_S)
            robot.move_l(to_mm=[0, 0, ABOVE_MM], **QUICK)
    except WaitTimeoutError:
        raise
    except ScriptError:
        return False
    robot.arch(to_mm=TRAY_MM, up_mm=20, down_mm=20, **QUICK)
    robot.output('gripper', False, payload_kg=0.0)
    robot.dwell(RELEASE_S)
    return True


def run_row(speed_m_s: float, rate_per_min: float, seconds: float, parameters: Parameters) -> Row:
    """Pick parts for a bus time [s]; return the figures."""
    tried = 0
    with simulate(parameters, cell=belt_cell(speed_m_s, rate_per_min, seconds), name='bench cell') as robot:
        try:
            while robot.state().time_s < seconds:
                pick(robot)
                tried += 1
        except WaitTimeoutError:
            pass  # no more parts
        left = robot.belt('line').left
    report, cycle_s = robot.trace.meta['cell'], parameters.bus.cycle_time_s
    placed = [one for one in report['parts'] if one['outcome'] == 'placed']
    released = np.sort([one['released_cycle'] for one in placed]) * cycle_s
    several = len(released) > 1
    off = np.array([np.hypot(*one['pick_error_m'][:2]) for one in placed])
    return Row(
        speed_m_s=speed_m_s,
        rate_per_min=rate_per_min,
        picked=len(placed),
        offered=tried + left,
        picks_per_min=60.0 * (len(released) - 1) / float(released[-1] - released[0]) if several else None,
        cycle_s=float(np.diff(released).min()) if several else None,
        error_rms_m=float(np.sqrt(np.mean(off**2))) if len(off) else None,
        error_max_m=float(off.max()) if len(off) else None,
        stay_s=(WINDOW_M[1] - WINDOW_M[0]) / speed_m_s,
    )


def measure(
    speeds_m_s: Sequence[float] = SPEEDS_M_S,
    rates_per_min: Sequence[float] = RATES_PER_MIN,
    seconds: float = SECONDS,
    show: OnProgress = silent,
) -> dict[str, Any]:
    """Return the figures of each speed and rate, and the throughput limit at each speed.

    ``show`` receives the present case, and the number of completed and of all cases. Cases with overlapping parts are
    skipped.
    """
    parameters = load(MODEL_CONTROLLER)
    cases = [
        (speed, rate)
        for speed in speeds_m_s
        for rate in rates_per_min
        if speed * 60.0 / rate >= SPACING_MIN_M
    ]
    rows = []
    for n, (speed, rate) in enumerate(cases):
        show(f'{speed:g} m/s, {rate:g} parts a minute', n, len(cases))
        rows.append(run_row(speed, rate, seconds, parameters))
    return {
        'seconds': seconds,
        'rows': [asdict(row) | {'share': row.share} for row in rows],
        'limits': [
            limit_of(speed, [row for row in rows if row.speed_m_s == speed], seconds) for speed in speeds_m_s
        ],
    }


def limit_of(speed: float, rows: Sequence[Row], seconds: float) -> dict[str, Any]:
    """Return the throughput limit at one belt speed: the cycle time, and a sentence."""
    cycles = [row.cycle_s for row in rows if row.cycle_s is not None]
    if not cycles:
        return {'speed_m_s': speed, 'sentence': f'at {speed:g} m/s no two parts were picked'}
    cycle_s = min(cycles)
    most = 60.0 / cycle_s
    missed = [row.rate_per_min for row in rows if row.share < MISSES_SHARE]
    misses = f'misses parts from {min(missed):g} per minute' if missed else 'misses no parts'
    return {
        'speed_m_s': speed,
        'cycle_s': cycle_s,
        'picks_per_min_max': most,
        'stay_s': rows[0].stay_s,
        'sentence': (
            f'at {speed:g} m/s the robot takes {cycle_s:.3f} s per part, {most:.1f} per minute; a part stays '
            f'{rows[0].stay_s:.2f} s in the window: in {seconds:g} s it {misses}'
        ),
    }


def text(result: dict[str, Any]) -> list[str]:
    """Return the figures as lines: one for each speed and rate, then the limit at each speed."""
    lines = [f'{"belt":>9} {"parts/min":>10} {"picks/min":>10} {"picked":>8} {"rms":>9} {"max":>9}']
    for row in result['rows']:
        rate = '-' if row['picks_per_min'] is None else f'{row["picks_per_min"]:.1f}'
        errors = [
            '-' if row[name] is None else f'{MM * row[name]:.3f} mm'
            for name in ('error_rms_m', 'error_max_m')
        ]
        lines.append(
            f'{row["speed_m_s"]:5g} m/s {row["rate_per_min"]:10g} {rate:>10} {100.0 * row["share"]:6.1f} % '
            f'{errors[0]:>9} {errors[1]:>9}'
        )
    return [*lines, *(limit['sentence'] for limit in result['limits'])]


def table(result: dict[str, Any]) -> Table:
    """Return the figures as a table."""
    names = list(result['rows'][0])
    return Table('cell.csv', names, [[row[name] for name in names] for row in result['rows']])


def drawings(result: dict[str, Any]) -> Drawings:
    """Return the drawing functions by file name."""
    return {'picks.png': partial(picks, result), 'errors.png': partial(errors, result)}


def picks(result: dict[str, Any]) -> 'Figure':
    """Plot picks per minute and picked share over the part rate for each belt speed."""
    return _over_rate(result, (('picks_per_min', 1.0, 'picks [1/min]'), ('share', 100.0, 'picked [%]')))


def errors(result: dict[str, Any]) -> 'Figure':
    """Plot the gripping error over the part rate for each belt speed."""
    return _over_rate(
        result, (('error_rms_m', MM, 'rms error [mm]'), ('error_max_m', MM, 'largest error [mm]'))
    )


def _over_rate(result: dict[str, Any], panels: Sequence[tuple[str, float, str]]) -> 'Figure':
    figure = titled_figure('Picking from a belt', 3.6)
    for n, (name, factor, label) in enumerate(panels, start=1):
        axes = figure.add_subplot(1, len(panels), n)
        for colour, limit in zip(COLOURS, result['limits'], strict=False):
            speed = limit['speed_m_s']
            rows = [row for row in result['rows'] if row['speed_m_s'] == speed and row[name] is not None]
            rates = [row['rate_per_min'] for row in rows]
            values = [factor * row[name] for row in rows]
            axes.plot(rates, values, 'o-', color=colour, label=f'{speed:g} m/s')
        dress(axes, xlabel='parts [1/min]', ylabel=label, ylim=(0.0, None))
        axes.legend(loc='lower right')
    return figure
