"""The evidence of a region, as a file: what was asked, of which files, and what the audit found."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from typing import Any

from lenscal.document import write_document
from planning.scene import Scene
from planning.target import Target
from planning.visibility.region import Region

_KIND = "visibility region"
_VERSION = 1


def write_evidence(
    path: Path | str, scene: Scene, targets: tuple[Target, ...], region: Region
) -> Path:
    """Write what a region rests on.

    Parameters
    ----------
    path
        The JSON file.
    scene
        The part and what stands about it.
    targets
        What is seen from the region.
    region
        The region.

    Returns
    -------
    Path
        The file.
    """
    return write_document(path, _KIND, _VERSION, evidence(scene, targets, region))


def evidence(scene: Scene, targets: tuple[Target, ...], region: Region) -> dict[str, Any]:
    """Collect what a region rests on.

    Parameters
    ----------
    scene
        The part and what stands about it.
    targets
        What is seen from the region.
    region
        The region.

    Returns
    -------
    dict
        As JSON can hold it; lengths in mm, in the frame of the part.
    """
    record = region.to_dict()
    audit = record.pop("audit")
    return {
        "bodies": [
            {"name": body.name, "triangles": len(body.faces), "closed": body.is_closed}
            for body in scene.bodies
        ],
        "sources": [
            {
                "file": source.file,
                "sha256": source.sha256,
                "unit": source.unit,
                "chord_tolerance_mm": source.chord_tolerance_mm,
            }
            for source in scene.sources
        ],
        "targets_mm": [
            [target.vertices_mm[loop].tolist() for loop in target.loops] for target in targets
        ],
        "workspace_bounds_mm": region.workspace.bounds_mm.tolist(),
        "region": {"triangles": len(region.solid.faces), **record},
        "audit": audit,
        "made_with": f"lenscal {version('lenscal')}",
    }
