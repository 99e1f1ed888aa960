"""Module names of release 0.1 that the documentation used: they keep working in release 0.2, with a warning."""

from __future__ import annotations

import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from importlib.machinery import ModuleSpec
    from types import ModuleType
    from typing import Any

PACKAGE = __name__.partition('.')[0]
RENAMED = {
    'analysis.calibration.data': 'studies.calibration.study',
    'analysis.calibration.estimation': 'studies.calibration.estimation',
    'analysis.calibration.figures': 'studies.calibration.figures',
    'analysis.calibration.model': 'studies.calibration.model',
    'analysis.calibration.planning': 'studies.calibration.planning',
    'analysis.calibration.run': 'studies.calibration.run',
    'analysis.calibration.simulated': 'studies.calibration.simulated',
    'analysis.calibration.study': 'studies.calibration.study',
    'analysis.experiments.run': 'studies.thesis.experiments.run',
    'analysis.experiments.study': 'studies.thesis.experiments.study',
    'analysis.figure_style': 'studies.framework.figure_style',
    'analysis.learning.run': 'studies.learning.run',
    'analysis.learning.study': 'studies.learning.study',
    'analysis.planning.evaluation': 'studies.places.planning.evaluation',
    'analysis.planning.figures': 'studies.places.planning.figures',
    'analysis.pose.evaluation': 'studies.places.pose.evaluation',
    'analysis.pose.figures': 'studies.places.pose.figures',
    'analysis.provenance': 'studies.framework.provenance',
    'analysis.report_page.page': 'studies.report_page.page',
    'analysis.residual_vibration': 'studies.framework.residual_vibration',
    'analysis.ripple.cases': 'studies.drives.ripple.run',
    'analysis.ripple.figures': 'studies.drives.ripple.figures',
    'analysis.ripple.study': 'studies.drives.ripple.study',
    'analysis.run_comparison': 'studies.runs.run_comparison',
    'analysis.run_energy': 'studies.runs.run_signals',
    'analysis.runs': 'studies.runs.runs',
    'analysis.study': 'studies.framework.study',
    'analysis.trace_export': 'studies.runs.trace_export',
    'analysis.tuning.analysis': 'studies.drives.loops.analysis',
    'analysis.tuning.approximation': 'studies.drives.loops.approximation',
    'analysis.tuning.load': 'studies.drives.loops.load',
    'analysis.tuning.proposal': 'studies.drives.tuning.proposal',
    'analysis.two_link_arm.kinematics': 'studies.thesis.two_link_arm.kinematics',
    'analysis.workspace.evaluation': 'studies.places.workspace.evaluation',
    'analysis.workspace.figures': 'studies.places.workspace.figures',
    'analysis.workspace.study': 'studies.places.workspace.study',
    'drive.channels': 'robot.drive.channels',
    'drive.diagnostics': 'robot.drive.diagnostics',
    'drive.operation_data': 'robot.drive.operation_data',
    'faults.fault': 'robot.faults.fault',
    'motion.belt_meeting': 'belts.meeting',
    'motion.belt_synchronization': 'belts.synchronization',
    'motion.capability': 'planning.limits.capability',
    'motion.curves': 'planning.paths.curves',
    'motion.energy': 'planning.limits.energy',
    'motion.frames': 'planning.program.frames',
    'motion.learned': 'planning.learned_torques',
    'motion.patterns': 'planning.program.patterns',
    'motion.plan': 'planning.plan',
    'motion.program': 'planning.program.model',
    'motion.program_file': 'planning.program.file_reader',
    'motion.program_planner': 'planning.program_planner',
    'motor': 'robot.motor',
    'peripherals.cell_file': 'cell.cell_file',
    'peripherals.world': 'cell.world',
    'recording.bag_reader': 'recording.bags.bag_reader',
    'ros.discovery': 'ros.wire.discovery',
    'ros.interfaces': 'ros.wire.interfaces',
    'ros.robot_client': 'ros.clients.robot_client',
    'sercos.service_channel': 'robot.sercos.service_channel',
    'sercos.telegrams': 'robot.sercos.telegrams',
}
FOLDERS = {parent for old in RENAMED for parent in (old.partition('.')[0], old.rpartition('.')[0]) if parent}


class RenamedModules:
    """Imports a module by its old name; it is found only if no module has that name."""

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Return the spec of an old name, or None."""
        old = fullname.removeprefix(f'{PACKAGE}.')
        if old not in RENAMED and old not in FOLDERS:
            return None
        from importlib.machinery import (
            ModuleSpec,
        )  # loaded only for an old name: every command imports this module

        loader: Any = self
        return ModuleSpec(fullname, loader, is_package=old in FOLDERS)

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """Return the module under its new name; an old folder is an empty package."""
        old = spec.name.removeprefix(f'{PACKAGE}.')
        if old not in RENAMED:
            return None
        import warnings
        from importlib import import_module

        new = f'{PACKAGE}.{RENAMED[old]}'
        warnings.warn(
            f'module {spec.name} is now {new}; the old name ends with release 0.3', FutureWarning, 2
        )
        module = import_module(new)
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Keep the spec of the module itself."""
        if module.__spec__ is not None and module.__spec__.loader_state is not None:
            module.__spec__ = module.__spec__.loader_state


def install() -> None:
    """Find old names after all other finders."""
    if not any(isinstance(finder, RenamedModules) for finder in sys.meta_path):
        sys.meta_path.append(RenamedModules())
