"""Belts of a simulated cell on the bus: their description for the controller, and their readings in the AT."""

from delta3_pacdrive.belts.meeting import BeltAxes
from delta3_pacdrive.belts.synchronization import TrackWindow
from delta3_pacdrive.belts.tracking import BeltReading
from delta3_pacdrive.cell.cell import Cell
from delta3_pacdrive.cell.world import World


def axes_of(cell: Cell) -> tuple[BeltAxes, ...]:
    """Return the belts of a cell as described to a controller, in the order of their readings."""
    return tuple(
        BeltAxes(
            name=belt.name,
            origin_m=belt.origin_m,
            direction_rad=belt.direction_rad,
            increments_per_m=belt.increments_per_m,
            window=None if belt.window_m is None else TrackWindow(*belt.window_m),
            barrier_m=0.0 if belt.barrier is None else belt.barrier.at_m,
            barrier_delay_s=0.0 if belt.barrier is None else belt.barrier.delay_s,
            camera_every_m=0.0 if belt.camera is None else belt.camera.every_m,
            types=() if belt.camera is None else tuple(cell.parts),
        )
        for belt in cell.belts.values()
    )


def readings(world: World) -> list[BeltReading]:
    """Return the reading of each belt in the AT of the present bus cycle.

    The light barrier is only used on belts without a camera, because both would report each part.
    """
    return [
        BeltReading(
            state.count,
            () if name in world.sightings else tuple(latch.count for latch in state.latches),
            tuple(world.sightings.get(name, ())),
            world.pictures(name),
        )
        for name, state in world.belts.items()
    ]
