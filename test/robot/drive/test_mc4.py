"""Tests of the MC-4 drives (thesis 7.1, 8.1), alone and on the plant: timing and enabling."""

import math

import numpy as np
import pytest

from delta3_pacdrive.robot.drive.arrays import DriveState
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, CONTROL_OFF, CONTROL_ON, in_torque
from drive_bench import GEAR, INCREMENT_RAD, K_M, SAG_RAD, Bench, enabled_drive, stand

# timing


def test_a_command_works_exactly_one_cycle_after_its_telegram(robot):
    stepped, still = enabled_drive(robot), enabled_drive(robot)
    assert np.array_equal(stand(stepped, 0.1), stand(still, 0.0))
    assert not np.array_equal(stand(stepped, 0.1), stand(still, 0.0))


def test_the_control_word_works_exactly_one_cycle_after_its_telegram(robot):
    drive = MC4(robot)
    stand(drive, 0.0, 3, control=CONTROL_ON)
    stand(drive, 0.0, control=CONTROL_ENABLE)
    assert drive.drive_state == DriveState.READY
    stand(drive, 0.0, control=CONTROL_ENABLE)
    assert drive.drive_state == DriveState.ENABLING


def test_the_set_point_is_approached_in_quarters_and_reached_1_75_ms_after_its_telegram(robot):
    fine = robot.replace(bus__exchange_period_s=250e-6)
    drive = MC4(fine)
    seen = []
    for cycle in range(64):
        drive.begin_cycle(0.4 if cycle >= 61 else 0.0, CONTROL_ENABLE, 0.0, 0.0, 0.0)
        for quarter in range(4):
            drive.run_period(0.0, 0.0, 0.0)
            seen.append((cycle + 0.25 * quarter - 61, float(drive.state['reference'][0])))
    after = dict(seen)
    assert [after[t] for t in (-0.25, 0.0, 0.75)] == [0.0, 0.0, 0.0]
    assert [after[t] for t in (1.0, 1.25, 1.5)] == pytest.approx([0.1, 0.2, 0.3])
    assert [after[t] for t in (1.75, 2.0, 2.75)] == [0.4, 0.4, 0.4]


def test_the_encoder_reads_the_nearest_increment(robot):
    drive = MC4(robot)
    print('seed 5')
    for position in np.random.default_rng(5).uniform(-1000.0, 1000.0, 200):
        drive.begin_cycle(position, CONTROL_ON, position, 1.5, 0.0)
        read, speed, torque = drive.answer
        assert abs(read - position) <= 0.5 * INCREMENT_RAD * (1.0 + 1e-6)
        assert read / INCREMENT_RAD == pytest.approx(round(read / INCREMENT_RAD), abs=1e-6)
        assert read == drive.encoder_position(position)
        assert (speed, torque) == (1.5, 0.0)


def test_at_has_the_torque_of_the_current(robot):
    drive = enabled_drive(robot)
    currents = stand(drive, 0.2, 10)
    drive.begin_cycle(0.2, CONTROL_ENABLE, 0.0, 0.0, 0.0)
    assert drive.answer[2] == K_M * currents[-1]
    assert sum(drive.phase_currents()) == pytest.approx(0.0, abs=1e-12)
    assert np.linalg.norm(drive.phase_currents()) / math.sqrt(3.0) == pytest.approx(abs(currents[-1]))


# enabling


def test_arms_do_not_sag_at_enabling(robot):
    for home in ([0.0, 0.0, -0.75], [0.34, 0.34, -0.91]):
        bench = Bench(robot.replace(motion__home_m=home)).run(5, control=CONTROL_ON).run(200)
        assert np.abs(bench.moved).max() / GEAR < SAG_RAD
        assert all(in_torque(word) for word in bench.status[-1])


def test_brakes_open_only_when_the_current_loops_hold_the_load(robot):
    bench = Bench(robot).run(150)
    opened = [released.all() for released in bench.released].index(True)
    load = np.array(bench.shafts[opened - 1])[6:] / K_M
    held = np.array(bench.currents[opened - 1])[:, -1]
    assert held == pytest.approx(load, rel=0.01)
    assert not np.any(bench.released[: opened - 1])
    # enable word, settle time, delay of the brake; then the drives report torque
    assert opened * 1e-3 >= robot.drive.enable_settle_s + robot.motor.brake_release_s
    reported = [in_torque(words[0]) for words in bench.status].index(True)
    assert opened < reported <= opened + 2


def test_without_settle_time_the_brakes_open_as_well(robot):
    bench = Bench(robot.replace(drive__enable_settle_s=0.0)).run(150)
    assert bench.states[-1] == [DriveState.ENABLED] * 3
    assert bench.released[-1].all()


def test_ready_is_reported_before_power_and_torque_only_after_the_brake(robot):
    drive = MC4(robot)
    words = []
    for control in [CONTROL_OFF] * 2 + [CONTROL_ON] * 2 + [CONTROL_ENABLE] * 60:
        words.append(drive.begin_cycle(0.0, control, 0.0, 0.0, 0.0))
        drive.run_period(0.0, 0.0, 0.0)
    assert (words[1], words[3], words[-1]) == (0x4000, 0x8000, 0xC008)
    assert not any(in_torque(word) for word in words[:50])


def test_bits_for_operation_modes_and_synchronisation_change_nothing(robot):
    words = []
    for mode in (0, 1 << 8 | 1 << 9 | 1 << 11, 1 << 10):
        drive = MC4(robot)
        for _ in range(100):
            word = drive.begin_cycle(0.0, CONTROL_ENABLE | mode, 0.0, 0.0, 0.0)
            drive.run_period(0.0, 0.0, 0.0)
        words.append(word)
    assert words == [0xC008] * 3  # bits 10 to 8: the primary operation mode


def test_status_word_reports_warnings_errors_and_halt(robot):
    limit = robot.drive.following_error_limit_rad
    drive = MC4(robot)
    for _ in range(100):
        drive.begin_cycle(0.0, CONTROL_ENABLE, 0.0, 0.0, 0.0)
        drive.run_period(0.0, 0.0, 0.0)
    assert drive.begin_cycle(0.0, CONTROL_ENABLE, 2.0 * limit, 0.0, 0.0) == 0xD008
    assert drive.begin_cycle(0.0, CONTROL_ENABLE, 0.0, 0.0, 0.0) == 0xC008
    drive.begin_cycle(0.0, 0xC000, 0.0, 0.0, 0.0)
    assert drive.begin_cycle(0.0, 0xC000, 0.0, 0.0, 0.0) == 0xC000  # halted: in torque, follows nothing
    drive.state['encoder_broken'] = 1
    assert drive.begin_cycle(0.0, 0xC000, 0.0, 0.0, 0.0) == 0x2000
