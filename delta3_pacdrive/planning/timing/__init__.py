"""Timing of moves: profiles within the limits, time-optimal moves, blends, input shaping."""
