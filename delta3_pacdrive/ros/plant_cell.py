"""The cell of the plant node: inputs, belts, part events, camera pictures, and forced inputs.

In: ``sercos/mdt`` (outputs), ``cell/set_input``. Out, in every cycle: ``sercos/at/io`` (inputs), ``sercos/at/belts``
(counts, parts); on events: ``cell/parts`` and ``cell/scene`` (JSON), ``cell/camera`` (poses of parts in a picture).
Service: ``input``.
"""

import json
import math
import time
from collections.abc import Mapping, Sequence
from typing import Any

from diagnostic_msgs.msg import KeyValue
from diagnostic_msgs.srv import AddDiagnostics
from geometry_msgs.msg import Pose, PoseArray
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from delta3_pacdrive.belts.image import belts_text
from delta3_pacdrive.belts.tracking import BeltReading
from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.cell.bus_world import BusWorld
from delta3_pacdrive.cell.world import World
from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.control.messages import Status
from delta3_pacdrive.control.queue.task_status import TaskStatus
from delta3_pacdrive.errors import Delta3Error, ProgramError, Reason, RefusedError, TelegramError, shown
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.plant.bus_plant import BusPlant
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.bus_time import Clock
from delta3_pacdrive.robot.sercos.telegrams import NO_SESSION
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.task.belt_receiver import parts_of
from delta3_pacdrive.ros.wire import cdr, frames
from delta3_pacdrive.ros.wire.interfaces import (
    BELTS,
    INPUT,
    INPUTS,
    MDT,
    PARTS,
    SCENE,
    SEEN,
    SET_INPUT,
    STATUS,
)
from delta3_pacdrive.ros.wire.publishers import Output
from delta3_pacdrive.simulation.belts import axes_of, readings

REQUEST_MAX = 10_000  # characters
AUTO = 'auto'
VALUES = {'on': True, 'off': False, AUTO: None}  # in a message


class PlantCell:
    """Connects the cell around the robot to the graph; its times count from ``start_cycle``."""

    def __init__(self, node: RobotNode, path: str, start_cycle: int, parameters: Parameters) -> None:
        self._node, self._clock = node, Clock(parameters.bus.cycle_time_s)
        cell = cell_file.load(path)
        start = parameters.motion.start_cycle if start_cycle < 0 else start_cycle
        self._world = World(cell, parameters.bus.cycle_time_s, start)
        self.around = BusWorld(self._world, self, cell.output_names)
        self.inputs, self._axes = cell.input_names, axes_of(cell)
        self.belts = belts_text(self._axes)  # as announced
        self._bus_plant: BusPlant
        self._frame = b''  # of the last MDT; rarely changes
        self._outputs = 0
        self._mdt = cdr.codec(telegrams.mdt(parameters.sends_torque, parameters.axes))
        self._codec = cdr.codec(telegrams.inputs(self.inputs or ('',)))  # unused without inputs
        self._publish = cdr.raw_publish(INPUTS.publisher(node))
        names = [belt.name for belt in self._axes]
        self._belts_codec = cdr.codec(telegrams.belts(names or ('',)))
        self._publish_belts = cdr.raw_publish(BELTS.publisher(node))
        self._seen, self._base = Output(node, SEEN), frames.base_of(node)
        self._parts, self._scene = PARTS.publisher(node), SCENE.publisher(node)
        self._scene.publish(String(data=json.dumps(self._world.scene)))

    def receive_for(self, bus_plant: BusPlant) -> None:
        """Start receiving for a plant."""
        self._bus_plant = bus_plant
        MDT.subscription(self._node, self._on_mdt, raw=True)

    def _on_mdt(self, data: bytes) -> None:
        session = self._bus_plant.slave.session
        if session == NO_SESSION or not self._bus_plant.slave.cyclic:
            return
        try:
            sec, nanosec, frame, _ = self._mdt.decode(data)
            cycle = self._clock.count(sec, nanosec)
            if frame != self._frame:
                self._outputs, self._frame = telegrams.parse_outputs(frame, session), frame
        except TelegramError as error:
            self._node.get_logger().warning(f'plant: {error}', throttle_duration_sec=1.0)
            return
        if cycle >= 0:
            self._bus_plant.clock.take_outputs(cycle, self._outputs)

    def forget(self) -> None:
        """Clear the cached frame of the previous session."""
        self._frame = b''

    # transmission -----------------------------------------------------------------------------------------------------

    def send_inputs(self, cycle: int, inputs: Mapping[str, bool]) -> None:
        """Send the inputs of a bus cycle."""
        values = [float(value) for value in inputs.values()]
        self._publish(self._codec.encode(self._clock.stamp(cycle), self._bus_plant.slave.session, values))

    def send_belts(self, cycle: int) -> None:
        """Send counts and parts of the belts in a bus cycle."""
        found = readings(self._world)
        counts, pictures = [float(one.count) for one in found], [float(one.pictures) for one in found]
        stamp, session = self._clock.stamp(cycle), self._bus_plant.slave.session
        parts = parts_of(self._axes, found)
        if parts and self._seen.wanted:
            self._publish_pictures(found)
        if not parts:
            self._publish_belts(self._belts_codec.encode(stamp, session, counts + pictures))
            return
        message = JointState(
            name=[belt.name for belt in self._axes], position=counts, velocity=pictures, effort=parts
        )
        message.header.frame_id = session.decode()
        message.header.stamp.sec, message.header.stamp.nanosec = stamp
        self._publish_belts(serialize_message(message))

    def _publish_pictures(self, found: Sequence[BeltReading]) -> None:
        """Publish the poses of the parts in camera pictures, stamped with the time of the picture."""
        for belt, reading in zip(self._axes, found, strict=True):
            if not reading.sighted:
                continue
            message = PoseArray()
            message.header.frame_id = self._base
            stamp = self._clock.stamp(self._world.picture_cycle(belt.name))
            message.header.stamp.sec, message.header.stamp.nanosec = stamp
            for part in reading.sighted:
                pose, half = Pose(), 0.5 * (belt.direction_rad + part.angle_rad)
                pose.position.x, pose.position.y, pose.position.z = belt.place_m(part.along_m, part.across_m)
                pose.orientation.z, pose.orientation.w = math.sin(half), math.cos(half)
                message.poses.append(pose)
            self._seen.publish(message)

    def publish_parts(self, document: dict[str, Any]) -> None:
        """Publish the part events of a bus cycle."""
        self._parts.publish(String(data=json.dumps(document)))


