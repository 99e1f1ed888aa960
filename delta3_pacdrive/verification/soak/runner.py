"""Random programs with random faults for as long as one likes; every telegram is held against what must always be."""

import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import count

import psutil

from delta3_pacdrive import parameters as core
from delta3_pacdrive.bringup.bringup import Bringup
from delta3_pacdrive.bringup.options import Options
from delta3_pacdrive.bringup.scheduling import Schedule
from delta3_pacdrive.errors import Delta3Error, ProgramError, RobotFault
from delta3_pacdrive.faults.fault import AT_LOSSES, MDT_LOSSES, PROCESS_FAULTS
from delta3_pacdrive.sercos.configuration_check import DRIVES
from delta3_pacdrive.verification.invariants import Growth, Invariants, growth_of
from delta3_pacdrive.verification.operator import AutomatedOperator, run_operated
from delta3_pacdrive.verification.soak.programs import Drawn, draw
from delta3_pacdrive.verification.telegram_log import TelegramLog

HOME_M = (0.0, 0.0, -0.8)
OBSERVED_S = 0.3
SETTLE_S = 0.1  # after the end of a program, before its end point is looked at
VIOLATIONS_SHOWN = 10
WARM_UP = 1 / 3  # of the cycles so far: caches fill, kernels and modules are loaded
UNSEEN_MAX = 0.1  # of all bus cycles: who has seen less has not looked


@dataclass
class Violation:
    """Something that must never be was.

    Attributes
    ----------
    sentence
        What it was.
    seed, pace, number
        Of the program during which it was, for ``--seed``, ``--pace`` and ``--replay``; 0: of no single program.
    cycle
        Bus cycle.
    program
        The program with its faults, in YAML.

    """

    sentence: str
    seed: int
    pace: str
    number: int
    cycle: int
    program: str


@dataclass
class Figures:
    """These figures say what a soak did.

    Attributes
    ----------
    error_max_m, end_max_m
        Of undisturbed programs: distance of the true TCP from its command, and of their ends from their last points.
    rss_start_mb, rss_end_mb, rss_cycles
        Resident memory of the processes that lived from the end of the warm-up to the end, and the cycles in between.
    growth_mb, growth_half_width_mb
        By how much their own memory grows in 100,000 cycles, and its interval; None: too few programs to say. The rest
        of the resident memory are pages of program files.
    unseen
        Bus cycles of which a telegram never came to be judged, on the topic with most of them.
    kinds
        How many faults of each kind were injected.
    refusal
        Why the planner refused the last program that it refused.

    """

    programs: int = 0
    refused: int = 0
    undisturbed: int = 0
    cycles: int = 0
    unseen: int = 0
    injected: int = 0
    stopped: int = 0
    survived: int = 0
    lost_at: int = 0
    lost_at_injected: int = 0
    lost_mdt: int = 0
    lost_mdt_injected: int = 0
    error_max_m: float = 0.0
    end_max_m: float = 0.0
    rss_start_mb: float = 0.0
    rss_end_mb: float = 0.0
    rss_cycles: int = 0
    growth_mb: float | None = None
    growth_half_width_mb: float | None = None
    kinds: dict[str, int] = field(default_factory=dict)
    refusal: str = ''
    violations: list[Violation] = field(default_factory=list)

    @property
    def watched(self) -> bool:
        """Whether nearly all that happened was seen."""
        return self.unseen <= UNSEEN_MAX * self.cycles

    @property
    def ok(self) -> bool:
        """Whether programs ran and were watched, nothing was violated and every fault was survived."""
        looked = bool(self.programs) and self.watched
        return looked and not self.violations and self.survived == self.injected


@dataclass(frozen=True)
class _Counters:
    """Drives and master have counted these lost telegrams so far, in one session of the bus."""

    session: bytes
    at: int
    mdt: tuple[int, ...]


def memory_mb(pid: int) -> tuple[float, float]:
    """Return the resident memory of a process and its own part of it, without pages of files [MB]."""
    memory = psutil.Process(pid).memory_info()
    return memory.rss / 1e6, (memory.rss - memory.shared) / 1e6


