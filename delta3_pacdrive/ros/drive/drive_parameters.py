"""ROS parameters of a drive that can be changed in cyclic operation: its IDNs under their ROS names."""

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from delta3_pacdrive.errors import Code, Reason
from delta3_pacdrive.parameters import Parameters, flatten
from delta3_pacdrive.robot.drive.operation_data import OF_PARAMETER, TABLE, refusal
from delta3_pacdrive.robot.drive.register import Register, writing_error
from delta3_pacdrive.robot.sercos.service_channel import Access, Answer, Operation
from delta3_pacdrive.robot.sercos.words import Phase

WRITABLE = {row.sources[0]: idn for idn, row in TABLE.items() if Phase.CP4 in row.writable_in}  # IDN by name


class DriveParameters:
    """Keeps the ROS parameters of one drive consistent with its register, which validates every write."""

    def __init__(self, node: Node, axis: str, register: Register) -> None:
        self._node, self._axis, self._register = node, axis, register
        self._setting = False
        node.add_on_set_parameters_callback(self._on_set)

    def accepted(self, given: list[Parameter]) -> list[Parameter] | Reason:
        """Return the parameters with integers as floats, or the reason why the service channel rejects them."""
        read = [_as_float(parameter) for parameter in given]
        return next(filter(None, map(self._refusal, read)), read)

    def _refusal(self, parameter: Parameter) -> Reason | None:
        """Return why a parameter cannot be set on its own; None if it can or if ROS checks it."""
        if not self._node.has_parameter(parameter.name):
            return Reason(Code.CONTENT, f'{self._axis} has no parameter {parameter.name}')
        idn = OF_PARAMETER.get(parameter.name)
        if idn is None or parameter.type_ != Parameter.Type.DOUBLE:
            return None
        access = Access(idn, Operation.WRITE, parameter.value)
        error = writing_error(access, Phase.CP4)
        return Reason(Code.CONTENT, refusal(access, Answer(idn, error))) if error else None

    def _on_set(self, parameters: list[Parameter]) -> SetParametersResult:
        if self._setting:
            return SetParametersResult(successful=True)
        before = self._register.parameters
        self._setting = True
        try:
            for parameter in parameters:
                if parameter.name not in WRITABLE:
                    continue
                answer = self._register.write(WRITABLE[parameter.name], float(parameter.value), Phase.CP4)
                if answer.error:
                    self._register.restore(before)  # all or none
                    return SetParametersResult(successful=False, reason=self._register.refusal)
        finally:
            self._setting = False
        return SetParametersResult(successful=True)

    def follow(self, parameters: Parameters, cycle: int) -> None:
        """Update the ROS parameters to the values written in a bus cycle."""
        values = flatten(parameters)
        changed = [
            Parameter(name, value=values[name])
            for name in WRITABLE
            if self._node.get_parameter(name).value != values[name]
        ]
        for parameter in changed:
            self._node.get_logger().info(
                f'{self._axis}: {parameter.name} = {parameter.value:g} from bus cycle {cycle} on'
            )
        if not self._setting:
            self._setting = True
            self._node.set_parameters(changed)
            self._setting = False


def _as_float(parameter: Parameter) -> Parameter:
    if parameter.name in WRITABLE and parameter.type_ == Parameter.Type.INTEGER:
        return Parameter(parameter.name, value=float(parameter.value))
    return parameter
