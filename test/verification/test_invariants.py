"""Tests of the invariants of telegrams in a soak: a healthy robot passes, and every mutation is detected."""

import mmap
import os
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

pytest.importorskip('sensor_msgs', reason='what a soak reads are ROS messages')

from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.robot.faults.fault import (
    AT_LOSSES,
    KINDS,
    MDT_LOSSES,
    SUPPLY_FAULTS,
    THERMAL_FAULTS,
    parse,
)
from delta3_pacdrive.robot.sercos.bus_time import NEVER, Clock
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES
from delta3_pacdrive.robot.sercos.telegrams import mdt_form, mdt_frame
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, CONTROL_ON, Phase
from delta3_pacdrive.ros.wire.polling import Taken
from delta3_pacdrive.verification import invariants
from delta3_pacdrive.verification.soak import programs as soak_programs
from delta3_pacdrive.verification.soak.runner import memory_mb
from delta3_pacdrive.verification.telegram_log import (
    AT,
    CODECS,
    MDT,
    SHAFTS,
    Telegrams,
    codecs_of,
    enabled_from,
    read_telegrams,
)

ROBOT = parameters.load()
RATIO = ROBOT.dynamics.gear_ratio
FIRST, COUNT = 1000, 50
START, SPEED = np.array([0.1, 0.0, -0.8]), 1e-4  # m per cycle, along x


def healthy() -> dict[str, Any]:
    """Telegrams of a robot that moves evenly along x."""
    cycles = np.arange(FIRST, FIRST + COUNT)
    steps = np.arange(COUNT)[:, None] * np.array([SPEED, 0.0, 0.0])
    late = np.array([SPEED * ROBOT.set_point_delay_cycles, 0.0, 0.0])

    def made(values: Any) -> Telegrams:
        return Telegrams(cycles, [b'3fa9'] * COUNT, cycles.copy(), cycles * 1e-3, np.array(values))

    def shafts(tcp: Any) -> Any:
        return kinematics.inverse(tcp, ROBOT.kinematics) * RATIO

    still = np.zeros((COUNT, 6))
    return {
        SHAFTS: made(np.hstack([shafts(START + steps - late), still])),
        MDT: made(shafts(START + steps)),
        **{topic: made(np.zeros((COUNT, 3))) for topic in AT},
    }


def end(recorded: dict[str, Any]) -> Any:
    return kinematics.forward(recorded[SHAFTS].values[-1, :3] / RATIO, ROBOT.kinematics)


@pytest.fixture
def seen() -> list[tuple[str, int]]:
    return []


@pytest.fixture
def rules(seen: list[tuple[str, int]]) -> invariants.Invariants:
    return invariants.Invariants(ROBOT, lambda sentence, cycle: seen.append((sentence, cycle)))


def test_a_healthy_robot_violates_nothing(rules: invariants.Invariants, seen: list[tuple[str, int]]) -> None:
    recorded = healthy()
    for topic, telegrams in recorded.items():
        rules.check(topic, telegrams)
    error, off = rules.check_undisturbed(recorded, end(recorded))
    rules.check_losses('AT', 2, 2, True, 0)
    rules.check_memory(invariants.Growth(invariants.MEMORY_MB, 0.0, 100_000), 0)
    assert seen == []
    assert error < 1e-6
    assert off < 1e-9


def shifted(column: int, amount: float) -> Callable[[Telegrams], None]:
    """Return a mutation of the values of the twentieth telegram."""

    def mutate(telegrams: Telegrams) -> None:
        telegrams.values[20, column] += amount

    return mutate


def jump_forward(telegrams: Telegrams) -> None:
    telegrams.cycles[20:] += 1


def go_back(telegrams: Telegrams) -> None:
    telegrams.cycles[20] -= 1


def repeat(telegrams: Telegrams) -> None:
    telegrams.cycles[20:] -= 1


