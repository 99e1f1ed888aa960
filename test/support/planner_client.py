"""A planner without its node, and the messages of a test to it."""

import json
from dataclasses import replace
from typing import Any

from delta3_pacdrive.control.actions import Ordered, Replied
from delta3_pacdrive.control.messages import Origin, Request, Status, Verdict
from delta3_pacdrive.control.queue.planner import Planner
from delta3_pacdrive.control.queue.planning_job import Job, run_job
from delta3_pacdrive.planning.execution import MotionProfile, Timeline
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.recording.motion_progress import MotionProgress

LINE = 'moves: [{move_l: {to_m: [0.1, 0.0, -0.75], speed_m_s: 0.2}}]'
HOME = (0.0, 0.0, -0.75)
ME = 'a1b2c3d4'


class Client:
    """A planner, and the messages of a test to it."""

    def __init__(self, robot: Any) -> None:
        self.robot = robot
        self.cycle = 1000
        self.planner = Planner(robot, ME, None, lambda: self.cycle)
        self.now_s = 0.0
        self.status = Status('5e55', '', 0, ME, 'idle', 'CP4', '', '', 1, HOME, 0, '', '', 0, 0, 0, 1000)
        self.number = 0
        self.say()

    def say(self, **facts: Any) -> bool:
        """Send a status that is newer than the last."""
        self.status = replace(self.status, serial=self.status.serial + 1, **facts)
        return self.planner.receive_status(self.status, self.now_s)

    def do(self, kind: type) -> Any:
        """Take the only action of a kind."""
        (action,) = [action for action in self.planner.actions if isinstance(action, kind)]
        self.planner.actions = [other for other in self.planner.actions if other is not action]
        return action

    def none(self, kind: type) -> bool:
        return not any(isinstance(action, kind) for action in self.planner.actions)

    def ask(self, action: str, text: str = '', operator: str = 'op', control: int = 0) -> Request:
        self.number += 1
        request = Request(ME, operator, self.number, control, action, text)
        self.planner.ask(request, self.now_s)
        return request

    def answer(self) -> tuple[Any, str]:
        replied = self.do(Replied)
        return replied.reason, replied.sentence

    def plan(self) -> None:
        """Do the job that the planner has begun."""
        job = self.do(Job)
        self.planner.take_result(run_job(job, self.robot, lambda *_: None), self.now_s)

    def queue(self, text: str = LINE) -> None:
        self.ask('program', text)
        self.plan()
        assert self.answer()[0] is None

    def order(self) -> Ordered:
        self.queue()
        self.ask('start')
        return self.do(Ordered)

    def verdict(self, number: int, code: str = '', sentence: str = '') -> bool:
        return self.planner.receive_verdict(Verdict('5e55', ME, number, not code, code, sentence), self.now_s)

    def run(self) -> Timeline:
        """Let a program run; return the plan that the transformation task follows."""
        ordered = self.order()
        self.verdict(ordered.number)
        assert self.answer()[0] is None
        self.say(state='moving', order=ordered.number)
        timeline = Timeline(Plan.of(ordered.moves), self.robot.bus.cycle_time_s)
        timeline.start(self.cycle, ordered.row[1])
        self.follow(timeline.profile, 1)
        self.cycle += 50
        return timeline

    def follow(self, profile: MotionProfile | None, number: int) -> bool:
        assert profile is not None
        return self.planner.receive_profile(Origin('COURSE', ME, '5e55', number), profile.to_array())


def progress_text(**values: Any) -> str:
    """Return a report of ``motion/progress``."""
    report = MotionProgress(session='x', phase='x', state='x', tcp_m=(0.0, 0.0, -0.75), remaining_s=0.0)
    return json.dumps(report.to_fields() | values)
