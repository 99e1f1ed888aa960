"""Planning in a background thread: one job at a time, with progress and cancellation."""

import queue
import threading
import traceback
from collections.abc import Callable, Iterator

from delta3_pacdrive.control.queue.planning_job import CancelledError, Job, Result, run_job
from delta3_pacdrive.errors import Code, Reason, shown
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.program.output_names import OWN, OutputNames

JOIN_S = 2.0  # timeout for a cancelled job to end


class PlanningThread:
    """A thread that executes planning jobs; unexpected exceptions go to ``log``.

    ``outputs`` are the output names that programs may use.
    """

    def __init__(
        self, parameters: Parameters, log: Callable[[str], None], outputs: OutputNames = OWN
    ) -> None:
        self._robot, self._log, self._outputs = parameters, log, outputs
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._results: queue.SimpleQueue[Result] = queue.SimpleQueue()
        self._given_up = 0  # newest cancelled job
        self._state = (0, 0, 0)  # number of the job, planned statements, all statements
        self._newest = self._fetched = 0  # numbers of jobs
        self._thread = threading.Thread(target=self._run, name='planning', daemon=True)
        self._thread.start()

    def begin(self, job: Job) -> None:
        """Queue a job."""
        self._newest = job.number
        self._jobs.put(job)

    def cancel(self, number: int) -> None:
        """Cancel all jobs up to a number."""
        self._given_up = max(self._given_up, number)

    def results(self) -> Iterator[Result]:
        """Yield the results since the last call."""
        while not self._results.empty():
            result = self._results.get()
            self._fetched = result.number
            yield result

    @property
    def busy(self) -> bool:
        """Whether the result of a job is pending."""
        return self._fetched < self._newest

    def progress(self) -> str:
        """Return the progress of the current job, empty if there is none."""
        number, done, total = self._state
        return f'planning move {done + 1} of {total}' if number > self._given_up and total else ''

    def close(self) -> None:
        """Cancel all jobs and end the thread."""
        self.cancel(self._newest)
        self._jobs.put(None)
        self._thread.join(JOIN_S)

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            number = job.number

            def note(done: int, total: int, number: int = number) -> None:
                if number <= self._given_up:
                    raise CancelledError('planning was cancelled')
                self._state = (number, done, total)

            try:
                result = run_job(job, self._robot, note, self._outputs)
            except Exception as error:  # noqa: BLE001 (no program may terminate the planner)
                self._log(traceback.format_exc())
                sentence = f'{type(error).__name__}: {shown(str(error))}'
                result = Result(number, None, None, Reason(Code.CONTENT, sentence))
            self._state = (0, 0, 0)
            self._results.put(result)