MUTATIONS = [
    (SHAFTS, jump_forward, 'plant/motor_shafts: bus cycle 1021 after 1019'),
    (MDT, jump_forward, 'sercos/mdt: bus cycle 1021 after 1019'),
    (AT[1], jump_forward, 'sercos/at/axis2: bus cycle 1021 after 1019'),
    (AT[2], go_back, 'sercos/at/axis3: bus cycle 1019 after 1019'),
    (MDT, repeat, 'sercos/mdt: bus cycle 1019 after 1019'),
    (SHAFTS, shifted(0, np.radians(120.0) * RATIO), 'an arm is at'),
    (SHAFTS, shifted(4, 2000.0), 'a shaft turns at'),
    (SHAFTS, shifted(4, -2000.0), 'a shaft turns at'),
    (AT[0], shifted(2, 40.0), 'sercos/at/axis1: torque'),
    (AT[0], shifted(2, np.nan), 'sercos/at/axis1: torque'),
    (MDT, shifted(1, -np.radians(40.0) * RATIO), 'the TCP is commanded to'),
]


@pytest.mark.parametrize(('topic', 'mutate', 'sentence'), MUTATIONS)
def test_a_mutated_telegram_is_seen_with_its_cycle(
    topic: str,
    mutate: Callable[[Telegrams], None],
    sentence: str,
    rules: invariants.Invariants,
    seen: list[tuple[str, int]],
) -> None:
    telegrams = healthy()[topic]
    mutate(telegrams)
    rules.check(topic, telegrams)
    assert seen[0][0].startswith(sentence)
    assert abs(seen[0][1] - FIRST - 20) <= 1


def test_bus_time_advances_only_after_phase_up(
    rules: invariants.Invariants, seen: list[tuple[str, int]]
) -> None:
    telegrams = healthy()[MDT]
    jump_forward(telegrams)
    telegrams.frames[20:] = [b'0815'] * (COUNT - 20)
    rules.check(MDT, telegrams)
    assert seen == []
    telegrams.cycles[:] -= 10  # the next session begins in the past
    telegrams.frames[:] = [b'1234'] * COUNT
    rules.check(MDT, telegrams)
    assert seen[0][0] == f'sercos/mdt: bus cycle {FIRST - 10} after {FIRST + COUNT}'


@pytest.mark.parametrize(
    ('topic', 'mutate', 'sentence'),
    [
        (SHAFTS, shifted(0, np.radians(103.0) * RATIO), 'an arm is at'),
        (SHAFTS, shifted(3, 640.0), 'a shaft turns at'),
        (AT[0], shifted(2, 14.0), 'sercos/at/axis1: torque'),
        (MDT, shifted(0, 0.3), 'the true TCP is'),
    ],
)
def test_deviations_allowed_for_a_disturbed_robot_are_violations_of_an_undisturbed_one(
    topic: str,
    mutate: Callable[[Telegrams], None],
    sentence: str,
    rules: invariants.Invariants,
    seen: list[tuple[str, int]],
) -> None:
    recorded = healthy()
    mutate(recorded[topic])
    rules.check(topic, recorded[topic])
    assert seen == []
    rules.check_undisturbed(recorded, end(healthy()))
    assert seen[0][0].startswith(sentence)


def test_another_end_point_is_seen(rules: invariants.Invariants, seen: list[tuple[str, int]]) -> None:
    recorded = healthy()
    rules.check_undisturbed(recorded, end(recorded) + np.array([0.0, 1e-4, 0.0]))
    assert seen == [('the program ends 0.1000 mm off', FIRST + COUNT - 1)]


@pytest.mark.parametrize(
    ('lost', 'injected', 'complete', 'wrong'),
    [(1, 0, False, True), (3, 2, True, True), (1, 2, True, True), (1, 2, False, False), (0, 0, True, False)],
)
def test_losses_must_be_those_that_were_injected(
    lost: int,
    injected: int,
    complete: bool,
    wrong: bool,
    rules: invariants.Invariants,
    seen: list[tuple[str, int]],
) -> None:
    rules.check_losses('MDT of axis1', lost, injected, complete, 7)
    assert seen == ([(f'MDT of axis1: {lost} lost, {injected} were injected', 7)] if wrong else [])


