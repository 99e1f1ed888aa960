"""The 1 kHz transformation task: set points, feedback, waits, and the signals of a bus cycle."""
