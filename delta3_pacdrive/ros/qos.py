"""Quality of service of every topic, each with its reason."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

# Any client may ask for reliable delivery of a cyclic topic; the depth in cycles is how far a recorder may lag behind.
CYCLIC_PUBLISHER = QoSProfile(depth=256)

# On one machine the flow control of the bus (at most 16 outstanding cycles) keeps queues from overflowing, so that
# acknowledgements, a third of the bus's processor time, buy nothing. A telegram lost all the same is seen by its stamp,
# as on a real SERCOS bus, where cyclic telegrams are never repeated either.
CYCLIC_SUBSCRIPTION = QoSProfile(depth=64, reliability=ReliabilityPolicy.BEST_EFFORT)

# States and facts that latecomers need.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
LATCHED_FROM_MANY = QoSProfile(depth=16, durability=DurabilityPolicy.TRANSIENT_LOCAL)

# Every move of a program, all at once, and changes of its course; who joins later must not take an old one for new.
PLAN = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=1)

# Requests of operators, in the order in which they were made, and the answers to them.
REQUEST = QoSProfile(depth=100)

# Injected faults: none may be missed, however many a program holds.
FAULTS = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=1)

# A topic of which only the newest message counts.
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)

# Slow topics for people and tools.
REPORT = QoSProfile(depth=10)

# What a recorder reads: best effort as well, since repeats would come in bursts that a recorder that lags could absorb
# even less; its queue is deep, and it counts what is missing.
RECORDER = QoSProfile(depth=4000, reliability=ReliabilityPolicy.BEST_EFFORT)

# What watches every telegram of a robot without a clock, 9000 cycles a second, and takes a gap for a fault of the bus:
# it may be held up for seconds.
WATCHER = QoSProfile(depth=40_000, reliability=ReliabilityPolicy.BEST_EFFORT)