def test_memory_must_not_grow(rules: invariants.Invariants, seen: list[tuple[str, int]]) -> None:
    rules.check_memory(invariants.Growth(invariants.MEMORY_MB * 1.1, 0.1, 200_000), 9)
    assert seen[0][0].startswith('memory grows by')
    rules.check_memory(invariants.Growth(50.0, 0.0, 1000), 9)  # too few cycles to judge
    assert len(seen) == 1


def info(number: int) -> dict[str, int]:
    return {'received_timestamp': number, 'publication_sequence_number': 100 + number}


def test_unreadable_telegram_is_rejected() -> None:
    refused: list[str] = []
    data = CODECS[MDT].encode((1, 0), b'x' * 46 + b'3fa9', [1.0, 2.0, 3.0])
    taken = [(data, info(5_000_000_000)), (data[:-8], info(6_000_000_000)), (data, info(7_000_000_000))]
    read = read_telegrams(MDT, taken, Clock(1e-3), refused.append)
    assert read is not None
    assert read.cycles.tolist() == [1000, 1000]
    assert read.sessions == [b'3fa9', b'3fa9']
    assert read.received_s.tolist() == [5.0, 7.0]
    assert len(refused) == 1
    assert refused[0].startswith('sercos/mdt: ')


def test_telegrams_of_cyclic_operation_are_read_from_its_first_cycle_on_and_joined_in_order() -> None:
    def read(messages: list[Taken]) -> Telegrams | None:
        return read_telegrams(MDT, messages, Clock(1e-3), pytest.fail)

    frame = b'x' * 46 + b'3fa9'
    taken = [
        (CODECS[MDT].encode(stamp, frame, [float(n)] * 3), info(n))
        for n, stamp in enumerate([(-1, 0), (0, 0), (0, 1_000_000)])
    ]
    first = read(taken)
    assert first is not None
    assert first.cycles.tolist() == [0, 1]
    assert first.values[:, 0].tolist() == [1.0, 2.0]
    second = read([(CODECS[MDT].encode((0, 2_000_000), frame, [3.0] * 3), info(3))])
    assert second is not None
    whole = Telegrams.joined([first, second])
    assert whole.cycles.tolist() == [0, 1, 2]
    assert whole.numbers.tolist() == [101, 102, 103]
    assert whole.values[:, 0].tolist() == [1.0, 2.0, 3.0]
    assert read(taken[:1]) is None


def test_drives_are_enabled_in_the_cycle_after_the_latest_command() -> None:
    def from_orders(*controls: int) -> int:
        frames = [mdt_frame(Phase.CP4, control, 0.0, b'3fa9') for control in controls]
        cycles = np.arange(100, 100 + len(frames))
        return enabled_from(Telegrams(cycles, frames, cycles, cycles * 1e-3, np.zeros((len(frames), 3))))

    on, off = CONTROL_ENABLE, CONTROL_ON
    assert from_orders(off, on, on) == 102
    assert from_orders(on, off, off, on) == 104
    assert from_orders(off, on, off, on) == 104
    assert from_orders(off, on, off) == NEVER
    assert from_orders(on, on) == NEVER  # nobody has seen when that began
    four = [mdt_frame(Phase.CP4, control, 0.0, b'3fa9', (0, 0, 0, 0)) for control in (off, on)]
    cycles = np.arange(100, 102)
    assert enabled_from(Telegrams(cycles, four, cycles, cycles * 1e-3, np.zeros((2, 4))), 4) == 102


def test_the_telegrams_of_a_robot_with_a_rotary_axis_are_those_of_four_drives() -> None:
    codecs = codecs_of(ALL_DRIVES[:4], torques=True)
    assert codecs.keys() - CODECS.keys() == {'sercos/at/axis4'}
    frame = b'x' * 60 + b'3fa9'
    shafts = codecs[SHAFTS].encode((1, 0), b'3fa9', [float(n) for n in range(12)])
    torques = codecs[MDT].encode((1, 0), frame[: len(mdt_form(4))], [float(n) for n in range(8)])
    for topic, data, numbers in ((SHAFTS, shafts, 12), (MDT, torques, 8)):
        read = read_telegrams(topic, [(data, info(1))], Clock(1e-3), pytest.fail, codecs)
        assert read is not None
        assert read.values.tolist() == [[float(n) for n in range(numbers)]]
    refused: list[str] = []
    assert read_telegrams(SHAFTS, [(shafts, info(1))], Clock(1e-3), refused.append) is None
    assert len(refused) == 1  # a robot with three drives has other ones


