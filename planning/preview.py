"""What a picture of a visibility region shows: the layers, labels and facts that go with it.

Others add their own layers, such as frusta and near and far planes, and write all of them with
`planning.preview_files`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
import trimesh

from lenscal.arrays import FloatArray
from planning.layers import Layer
from planning.scene import Scene
from planning.solid import Solid
from planning.target import Target
from planning.visibility.region import Region

# Colours of Okabe and Ito, which people tell apart whatever their colour vision.
PART_COLOUR: Final = "#b3b9c2"
TARGET_COLOUR: Final = "#d55e00"
REGION_COLOUR: Final = "#56b4e9"
WORKSPACE_COLOUR: Final = "#8a93a0"
#: How many points are tried for one that lies well inside of a region.
_TRIED: Final = 400
#: Of the points inside, how many are measured, and at most how many pairs of point and triangle.
_MEASURED: Final = 48
_PAIRS: Final = 400_000
#: Half the width of a segment that is drawn, as a share of its length.
_THIN: Final = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Preview:
    """All that a picture in space shows.

    Parameters
    ----------
    title
        What stands above it.
    layers
        What is seen, the opaque first.
    target_mm
        (3,) the centre of the target: pictures look at it.
    facts
        What stands beside the picture: names and values, with units.
    labels
        Words in space, and where they point in mm.
    viewpoint_mm
        (3,) a point from which the whole target is seen; None when there is none.
    """

    title: str
    layers: tuple[Layer, ...]
    target_mm: FloatArray
    facts: tuple[tuple[str, str], ...] = ()
    labels: tuple[tuple[str, FloatArray], ...] = field(default=())
    viewpoint_mm: FloatArray | None = None

    def layer(self, name: str) -> Layer:
        """Look a layer up.

        Parameters
        ----------
        name
            What it is called.

        Returns
        -------
        Layer
            The first of that name.
        """
        return next(layer for layer in self.layers if layer.name == name)


def preview_visibility(
    scene: Scene, targets: Target | tuple[Target, ...], region: Region, title: str = ""
) -> Preview:
    """Collect what a picture of a visibility region shows.

    Parameters
    ----------
    scene
        The part and what stands about it.
    targets
        What is seen from the region, one or several.
    region
        The region.
    title
        What stands above; by default the names of the bodies.

    Returns
    -------
    Preview
        Layers "part" (or one for each body, in the group "part"), "target", "region" and
        "workspace", with the facts that `facts_of` gives.
    """
    several = targets if isinstance(targets, tuple) else (targets,)
    layers = [*part_layers(scene), target_layer(several, scene)]
    if not region.is_empty:
        layers.append(_solid_layer("region", region.solid, REGION_COLOUR, 0.28))
    layers.append(_solid_layer("workspace", region.workspace, WORKSPACE_COLOUR, 0.03))
    centre = np.mean([target.centroid_mm for target in several], axis=0)
    viewpoint = None if region.is_empty else deep_point(region.solid)
    labels = [
        ("target" if len(several) == 1 else f"target {k + 1}", target.centroid_mm)
        for k, target in enumerate(several)
    ]
    if viewpoint is not None:
        labels.append(("sees the whole target", viewpoint))
    return Preview(
        title or " · ".join(scene.names[:3]),
        tuple(layers),
        centre,
        facts_of(scene, several, region),
        tuple(labels),
        viewpoint,
    )


def part_layers(scene: Scene) -> list[Layer]:
    """Show the bodies of a scene.

    Parameters
    ----------
    scene
        The part and what stands about it.

    Returns
    -------
    list of Layer
        "part" when there is one body; else each by its name, in the group "part".
    """
    alone = len(scene.bodies) == 1
    return [
        Layer(
            "part" if alone else body.name,
            body.vertices_mm,
            body.faces,
            colour=PART_COLOUR,
            is_closed=body.is_closed,
            role="part",
            group="" if alone else "part",
        )
        for body in scene.bodies
    ]


def target_layer(targets: tuple[Target, ...], scene: Scene) -> Layer:
    """Show what is to be seen.

    Parameters
    ----------
    targets
        Polygons are shown as they are, segments as thin bars.
    scene
        The scene, which says how long a segment is beside it.

    Returns
    -------
    Layer
        "target".
    """
    vertices, faces, lines = [], [], []
    start = 0
    for target in targets:
        mesh = _bar(target, scene) if target.is_segment else _polygon(target)
        vertices.append(mesh.vertices)
        faces.append(mesh.faces + start)
        loops = () if target.is_segment else target.loops
        lines += [np.stack([loop, np.roll(loop, -1)], axis=-1) + start for loop in loops]
        start += len(mesh.vertices)
    return Layer(
        "target",
        np.concatenate(vertices),
        np.concatenate(faces),
        np.concatenate(lines) if lines else np.zeros((0, 2), dtype=np.int64),
        colour=TARGET_COLOUR,
        role="target",
    )


def facts_of(
    scene: Scene, targets: tuple[Target, ...], region: Region
) -> tuple[tuple[str, str], ...]:
    """Say in words and numbers what a region is, and how sure that is.

    Parameters
    ----------
    scene
        The scene.
    targets
        What is seen.
    region
        The region.

    Returns
    -------
    tuple of (str, str)
        Names and values, with units.
    """
    facts = []
    for target in targets:
        if target.is_segment:
            facts.append(("target", f"segment of {target.size_mm:.6g} mm"))
        else:
            holes = len(target.loops) - 1
            with_holes = f" with {holes} hole{'s' if holes > 1 else ''}" if holes else ""
            facing = ", ".join(f"{v + 0.0:.3g}" for v in np.round(target.normal, 6))
            facts.append(("target", f"{target.area_mm2:.6g} mm²{with_holes}, facing ({facing})"))
        facts.append(("centre", f"({_numbers(target.centroid_mm)}) mm"))
    share = region.volume_mm3 / region.workspace.volume_mm3
    audit = region.audit
    facts += [
        ("region", f"{region.volume_mm3:.6g} mm³" if not region.is_empty else "empty"),
        ("", f"{share:.4%} of the workspace" if not region.is_empty else region.why_empty),
        ("audit", f"{audit.disagreements} of {audit.viewpoints} viewpoints disagree"),
        ("", f"outside of {audit.tolerance_mm:.2g} mm about the boundary"),
    ]
    if audit.margin_mm > 0:
        facts.append(("margin", f"occluders larger by {audit.margin_mm:g} mm on all sides"))
    for source in scene.sources:
        chords = source.chord_tolerance_mm
        tolerance = f", chords within {chords:g} mm" if chords is not None else ""
        facts.append(("file", f"{source.file}, in {source.unit}{tolerance}"))
    facts.append(("unit", "mm, in the frame of the part"))
    return tuple(facts)


def deep_point(solid: Solid, seed: int = 0) -> FloatArray | None:
    """Find a point well inside of a solid.

    Parameters
    ----------
    solid
        The solid.
    seed
        Seed of the points that are tried.

    Returns
    -------
    FloatArray or None
        (3,) of the points tried the one farthest from the surface, in mm; None when none of them
        lies inside.
    """
    if solid.is_empty:
        return None
    generator = np.random.default_rng(seed)
    # A step inwards from the middle of a face finds slender solids too, a draw from the box fat
    # ones.
    low, high = solid.bounds_mm
    middles = solid.triangles_mm.mean(axis=1)
    chosen = middles[generator.permutation(len(middles))[: _TRIED // 2]]
    towards = generator.permutation(chosen)
    points = np.concatenate(
        [(chosen + towards) / 2, generator.uniform(low, high, (_TRIED // 2, 3))]
    )
    inside = points[solid.contains(points)]
    inside = inside[: max(8, min(_MEASURED, _PAIRS // len(solid.faces)))]
    if not len(inside):
        return None
    deepest: FloatArray = inside[np.argmax(solid.distance_to_surface_mm(inside))]
    return deepest


def _solid_layer(name: str, solid: Solid, colour: str, opacity: float) -> Layer:
    return Layer(
        name,
        solid.vertices_mm,
        solid.faces,
        colour=colour,
        opacity=opacity,
        is_closed=True,
        role="region" if name == "region" else "workspace",
    )


def _polygon(target: Target) -> trimesh.Trimesh:
    fans = [np.stack([np.full(len(p) - 2, p[0]), p[1:-1], p[2:]], axis=-1) for p in target.pieces]
    return trimesh.Trimesh(target.vertices_mm, np.concatenate(fans), process=False)


def _bar(target: Target, scene: Scene) -> trimesh.Trimesh:
    size = min(target.size_mm, float(np.ptp(scene.bounds_mm, axis=0).max()))
    return trimesh.creation.cylinder(_THIN * size, segment=target.vertices_mm, sections=12)


def _numbers(vector: FloatArray) -> str:
    return ", ".join(f"{v + 0.0:.6g}" for v in np.round(vector, 6))
