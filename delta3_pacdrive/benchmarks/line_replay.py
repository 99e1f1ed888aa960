"""Replay one minute of a robot of a line with the full simulation, with the same parts at the same times.

A script starts each part at its time in the shift, or as soon as the robot is free. The replay compares cycle times
and lists the parts that cannot be reached. The replays of all robots give the load of a DC link for the whole line.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from delta3_pacdrive.belts.queue import QueuedPart
from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.cell.cell import Cell
from delta3_pacdrive.errors import LineError, ScriptError
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.scripting.simulation import Simulation, simulate
from delta3_pacdrive.studies.fleet.line.design import Line, LineRobot, PartKind
from delta3_pacdrive.studies.fleet.line.run import Study as Shift
from delta3_pacdrive.studies.fleet.line.shift import BeltShift
from delta3_pacdrive.studies.runs.run_supply import CommonSupply, DrivesPower, common_supply, drives_power

BEFORE_M = 1.5  # length of the belt upstream of the robot
BELT_M = 3.0
BELT = 'line'
START_S = 0.5  # from the start of the belt to the start of the replay
MINUTE_S = 60.0
MM = 1e3


@dataclass(frozen=True)
class ReplayedPart:
    """Replayed cycle of a part."""

    part: int  # number on its belt, from 1
    planned_s: float  # cycle time in the shift
    simulated_s: float  # cycle time in the simulation; nan if missed
    late_s: float  # delay of the start
    missed: str  # reason, or empty


@dataclass(frozen=True)
class Replay:
    """Replayed cycles of a robot, and all signals."""

    parts: list[ReplayedPart]
    trace: Trace
    start_s: float  # bus time of the first cycle
    shift_s: float  # its time in the shift

    def powers(self, line: Line) -> DrivesPower:
        """Return the powers of the drives by bus cycles since the begin of the shift; raises TraceError."""
        cycle_s = line.parameters.bus.cycle_time_s
        kept = self.trace.time_s > self.start_s - 0.5 * cycle_s
        signals = {
            name: values[kept] for name, values in self.trace.signals.items() if len(values) == len(kept)
        }
        part = Trace(self.trace.time_s[kept], signals, self.trace.meta)
        return drives_power(part, line.parameters, round(self.shift_s / cycle_s))


def replay(line: Line, belt: BeltShift, robot: str, begin_s: float, seconds: float = MINUTE_S) -> Replay:
    """Replay the parts that a robot started to pick in a time window of the shift.

    Parameters
    ----------
    belt
        Shift of the belt of the robot.
    begin_s, seconds
        Start and length of the window [s].

    Raises
    ------
    LineError
        The robot picked no part in the window.

    """
    (station,) = (one for one in line.robots if one.name == robot)
    during = (belt.robot == belt.robots.index(robot)) & (belt.start_s >= begin_s)
    parts = np.flatnonzero(during & (belt.start_s < begin_s + seconds))
    if not len(parts):
        raise LineError(
            f'{robot} picked no part between {begin_s:g} s and {begin_s + seconds:g} s of the shift'
        )
    parts = parts[np.argsort(belt.start_s[parts])]
    speed = next(one.speed_m_s for one in line.belts if one.name == belt.belt)
    with simulate(line.parameters, cell=_cell(station, speed), name=f'{robot} again') as simulated:
        simulated.move_l(to_mm=[MM * x for x in station.place_m])
        simulated.wait_time(START_S)
        began = float(belt.start_s[parts[0]])
        now, way = simulated.state().time_s, simulated.belt(BELT).way_m
        begun, found = now, []
        for part in parts:
            due = now + float(belt.start_s[part]) - began
            along = speed * (began - belt.parts.enters_s[part]) - station.at_m + BEFORE_M - way
            queued = QueuedPart('', float(along), float(belt.parts.across_m[part]), belt=BELT)
            if simulated.state().time_s < due:
                simulated.wait_until(due)
            start, missed = simulated.state().time_s, ''
            try:
                _pick(simulated, line, station, queued, line.kinds[belt.parts.kind[part]])
            except ScriptError as error:
                missed = str(error)
            took = float('nan') if missed else simulated.state().time_s - start
            found.append(ReplayedPart(int(part) + 1, float(belt.cycle_s[part]), took, start - due, missed))
    return Replay(found, simulated.trace, begun, began)


def _pick(robot: Simulation, line: Line, station: LineRobot, part: QueuedPart, kind: PartKind) -> None:
    limits = {
        'speed_m_s': line.limits.speed_m_s,
        'acceleration_m_s2': line.limits.acceleration_m_s2,
        'jerk_m_s3': line.limits.jerk_m_s3,
    }
    above, top = [0.0, 0.0, MM * (kind.height_m + line.above_m)], [0.0, 0.0, MM * kind.height_m]
    with robot.track(BELT, part, **limits):
        robot.move_l(to_mm=above, **limits)
        robot.move_l(to_mm=top, **limits)
        robot.output('gripper', True, payload_kg=kind.mass_kg)
        if line.grip_s:
            robot.dwell(line.grip_s)
        robot.move_l(to_mm=above, **limits)
    robot.move_l(to_mm=[MM * x for x in station.place_m], **limits)
    robot.output('gripper', False, payload_kg=0.0)
    if line.release_s:
        robot.dwell(line.release_s)
    robot.wait()


def _cell(station: LineRobot, speed_m_s: float) -> Cell:
    """Return the cell of a robot with its belt at constant speed."""
    x, y, z = station.middle_m
    window = [BEFORE_M + station.window.begin_m, BEFORE_M + station.window.end_m]
    belt = {
        'origin_m': [x - BEFORE_M, y, z],
        'length_m': BELT_M,
        'encoder': {'bits': 14, 'circumference_mm': 200},
        'speed': [{'after_s': 0.0, 'speed_m_s': speed_m_s, 'acceleration_m_s2': 100.0}],
        'window_m': window,
    }
    valve = {'on_s': 0.005, 'off_s': 0.004}
    cup = {'output': 'gripper', 'diameter_mm': 60, 'vacuum_pa': 60000, 'build_up_s': 0.006, 'valve': valve}
    part = {'mass_kg': 0.2, 'size_mm': [60, 40, 20], 'friction': 0.5}
    return cell_file.parse({'name': station.name, 'cup': cup, 'parts': {'part': part}, 'belts': {BELT: belt}})


def common(shift: Shift, begin_s: float, seconds: float = MINUTE_S) -> CommonSupply:
    """Replay all robots that work in a time window of a shift; return the load of one DC link for them.

    Raises
    ------
    LineError
        Fewer than two robots work at the same time.

    """
    powers = []
    for belt in shift.results.belts if shift.results else ():
        for number, robot in enumerate(belt.robots):
            during = (belt.robot == number) & (belt.start_s >= begin_s) & (belt.start_s < begin_s + seconds)
            if during.any():
                shift.on_progress(f'{robot} again', 0, 0)
                powers.append(replay(shift.line, belt, robot, begin_s, seconds).powers(shift.line))
    found = common_supply(powers, shift.line.parameters) if len(powers) > 1 else None
    if found is None:
        raise LineError(
            f'fewer than two robots work at the same time between {begin_s:g} s and {begin_s + seconds:g} s of the '
            'shift'
        )
    return found


def summary(found: list[ReplayedPart]) -> dict[str, Any]:
    """Return the deviation of the simulation from the shift, for JSON."""
    done = [one for one in found if not one.missed]
    differences = np.array([one.simulated_s - one.planned_s for one in done])
    return {
        'picked': len(found),
        'picked_again': len(done),
        'difference_mean_s': float(differences.mean()) if done else None,
        'difference_max_s': float(np.abs(differences).max()) if done else None,
        'late_max_s': max(one.late_s for one in found),
        'missed': [{'part': one.part, 'reason': one.missed} for one in found if one.missed],
    }


def text(document: dict[str, Any]) -> list[str]:
    """Return the summary as lines of text."""
    picked, again = document['picked'], document['picked_again']
    lines = [f'replay with the full simulation: {again} of {picked} parts picked']
    if again:
        mean, most = 1e3 * document['difference_mean_s'], 1e3 * document['difference_max_s']
        late = 1e3 * document['late_max_s']
        lines.append(
            f'cycle time deviation: {mean:+.1f} ms mean, {most:.1f} ms max; start delay at most {late:.1f} ms'
        )
    return [*lines, *(f'part {one["part"]} missed: {one["reason"]}' for one in document['missed'])]
