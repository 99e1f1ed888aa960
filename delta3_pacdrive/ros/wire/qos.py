"""Quality of service profiles; ``interfaces`` assigns them to topics and gives the reasons."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

CYCLIC_PUBLISHER = QoSProfile(depth=256)
CYCLIC_SUBSCRIPTION = QoSProfile(depth=64, reliability=ReliabilityPolicy.BEST_EFFORT)
# for networks that may lose packets: without one message of the exchange a bus cycle would never be complete
CYCLIC_FROM_AFAR = QoSProfile(depth=64)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
LATCHED_FROM_MANY = QoSProfile(depth=16, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PLAN = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=1)
# Keeps the rows of the newest plans, more than can be pending (UNCHECKED_MAX in ros/planner/planner_outputs).
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
NEWEST_FEW = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)

# Two seconds of an oscilloscope: a shorter delay of a reader loses nothing, and no drive ever waits for a reader.
SAMPLES = QoSProfile(depth=256)

# Recorder: best effort, because a late recorder cannot absorb bursts of repeated messages either. Its queue is deep,
# and it counts missing messages.
RECORDER = QoSProfile(depth=4000, reliability=ReliabilityPolicy.BEST_EFFORT)
# State changes in quick succession, such as outputs: every one is recorded, not only the newest.
LATCHED_RECORDER = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)

# For a process that checks every telegram of a robot without a clock (9000 cycles a second) and takes a gap for a bus
# fault: it may be delayed for seconds.
WATCHER = QoSProfile(depth=40_000, reliability=ReliabilityPolicy.BEST_EFFORT)
