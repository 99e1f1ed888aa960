"""Planning beside the thread that must answer: one job at a time, with its progress, until it is done or given up."""

import queue
import threading
import traceback
from collections.abc import Callable, Iterator

from delta3_pacdrive.controller.planning_job import CancelledError, Job, Result, work
from delta3_pacdrive.errors import Code, Reason, shown
from delta3_pacdrive.motion.output_names import OWN, OutputNames
from delta3_pacdrive.parameters import Parameters

JOIN_S = 2.0  # that a job may take to notice that it is given up


class PlanningThread:
    """A thread that does jobs; its results are fetched, and ``log`` is told of what should not have happened.

    ``outputs`` are those that programs may name.
    """

    def __init__(
        self, parameters: Parameters, log: Callable[[str], None], outputs: OutputNames = OWN
    ) -> None:
        self._robot, self._log, self._outputs = parameters, log, outputs
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._results: queue.SimpleQueue[Result] = queue.SimpleQueue()
        self._given_up = 0  # newest job that is
        self._state = (0, 0, 0)  # number of the job, statements done and of all
        self._newest = self._fetched = 0  # numbers of jobs
        self._thread = threading.Thread(target=self._run, name='planning', daemon=True)
        self._thread.start()

    def begin(self, job: Job) -> None:
        """Do a job behind those that are under way."""
        self._newest = job.number
        self._jobs.put(job)

    def cancel(self, number: int) -> None:
        """Give a job up."""
        self._given_up = max(self._given_up, number)

    def results(self) -> Iterator[Result]:
        """Return what has been done since the last call."""
        while not self._results.empty():
            result = self._results.get()
            self._fetched = result.number
            yield result

    @property
    def busy(self) -> bool:
        """Whether the result of a job is still to come."""
        return self._fetched < self._newest

    def progress(self) -> str:
        """Say how far a job is that is under way, empty if none is."""
        number, done, total = self._state
        return f'planning move {done + 1} of {total}' if number > self._given_up and total else ''

    def close(self) -> None:
        """Give everything up and end."""
        self.cancel(self._newest)
        self._jobs.put(None)
        self._thread.join(JOIN_S)

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            number = job.number

            def note(done: int, total: int, number: int = number) -> None:
                if number <= self._given_up:
                    raise CancelledError('the planning was given up')
                self._state = (number, done, total)

            try:
                result = work(job, self._robot, note, self._outputs)
            except Exception as error:  # noqa: BLE001 (no program, whoever sends it, ends the planner)
                self._log(traceback.format_exc())
                sentence = f'{type(error).__name__}: {shown(str(error))}'
                result = Result(number, None, None, Reason(Code.CONTENT, sentence))
            self._state = (0, 0, 0)
            self._results.put(result)
