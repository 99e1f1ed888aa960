"""Tests of the schedule of pending events of the transformation task."""

from delta3_pacdrive.control.cycle.stages import Event, Schedule
from delta3_pacdrive.robot.sercos.bus_time import NEVER


def test_events_of_a_cycle_are_handled_once_in_the_order_of_their_kinds() -> None:
    handled = []
    schedule = Schedule(
        {event: lambda *given, event=event: handled.append((event, *given)) for event in Event}
    )
    assert schedule.next_cycle == NEVER
    schedule.set(Event.DISABLE, 5)
    schedule.set(Event.STOP, 5, True)
    schedule.set(Event.PROFILE, 9, 'later')
    schedule.set(Event.PLAN, 3, 'replaced')
    schedule.set(Event.PLAN, 4, 'plan')
    schedule.handle(3)
    assert (handled, schedule.next_cycle) == ([], 4)
    schedule.handle(5)
    assert handled == [(Event.PLAN, 5, 'plan'), (Event.STOP, 5, True), (Event.DISABLE, 5, None)]
    assert schedule.cycles == [9, NEVER, NEVER, NEVER, NEVER]
    schedule.cancel(Event.PROFILE, Event.STOP)
    assert (schedule.next_cycle, schedule.contents) == (NEVER, [None] * len(Event))


def test_event_scheduled_by_a_handler_for_the_same_cycle_is_handled_if_its_kind_is_later() -> None:
    handled = []
    schedule: Schedule
    handlers = {event: lambda cycle, _, event=event: handled.append(event) for event in Event}
    handlers[Event.STOP] = lambda cycle, _: (
        schedule.set(Event.DISABLE, cycle),
        schedule.set(Event.PLAN, cycle),
    )
    schedule = Schedule(handlers)
    schedule.set(Event.STOP, 2)
    schedule.handle(2)
    assert (handled, schedule.cycles[Event.PLAN]) == ([Event.DISABLE], 2)
