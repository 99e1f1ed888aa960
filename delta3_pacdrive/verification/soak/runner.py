"""Runner of the soak test: executes random programs with random faults and checks every telegram."""

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
from delta3_pacdrive.robot.faults.fault import AT_LOSSES, MDT_LOSSES, PROCESS_FAULTS
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.verification.invariants import Growth, Invariants, growth_of
from delta3_pacdrive.verification.operator import AutomatedOperator, run_operated
from delta3_pacdrive.verification.soak.programs import Drawn, draw
from delta3_pacdrive.verification.telegram_log import TelegramLog

HOME_M = (0.0, 0.0, -0.8)
OBSERVED_S = 0.3
SETTLE_S = 0.1  # after the end of a program, before its end point is checked
VIOLATIONS_SHOWN = 10
WARM_UP = 1 / 3  # of the cycles: caches fill, kernels and modules are loaded
UNSEEN_MAX = 0.1  # share of bus cycles with lost telegrams above which a run is not conclusive


@dataclass
class Violation:
    """A violated invariant."""

    sentence: str
    seed: int
    pace: str
    number: int  # of the program, for ``--replay``; 0: no single program
    cycle: int
    program: str  # with its faults, in YAML


@dataclass
class Figures:
    """Figures of a soak test."""

    programs: int = 0
    refused: int = 0
    undisturbed: int = 0
    cycles: int = 0
    unseen: int = 0  # cycles with a lost telegram, on the topic with most of them
    injected: int = 0
    stopped: int = 0
    survived: int = 0
    lost_at: int = 0
    lost_at_injected: int = 0
    lost_mdt: int = 0
    lost_mdt_injected: int = 0
    error_max_m: float = 0.0  # undisturbed programs: true TCP from its command
    end_max_m: float = 0.0  # undisturbed programs: end from its intended point
    rss_start_mb: float = 0.0  # resident memory of the surviving processes after the warm-up
    rss_end_mb: float = 0.0
    rss_cycles: int = 0  # between these two
    growth_mb: float | None = None  # of unshared memory in 100,000 cycles; None: too few programs
    growth_half_width_mb: float | None = None
    kinds: dict[str, int] = field(default_factory=dict)  # injected faults by kind
    refusal: str = ''  # reason of the last rejected program
    violations: list[Violation] = field(default_factory=list)

    @property
    def watched(self) -> bool:
        """Whether nearly all telegrams were received."""
        return self.unseen <= UNSEEN_MAX * self.cycles

    @property
    def ok(self) -> bool:
        """Whether programs ran and were watched, without a violation, and every fault was survived."""
        looked = bool(self.programs) and self.watched
        return looked and not self.violations and self.survived == self.injected


@dataclass(frozen=True)
class _Counters:
    """Lost telegrams counted by drives and master in one session of the bus."""

    session: bytes
    at: int
    mdt: tuple[int, ...]


def memory_mb(pid: int) -> tuple[float, float]:
    """Return the resident memory of a process, and its part without file pages [MB]."""
    memory = psutil.Process(pid).memory_info()
    return memory.rss / 1e6, (memory.rss - memory.shared) / 1e6


class Soak(AutomatedOperator):
    """Runs random programs with faults on a running robot, and adds to ``figures``."""

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
            Violation(
                sentence=sentence,
                seed=self._seed,
                pace=self._pace,
                number=drawn.number,
                cycle=cycle,
                program=drawn.to_yaml(),
            )
        )

    def update(self) -> None:
        """Check every telegram against the invariants."""
        self._invariants.check_all(self._log.read())

    def run(self, seconds: float, show: Callable[[Figures], None], replay: int | None = None) -> None:
        """Run for a time [s], or only the program of a given number."""
        started = time.monotonic()
        first_cycle = self.fresh().cycles
        self.make_ready(HOME_M)
        numbers: Iterable[int] = count(1) if replay is None else (replay,)
        for number in numbers:
            if replay is None and time.monotonic() - started > seconds:
                break
            self._drawn = draw(self._seed, self._pace, number)
            self._run_program(self._drawn)
            self.figures.cycles = self.progress.cycles - first_cycle
            self.figures.unseen = max(self._invariants.unseen.values())
            self._measure_memory()
            show(self.figures)
            if len(self.figures.violations) >= VIOLATIONS_SHOWN:
                break
        self._drawn = Drawn(0, [], [])  # memory growth is not caused by the last program alone
        self._invariants.check_memory(self._growth, self.progress.cycles)

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
            self._check_undisturbed(drawn, reported)
        try:
            self.make_ready(HOME_M)
            figures.survived += len(drawn.faults)
        except Delta3Error as error:
            self._violate(f'not recovered: {error}', self.progress.cycles)
            self.replace_the_machine()
            self.make_ready(HOME_M)
        self._compare(drawn, before, complete=reported is None)

    def _check_undisturbed(self, drawn: Drawn, reported: RobotFault | None) -> None:
        """Check a program without faults."""
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
        return _Counters(self._invariants.session, int(self.fresh().lost_telegrams), mdt)

    def _compare(self, drawn: Drawn, before: _Counters, complete: bool) -> None:
        """Compare the telegrams lost during program and recovery with the injected losses."""
        now = self._count()
        if now.session != before.session or 'kill' in drawn.kinds:
            return  # the counters have restarted, or drives have stopped without a master
        complete = complete and not PROCESS_FAULTS.intersection(drawn.kinds)
        figures, cycle = self.figures, self.progress.cycles
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
    """Start a robot of separate processes and run the soak test; adds to ``figures`` and passes them to ``show``.

    Raises
    ------
    KeyboardInterrupt
        A signal ended the test.

    """
    bringup = Bringup(Options(program=None, real_time_factor=factor), schedule=Schedule.PREFERRED)
    run_operated(bringup, lambda: Soak(bringup, core.load(), seed, pace, figures).run(seconds, show, replay))
