"""Fault catalogue: every fault in every state of a running robot, the reaction and the recovery."""