class InputRequests:
    """Reads and forces inputs by a service and a topic of the plant; ``around`` is None without a cell.

    The topic has no sender identity and may come from a bag. It is rejected while the status of another robot is
    received.
    """

    def __init__(self, node: RobotNode, around: BusWorld | None) -> None:
        self._node, self._around = node, around
        self._task = TaskStatus()
        INPUT.servers(node, self._on_request)
        if around is not None:
            STATUS.bounded_subscription(node, self._on_status)
            SET_INPUT.bounded_subscription(node, self._on_set_input, self._refuse)

    def _on_status(self, message: String) -> None:
        self._task.take(Status.from_json(message.data), time.monotonic())

    def _on_set_input(self, message: KeyValue) -> None:
        """Force an input as requested by a message."""
        try:
            reason = self._task.played_back(time.monotonic())
            if reason is not None:
                raise RefusedError(reason)
            if message.value not in VALUES:
                raise ProgramError(
                    f'the value of input {shown(message.key)} is {shown(message.value)}, but must be on, off or auto'
                )
            self._set(message.key, VALUES[message.value])
        except Delta3Error as error:
            self._refuse(str(error))

    def _refuse(self, sentence: str) -> None:
        self._node.get_logger().error(f'input refused: {sentence}')

    def _on_request(
        self, request: AddDiagnostics.Request, response: AddDiagnostics.Response
    ) -> AddDiagnostics.Response:
        try:
            response.message = self._answer(request.load_namespace)
            response.success = True
        except Delta3Error as error:
            response.message = str(error)
            self._refuse(str(error))
        return response

    def _answer(self, text: str) -> str:
        around = self._around
        if around is None:
            raise ProgramError('this robot has no inputs: bring it up with --cell')
        if not text:
            return json.dumps(around.to_dict())
        if len(text) > REQUEST_MAX:
            raise ProgramError(f'the request has {len(text)} characters, the limit is {REQUEST_MAX}')
        return self._set(*read_request(yaml_file.parse(text, 'the request', ProgramError)))

    def _set(self, name: str, value: bool | None) -> str:
        """Force an input; return the confirmation, or raise Delta3Error."""
        around = self._around
        if around is None:
            raise ProgramError('this robot has no inputs: bring it up with --cell')
        outcome = around.force(name, value)
        if isinstance(outcome, Reason):
            raise RefusedError(outcome)
        self._node.get_logger().warning(f'input set from outside: {outcome}')
        return outcome


def read_request(document: Any) -> tuple[str, bool | None]:
    """Return the name of an input and its value, None for auto; raises ProgramError."""
    if not isinstance(document, dict) or set(document) != {'name', 'value'}:
        raise ProgramError(f'a request for an input has name and value, not {shown(document)}')
    name, value = document['name'], document['value']
    if not isinstance(name, str):
        raise ProgramError(f'the name of an input must be a text, not {shown(name)}')
    if value == AUTO and isinstance(value, str):
        return name, None
    if not isinstance(value, bool):
        raise ProgramError(f'the value of an input must be true, false or auto, not {shown(value)}')
    return name, value
