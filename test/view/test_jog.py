"""Tests of jogging: held buttons, stop of the motion, and direction."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.view.jog import (
    DIRECTIONS,
    HEARTBEAT_HZ,
    SILENT_S,
    STOP_AGAIN_S,
    TRANSITIONS,
    Jog,
    JogAction,
    JogEvent,
    JogState,
    parse,
)

BEAT_S = 1.0 / HEARTBEAT_HZ


def hold(jog, direction, start_s, seconds):
    """Hold a button for a time; return the result of every check, and the time of the last beat."""
    turns, now = [], start_s
    while now < start_s + seconds:
        jog.heartbeat(direction, now)
        turns.append(jog.update(now))
        now += BEAT_S
    return turns, now - BEAT_S


def moving(direction='+x'):
    """Return a jog that moves the robot, its button held until 0."""
    jog = Jog()
    hold(jog, direction, -0.1, 0.1)
    jog.heartbeat(direction, 0.0)
    assert jog.start(jog.number)
    jog.accepted(jog.number)
    assert jog.state is JogState.MOVING
    return jog


def test_a_button_is_pressed_once_however_long_it_is_held():
    jog = Jog()
    turns, _ = hold(jog, '+x', 10.0, 2.0)
    assert turns[0] is JogAction.START
    assert set(turns[1:]) == {JogAction.NOTHING}
    assert (jog.direction, jog.number) == ('+x', 1)


def test_silence_stops_the_started_motion():
    jog = moving('-z')
    assert jog.update(SILENT_S) is JogAction.NOTHING
    assert jog.update(SILENT_S + 0.01) is JogAction.STOP
    assert jog.update(SILENT_S + 0.02) is JogAction.NOTHING  # it is asked for
    jog.stopped(SILENT_S + 0.03)
    assert jog.update(SILENT_S + 1.0) is JogAction.NOTHING
    assert jog.state is JogState.FREE


def test_unanswered_stop_is_requested_again():
    jog = moving()
    for now in (1.0, 11.0, 21.0):
        assert jog.update(now) is JogAction.STOP
        jog.unconfirmed()
    assert jog.update(31.0) is JogAction.STOP
    jog.stopped(31.1)
    assert jog.update(32.0) is JogAction.NOTHING


def test_button_without_heartbeats_is_not_pressed():
    assert Jog().update(123.0) is JogAction.NOTHING


def test_the_first_of_two_buttons_counts_until_it_is_released():
    jog = Jog()
    jog.heartbeat('+x', 0.0)
    jog.heartbeat('-y', 0.0)
    assert jog.update(0.0) is JogAction.START
    jog.heartbeat('-y', 0.2)
    assert jog.direction == '+x'
    assert jog.update(0.3) is JogAction.NOTHING
    jog.heartbeat('-y', 0.3)
    assert jog.update(0.3) is JogAction.START
    assert jog.direction == '-y'


def test_rejected_jog_is_not_repeated_before_release_of_the_button():
    jog = Jog()
    hold(jog, '+x', 0.0, 0.1)
    jog.refused(jog.number)
    turns, last = hold(jog, '+x', 0.1, 1.0)
    assert set(turns) == {JogAction.NOTHING}
    assert jog.update(last + 2 * SILENT_S) is JogAction.NOTHING
    assert hold(jog, '+x', last + 2 * SILENT_S, 0.1)[0][0] is JogAction.START


def test_released_press_does_not_start_although_the_button_is_pressed_again():
    jog = Jog()
    hold(jog, '+x', 0.0, 0.1)
    first = jog.number
    assert jog.update(1.0) is JogAction.NOTHING
    assert hold(jog, '+x', 1.0, 0.1)[0][0] is JogAction.START
    assert not jog.start(first)
    jog.refused(first)
    assert jog.is_pending(jog.number)
    assert jog.start(jog.number)


def test_heartbeats_with_a_pause_are_two_presses_however_late_they_are_read():
    jog = moving()
    jog.heartbeat('+x', 2.0)
    jog.heartbeat('+x', 2.1)
    assert jog.state is JogState.STOPPING
    assert jog.update(2.1) is JogAction.STOP


def test_release_during_the_start_sends_stop_until_the_reply_and_once_more_afterwards():
    jog = Jog()
    hold(jog, '+x', 0.0, 0.1)
    assert jog.start(jog.number)
    now = 1.0
    for _ in range(3):
        assert jog.update(now) is JogAction.STOP
        jog.stopped(now)  # refused: nothing moves yet
        assert jog.update(now + 0.5 * STOP_AGAIN_S) is JogAction.NOTHING
        now += 1.01 * STOP_AGAIN_S
    jog.accepted(jog.number)
    assert jog.update(now) is JogAction.STOP
    jog.stopped(now)
    assert (jog.state, jog.update(now + 1.0)) == (JogState.FREE, JogAction.NOTHING)


def test_unanswered_start_is_stopped_while_the_button_is_held():
    jog = Jog()
    _, last = hold(jog, '+x', 0.0, 0.1)
    assert jog.start(jog.number)
    jog.lost(jog.number)
    assert jog.update(last) is JogAction.STOP
    jog.stopped(last)
    assert set(hold(jog, '+x', last, 1.0)[0]) == {JogAction.NOTHING}


def test_stop_of_another_client_cancels_a_jog_for_good():
    jog = moving()
    jog.cancel()
    assert jog.update(0.0) is JogAction.STOP  # a jog that was held could be resumed
    jog.stopped(0.0)
    assert set(hold(jog, '+x', 0.01, 1.0)[0]) == {JogAction.NOTHING}


AT = {  # how a jog gets into each state
    JogState.FREE: (),
    JogState.PRESSED: (JogEvent.PRESS,),
    JogState.STARTING: (JogEvent.PRESS, JogEvent.START),
    JogState.MOVING: (JogEvent.PRESS, JogEvent.START, JogEvent.ACCEPT),
    JogState.REVOKED: (JogEvent.PRESS, JogEvent.START, JogEvent.CANCEL),
    JogState.STOPPING: (JogEvent.PRESS, JogEvent.START, JogEvent.ACCEPT, JogEvent.CANCEL),
}


class Bench:
    """A jog to which events happen, at times that pass."""

    def __init__(self):
        self.jog, self.now = Jog(), 0.0

    def happen(self, event):
        jog = self.jog
        self.now += 2.0 * SILENT_S
        if event is JogEvent.PRESS:
            jog.heartbeat('+x', self.now)
            jog.update(self.now)
        elif event is JogEvent.CANCEL:
            jog.cancel()
        elif event is JogEvent.SETTLE:
            jog.stopped(self.now)
        else:
            does = {'start': jog.start, 'accept': jog.accepted, 'refuse': jog.refused, 'lose': jog.lost}
            does[event](jog.number)
        return jog.state


@pytest.mark.parametrize('event', [event for event in JogEvent if event is not JogEvent.PRESS])
@pytest.mark.parametrize('state', JogState)
def test_every_event_leads_to_the_state_of_the_table(state, event):
    bench = Bench()
    for before in AT[state]:
        bench.happen(before)
    assert bench.jog.state is state
    assert bench.happen(event) is TRANSITIONS.get((state, event), state)


class Robot:
    """A robot that carries out requests of a view after a delay, and may lose replies."""

    def __init__(self):
        self.moves = False
        self.start_due = self.answer_due = self.stop_due = math.inf


@given(
    steps=st.lists(
        st.tuples(
            st.sampled_from(['hold', 'hold', 'quiet', 'other refused', 'urgent', 'refuse']),
            st.sampled_from([0.0, 0.02, 0.3, 5.0]),  # until the start arrives
            st.sampled_from([0.01, 0.4, math.inf]),  # until it is answered
            st.sampled_from([0.01, 0.2, math.inf]),  # until a stop is answered
        ),
        max_size=40,
    )
)
def test_robot_never_continues_without_a_held_button_in_any_failure(steps):
    jog, robot, now, sent, stop_lost = Jog(), Robot(), 0.0, 0, False

    def pass_time(seconds, held, start_s, answer_s, stop_s, refuse=False):
        nonlocal now, sent, stop_lost
        end = now + seconds
        while now < end:
            now += 0.01
            if held:
                jog.heartbeat('+x', now)
            turn = jog.update(now)
            if turn is JogAction.STOP:
                robot.stop_due, stop_lost = now + min(stop_s, 1.0), math.isinf(stop_s)
            if robot.start_due == math.inf == robot.answer_due and jog.is_pending(jog.number):
                if refuse:
                    jog.refused(jog.number)
                elif jog.start(jog.number):
                    sent = jog.number
                    robot.start_due, robot.answer_due = now + start_s, now + max(start_s, min(answer_s, 6.0))
                    robot.lost = math.isinf(answer_s)
            if now >= robot.start_due:
                robot.moves, robot.start_due = True, math.inf
            if now >= robot.stop_due:
                robot.stop_due = math.inf
                if stop_lost:  # neither the stop nor its answer
                    jog.unconfirmed()
                else:
                    robot.moves = False
                    jog.stopped(now)
            if now >= robot.answer_due and robot.start_due == math.inf:
                robot.answer_due = math.inf
                (jog.lost if robot.lost else jog.accepted)(sent)

    for step, start_s, answer_s, stop_s in steps:
        if step == 'urgent':
            jog.cancel()
        if step == 'other refused':
            jog.refused(jog.number - 1)
        held = step in ('hold', 'refuse')
        pass_time(0.4, held, start_s, answer_s, stop_s, step == 'refuse')
    pass_time(10.0, False, 0.0, 0.01, 0.01)
    assert not robot.moves
    assert jog.state is JogState.FREE
    assert hold(jog, '-y', now + 1.0, 0.1)[0][0] is JogAction.START


@pytest.mark.parametrize('text', ['', '+x', '+w 10', '+x ten', '+x nan', '+x inf', '+x -1', '+x 0', '+x 1 2'])
def test_invalid_page_request_is_rejected(text):
    with pytest.raises(ProgramError, match='is not a direction'):
        parse(text, 1)


def test_page_requests_contain_direction_and_numbers():
    assert parse('-z 10 50', 2) == ('-z', [10.0, 50.0])


def test_the_direction_of_a_held_button_is_sent_only_while_the_robot_is_moved_by_it():
    jog = Jog()
    hold(jog, '-z', 0.0, 0.1)
    assert jog.velocity is None
    assert jog.start(jog.number)
    assert jog.velocity is None
    jog.accepted(jog.number)
    assert jog.velocity == DIRECTIONS['-z'] == (0.0, 0.0, -1.0)
    jog.update(0.1 + 2 * SILENT_S)
    assert jog.velocity is None