@pytest.mark.parametrize(
    ('move', 'end'),
    [
        ({'move_l': {'to_m': [0.1, 0.2, -0.8]}}, [0.1, 0.2, -0.8]),
        ({'move_c': {'via_m': [0.0, 0.0, -0.8], 'to_m': [0.1, 0.2, -0.8]}}, [0.1, 0.2, -0.8]),
        ({'move_sb': {'through_m': [[0.0, 0.0, -0.8], [0.1, 0.2, -0.8]]}}, [0.1, 0.2, -0.8]),
    ],
)
def test_the_end_of_a_program_is_that_of_its_last_move(move: dict[str, Any], end: list[float]) -> None:
    first = {'move_l': {'to_m': [0.3, 0.0, -0.8]}}
    assert soak_programs.Drawn(1, [first, move], []).end_m == end


def test_programs_follow_from_seed_pace_and_number() -> None:
    assert soak_programs.draw(3, 'fast', 17) == soak_programs.draw(3, 'fast', 17)
    others = [
        soak_programs.draw(3, 'fast', 18),
        soak_programs.draw(3, 'real-time', 17),
        soak_programs.draw(4, 'fast', 17),
    ]
    assert all(other.moves != soak_programs.draw(3, 'fast', 17).moves for other in others)


def test_random_programs_can_be_read_and_hold_every_kind_of_fault() -> None:
    drawn = [soak_programs.draw(1, 'fast', number) for number in range(600)]
    for one in drawn:
        read = program_file.parse({'moves': one.moves, 'faults': one.faults}, ROBOT.motion, 'random')
        assert len(read.faults) == len(one.faults) <= 3
    faults = [fault for one in drawn for fault in one.faults]
    without_model = SUPPLY_FAULTS | THERMAL_FAULTS
    assert {parse(fault, 'fault').kind for fault in faults} == set(KINDS) - {'clear', 'deaf'} - without_model
    assert max(fault.get('seconds', 0.0) for fault in faults) > 3.0
    assert {len(one.faults) for one in drawn} == {0, 1, 2, 3}


def test_injected_losses_are_counted_by_axis() -> None:
    faults = [
        {'fault': 'drop_mdt', 'axis': 'axis1', 'cycles': 2, 'after_s': 0.1},
        {'fault': 'corrupt_mdt', 'axis': 'axis1', 'cycles': 1, 'after_s': 0.3},
        {'fault': 'drop_at', 'axis': 'axis3', 'cycles': 5, 'after_s': 0.2},
        {'fault': 'duplicate_at', 'axis': 'axis3', 'cycles': 5, 'after_s': 0.2},
    ]
    drawn = soak_programs.Drawn(1, [], faults)
    assert drawn.lost(MDT_LOSSES, 'axis1') == (3, False)
    assert drawn.lost(MDT_LOSSES, 'axis2') == (0, True)
    assert drawn.lost(AT_LOSSES) == (5, True)
    assert drawn.last_fault_s == 0.3


def test_ten_private_megabytes_count_as_growth_and_mapped_files_do_not(tmp_path):
    path = tmp_path / 'file'
    path.write_bytes(b'\1' * 10_000_000)
    resident, own = memory_mb(os.getpid())
    # not of the heap, which may reuse freed memory
    block = mmap.mmap(-1, 10_000_000, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    for place in range(0, len(block), mmap.PAGESIZE):
        block[place] = 1
    grown = memory_mb(os.getpid())
    assert grown == pytest.approx((resident + 10.0, own + 10.0), abs=1.0)
    with path.open('rb') as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
        assert sum(mapped[:: mmap.PAGESIZE]) == -(-len(block) // mmap.PAGESIZE)
        mapped_in = memory_mb(os.getpid())
    assert mapped_in == pytest.approx((grown[0] + 10.0, grown[1]), abs=1.0)
