"""Conveyor belts: model, camera, part queue, prediction, synchronization, and tracking by the controller."""
