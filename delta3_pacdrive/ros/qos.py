"""Profiles of quality of service; ``interfaces`` says which topic has which, and why."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

CYCLIC_PUBLISHER = QoSProfile(depth=256)
CYCLIC_SUBSCRIPTION = QoSProfile(depth=64, reliability=ReliabilityPolicy.BEST_EFFORT)
# where a network may lose packets: without a message of the exchange no bus cycle would ever come to its end
CYCLIC_FROM_AFAR = QoSProfile(depth=64)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
LATCHED_FROM_MANY = QoSProfile(depth=16, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PLAN = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=1)
# Rows of the newest plans are kept, more of them than are ever under way (UNCHECKED_MAX in controller/plan_rows).
PLAN_WRITER = QoSProfile(depth=2000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PLAN_LATECOMER = QoSProfile(
    history=HistoryPolicy.KEEP_ALL, depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
PLAN_SHOWN = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
REQUEST = QoSProfile(depth=100)
FAULTS = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=1)
FACTS = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
REPORT = QoSProfile(depth=10)

# Two seconds of an oscilloscope: nothing is lost while a reader is held up for less, and no drive ever waits for one.
SAMPLES = QoSProfile(depth=256)

# What a recorder reads: best effort as well, since repeats would come in bursts that a recorder that lags could absorb
# even less; its queue is deep, and it counts what is missing.
RECORDER = QoSProfile(depth=4000, reliability=ReliabilityPolicy.BEST_EFFORT)
# Changes of a state in quick succession, such as outputs: each counts, not the newest alone.
LATCHED_RECORDER = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)

# What watches every telegram of a robot without a clock, 9000 cycles a second, and takes a gap for a fault of the bus:
# it may be held up for seconds.
WATCHER = QoSProfile(depth=40_000, reliability=ReliabilityPolicy.BEST_EFFORT)