class Soak(AutomatedOperator):
    """The operator runs random programs with faults on a robot that is up.

    Parameters
    ----------
    bringup, robot
        The robot, and its parameters.
    seed, pace
        Of the sequence of programs.
    figures
        Adds to them.

    """

    def __init__(
        self, bringup: Bringup, robot: core.Parameters, seed: int, pace: str, figures: Figures
    ) -> None:
        super().__init__(bringup)
        self._seed, self._pace, self.figures = seed, pace, figures
        self._drawn = Drawn(0, [], [])
        self._invariants = Invariants(robot, self._violate)
        self._growth = Growth()
        # cycles, and resident and own memory [MB] by process
        self._memory: list[tuple[int, dict[int, tuple[float, float]]]] = []
        self._log = TelegramLog(self.operator, robot, lambda text: self._violate(text, -1))

    def _violate(self, sentence: str, cycle: int) -> None:
        drawn = self._drawn
        self.figures.violations.append(
            Violation(sentence, self._seed, self._pace, drawn.number, cycle, drawn.to_yaml())
        )

    def look(self) -> None:
        """Hold every telegram against the invariants."""
        self._invariants.check_all(self._log.read())

    def run(self, seconds: float, show: Callable[[Figures], None], replay: int | None = None) -> None:
        """Run for a while, or only the program of a number."""
        started = time.monotonic()
        first_cycle = self.fresh()['cycles']
        self.make_ready(HOME_M)
        numbers: Iterable[int] = count(1) if replay is None else (replay,)
        for number in numbers:
            if replay is None and time.monotonic() - started > seconds:
                break
            self._drawn = draw(self._seed, self._pace, number)
            self._run_program(self._drawn)
            self.figures.cycles = self.progress['cycles'] - first_cycle
            self.figures.unseen = max(self._invariants.unseen.values())
            self._measure_memory()
            show(self.figures)
            if len(self.figures.violations) >= VIOLATIONS_SHOWN:
                break
        self._drawn = Drawn(0, [], [])  # what grew in all of them is not the fault of the last program
        self._invariants.check_memory(self._growth, self.progress['cycles'])

    def _measure_memory(self) -> None:
        """Compare the memory of the processes with that after the warm-up."""
        now = {}
        for child in self._bringup.processes():
            with suppress(psutil.NoSuchProcess):
                now[child.pid] = memory_mb(child.pid)
        figures = self.figures
        self._memory.append((figures.cycles, now))
        warm = [sample for sample in self._memory if sample[0] >= WARM_UP * figures.cycles]
        cycles, then = warm[0]
        survivors = then.keys() & now.keys()
        figures.rss_start_mb = sum(then[pid][0] for pid in survivors)
        figures.rss_end_mb = sum(now[pid][0] for pid in survivors)
        figures.rss_cycles = figures.cycles - cycles
        own = [sum(sample[pid][1] for pid in survivors if pid in sample) for _, sample in warm]
        self._growth = growth = growth_of([cycles for cycles, _ in warm], own)
        if growth.cycles:
            figures.growth_mb, figures.growth_half_width_mb = growth.slope_mb, growth.half_width_mb

    def _run_program(self, drawn: Drawn) -> None:
        figures = self.figures
        before = self._count()
        self._log.end()
        if not drawn.faults:
            self._log.begin()
        try:
            self.drive(drawn.moves, drawn.faults)
        except ProgramError as error:
            figures.refused += 1
            figures.refusal = str(error)
            return
        figures.programs += 1
        figures.injected += len(drawn.faults)
        for kind in drawn.kinds:
            figures.kinds[kind] = figures.kinds.get(kind, 0) + 1
        reported = self.observe(OBSERVED_S + drawn.last_fault_s)
        figures.stopped += reported is not None
        if not drawn.faults:
            self._look_back(drawn, reported)
        try:
            self.make_ready(HOME_M)
            figures.survived += len(drawn.faults)
        except Delta3Error as error:
            self._violate(f'not recovered: {error}', self.progress['cycles'])
            self.replace_the_machine()
            self.make_ready(HOME_M)
        self._compare(drawn, before, complete=reported is None)

    def _look_back(self, drawn: Drawn, reported: RobotFault | None) -> None:
        """Judge a program that nothing was to disturb."""
        if reported is not None:
            self._violate(f'stopped without an injected fault: {reported}', reported.cycle)
            return
        self.let_pass(SETTLE_S)
        error, end = self._invariants.check_undisturbed(self._log.end(), drawn.end_m)
        figures = self.figures
        figures.undisturbed += 1
        figures.error_max_m = max(figures.error_max_m, error)
        figures.end_max_m = max(figures.end_max_m, end)

    def _count(self) -> _Counters:
        """Read the counters of lost telegrams."""
        mdt = tuple(self.mdt_losses(axis) for axis in DRIVES)
        return _Counters(self._invariants.session, int(self.fresh()['lost_telegrams']), mdt)

    def _compare(self, drawn: Drawn, before: _Counters, complete: bool) -> None:
        """Compare the telegrams that are missing after program and recovery with those that were taken away."""
        now = self._count()
        if now.session != before.session or 'kill' in drawn.kinds:
            return  # others count now, or drives have stopped without a master
        complete = complete and not PROCESS_FAULTS.intersection(drawn.kinds)
        figures, cycle = self.figures, self.progress['cycles']
        injected, apart = drawn.lost(AT_LOSSES)
        figures.lost_at += now.at - before.at
        figures.lost_at_injected += injected
        self._invariants.check_losses('AT', now.at - before.at, injected, complete and apart, cycle)
        for axis, lost, lost_before in zip(DRIVES, now.mdt, before.mdt, strict=True):
            injected, apart = drawn.lost(MDT_LOSSES, axis)
            figures.lost_mdt += lost - lost_before
            figures.lost_mdt_injected += injected
            what = f'MDT of {axis}'
            self._invariants.check_losses(what, lost - lost_before, injected, complete and apart, cycle)


def run_soak(
    seconds: float,
    seed: int,
    pace: str,
    factor: float,
    figures: Figures,
    show: Callable[[Figures], None],
    replay: int | None = None,
) -> None:
    """Bring a robot of separate processes up and soak it; adds to ``figures``, of which ``show`` is told.

    Raises
    ------
    KeyboardInterrupt
        A signal has ended it.

    """
    bringup = Bringup(Options(program=None, real_time_factor=factor), schedule=Schedule.PREFERRED)
    run_operated(bringup, lambda: Soak(bringup, core.load(), seed, pace, figures).run(seconds, show, replay))
