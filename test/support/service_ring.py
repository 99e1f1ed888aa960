"""A service channel between a controller and a drive, with latency, loss and repetition."""

from collections import deque

from hypothesis import strategies as st

from delta3_pacdrive.robot.sercos.service_channel import IDLE, Access, Answer, Operation, parse_idn
from delta3_pacdrive.robot.sercos.service_endpoints import ANSWER_CYCLES_MAX, ServiceMaster, ServiceSlave

KV, K_I, MASS_OBSERVER, SPEED, UNKNOWN = (
    parse_idn(text) for text in ('S-0-0104', 'P-0-0011', 'P-0-0022', 'S-0-0040', 'S-0-4000')
)
WORDS = st.integers(0, 0xFFFF)
IDNS = st.integers(0, 0xFFFF)
VALUES = st.floats(allow_nan=True, allow_infinity=True, width=64)
ACCESSES = st.builds(Access, IDNS, st.sampled_from(Operation), VALUES)


class Memory:
    """A drive that stores every written value, and records every access."""

    def __init__(self):
        self.values = {}
        self.accesses = []

    def __call__(self, access):
        assert isinstance(access.operation, Operation)
        self.accesses.append(access)
        if access.operation == Operation.WRITE:
            self.values[access.idn] = access.value
        return Answer(access.idn, value=self.values.get(access.idn, -0.0))


class Ring:
    """Master and slave joined by telegrams that take whole cycles, get lost or come twice."""

    def __init__(self, handler, there=1, back=1, **options):
        self.master = ServiceMaster(**options)
        self.slave = ServiceSlave(handler)
        self.latencies = there, back
        self.mdts, self.ats = deque([None] * there), deque([None] * back)
        self.answers = []
        self.cycle = 0

    def step(self, mdt='once', at='once', drive_alive=True):
        """Run one bus cycle; ``mdt`` and ``at`` give the faults of its arriving telegrams."""
        word = self.ats.popleft()
        if word is not None:
            for taken in {'once': [word], 'twice': [word, word], 'lost': [None], 'empty': [IDLE]}[at]:
                self._take(self.master.received(taken))
        self.mdts.append(self.master.to_send())
        word = self.mdts.popleft()
        if word is not None and drive_alive:
            for taken in {'once': [word], 'twice': [word, word], 'lost': [], 'empty': [IDLE]}[mdt]:
                self.slave.received(taken)
        self.ats.append(self.slave.to_send() if drive_alive else IDLE)
        self.cycle += 1

    def _take(self, answer):
        if answer is not None:
            self.answers.append(answer)

    def access(self, access, **events):
        """Run one access to its end; return the answer and the cycles from its request on."""
        self.master.request(access)
        begin, count = self.cycle, len(self.answers)
        while len(self.answers) == count:
            assert self.cycle - begin < 3 * ANSWER_CYCLES_MAX, 'the access has no end'
            self.step(**events)
        return self.answers[-1], self.cycle - begin

    def read(self, idn):
        return self.access(Access(idn, Operation.READ))[0]

    def write(self, idn, value):
        return self.access(Access(idn, Operation.WRITE, value))[0]


def events(cycles, kinds):
    return st.dictionaries(st.integers(0, cycles), st.tuples(st.sampled_from(kinds), st.sampled_from(kinds)))
