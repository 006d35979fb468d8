"""Stage 5: planning. Reads: LensMap, Scene, Task. Gives: Plan.

Public names are looked up when they are first used, so that importing the package costs nothing.
"""

from __future__ import annotations

import importlib
from typing import Any, Final

_HOMES: Final = {
    "AdmissibleSettings": "planning.settings",
    "CameraBody": "planning.camera_body",
    "Clearance": "planning.requirements.clearance",
    "CoveringPlan": "planning.several",
    "Cylinder": "planning.camera_body",
    "DepthOfField": "planning.requirements.depth_of_field",
    "FieldOfView": "planning.requirements.field_of_view",
    "FixedLens": "planning.fixed_lens",
    "HalfSpaces": "planning.half_spaces",
    "Incidence": "planning.requirements.incidence",
    "LensStates": "planning.lens_states",
    "Plan": "planning.plan_record",
    "Placement": "planning.placement",
    "Region": "planning.visibility.region",
    "Relaxation": "planning.blame",
    "Resolution": "planning.requirements.resolution",
    "RobotCell": "planning.robot_cell",
    "Scene": "planning.scene",
    "Solid": "planning.solid",
    "Subject": "planning.views",
    "Target": "planning.target",
    "Task": "planning.task",
    "Unvignetted": "planning.requirements.unvignetted",
    "ViewErrors": "planning.view_errors",
    "Views": "planning.views",
    "Visibility": "planning.requirements.visibility",
    "admissible_settings": "planning.settings",
    "box_workspace": "planning.solid",
    "example_part": "planning.enclosure",
    "fewest_viewpoints": "planning.cover",
    "judge": "planning.judgement",
    "object_distance_bounds_mm": "planning.settings",
    "occluded_region": "planning.visibility.polygon_regions",
    "place_plan": "planning.placement",
    "plan": "planning.planner",
    "plan_all": "planning.several",
    "positions_for": "planning.positions",
    "robustness_of": "planning.robustness",
    "shortest_route": "planning.route",
    "verify_viewpoint": "planning.verify",
    "viewing_region": "planning.visibility.polygon_regions",
    "visibility_region": "planning.visibility.methods",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'planning' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
