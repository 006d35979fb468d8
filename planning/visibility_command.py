"""The command ``visibility``: from where the whole of a target is seen, as files, page and picture.

What is heavy is imported when the command runs, so that ``--help`` is quick.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from planning.scene import Scene
    from planning.target import Target
    from planning.visibility.region import Region

_FILE = click.Path(path_type=Path, dir_okay=False)


@click.command()
@click.argument("part", type=_FILE)
@click.option("--unit", help="Unit of the numbers in PART: mm, in, m, …; STEP and TOML state it.")
@click.option(
    "--target",
    "--target-near",
    "target_texts",
    multiple=True,
    metavar="TARGET",
    help='What is to be seen: "0,0,12 mm", the flat face nearest to that point; "face:NAME" or '
    '"face:BODY/NAME", a face of a STEP file by name or number; "0,0,0; 9,0,0; 9,9,0 mm", a '
    'polygon, counter-clockwise seen from outside, or with two points a segment; "line:0,0,0; '
    '9,0,0; 9,9,0 mm", a line with corners. May be repeated: all are to be seen.',
)
@click.option(
    "--workspace",
    metavar="X,Y,Z,X,Y,Z",
    help="Where the camera may be: low and high corner of a box, such as "
    '"-50,-50,0,50,50,90 cm", or a closed mesh with its unit, such as "reach.stl:mm". If not '
    "given, five times the size of the scene about the target.",
)
@click.option("--fill-holes", is_flag=True, help="Count holes of a picked face as part of it.")
@click.option("--as-faces", is_flag=True, help="Take meshes that are no solids as bare faces.")
@click.option(
    "--chord-tolerance",
    metavar="LENGTH",
    default="0.01 mm",
    show_default=True,
    help="How far triangles may leave curved surfaces of a STEP file.",
)
@click.option(
    "--margin",
    metavar="LENGTH",
    default="0 mm",
    show_default=True,
    help="Make all that can hide the target larger by this first: a region on the safe side.",
)
@click.option(
    "--method",
    type=click.Choice(["direct", "decomposition"]),
    default="direct",
    show_default=True,
    help="How it is computed; the second is the paper's, for small parts.",
)
@click.option(
    "-o",
    "--out",
    type=_FILE,
    help="The region as .stl, .ply or .obj in mm, or all layers as .glb, in metres as that format "
    "demands; the evidence goes into a .json file beside it.",
)
@click.option("--html", type=_FILE, help="One page to look at in a browser; needs no network.")
@click.option("--png", type=_FILE, help="A picture, in space and in section.")
@click.option(
    "--audit-points", default=10_000, show_default=True, help="Random viewpoints to check."
)
@click.option("--seed", default=0, show_default=True, help="Seed of these viewpoints.")
def visibility(
    part: Path,
    unit: str | None,
    target_texts: tuple[str, ...],
    workspace: str | None,
    fill_holes: bool,
    as_faces: bool,
    chord_tolerance: str,
    margin: str,
    method: str,
    out: Path | None,
    html: Path | None,
    png: Path | None,
    audit_points: int,
    seed: int,
) -> None:
    """Compute from where the whole of a face is seen.

    PART is an STL, OBJ, PLY, GLB or STEP file, or a TOML file that names several with their poses.
    Everything in it can hide the target.

    \b
    Example:
      lenscal visibility part.stl --unit mm --target "0,0,0 mm" -o region.glb --html region.html
      lenscal visibility plate.step --target face:top --workspace "-9,-9,0,9,9,40 cm" --png top.png
    """
    from functools import reduce

    from lenscal.progress import progress_bar
    from lenscal.units import parse_length_mm
    from planning.scene import Scene
    from planning.spoken import spoken_targets, spoken_workspace
    from planning.visibility.methods import visibility_region

    _check_endings(out, html, png)
    scene = Scene.load(
        part, unit, as_faces=as_faces, chord_tolerance_mm=parse_length_mm(chord_tolerance)
    )
    targets = spoken_targets(target_texts, scene, fill_holes)
    camera_space, said = spoken_workspace(workspace, scene, targets)
    if said:
        click.echo(said)
    margin_mm = parse_length_mm(margin)
    regions = []
    for target in targets:
        with progress_bar("visibility") as progress:
            regions.append(
                visibility_region(
                    scene,
                    target,
                    camera_space,
                    method,
                    audit_points,
                    seed,
                    margin_mm=margin_mm,
                    progress=progress,
                )
            )
    region = reduce(lambda one, other: one.intersect(other), regions)
    _tell(scene, targets, region)
    _write(scene, targets, region, part.stem, out, html, png)


def _check_endings(out: Path | None, html: Path | None, png: Path | None) -> None:
    from lenscal.errors import FileError
    from planning.mesh_file import FILE_TYPES

    for path, what, endings in (
        (out, "a region", FILE_TYPES),
        (html, "a page", ("html", "htm")),
        (png, "a picture", ("png",)),
    ):
        if path is not None and path.suffix.lower().lstrip(".") not in endings:
            raise FileError(
                f"cannot write {what} to {path}; its name must end in one of {', '.join(endings)}"
            )


def _tell(scene: Scene, targets: tuple[Target, ...], region: Region) -> None:
    from planning.preview import facts_of

    faces = sum(len(body.faces) for body in scene.bodies)
    bare = [body.name for body in scene.bodies if not body.is_closed]
    click.echo(
        f"scene: {len(scene.bodies)} {'body' if len(scene.bodies) == 1 else 'bodies'}, {faces} "
        f"triangles{', bare faces: ' + ', '.join(bare) if bare else ''}"
    )
    previous = ""
    for name, value in facts_of(scene, targets, region):
        if previous in ("target", "region", "audit") and name in ("centre", ""):
            click.echo(f", {'about ' if name == 'centre' else ''}{value}", nl=False)
            continue
        click.echo(("\n" if previous else "") + f"{name}: {value}", nl=False)
        previous = name
    click.echo(f"\nvolumes add up to {region.audit.imbalance:.1e}")
    if region.is_empty:
        click.echo(f"the region is empty: {region.why_empty}")


def _write(
    scene: Scene,
    targets: tuple[Target, ...],
    region: Region,
    name: str,
    out: Path | None,
    html: Path | None,
    png: Path | None,
) -> None:
    from planning.evidence import write_evidence
    from planning.picture import save_picture
    from planning.preview import preview_visibility
    from planning.preview_files import write_glb, write_html

    if out is None and html is None and png is None:
        return
    preview = preview_visibility(scene, targets, region, f"Visibility: {name}")
    written = []
    if out is not None and out.suffix.lower() == ".glb":
        written.append(write_glb(out, preview))
    elif out is not None and not region.is_empty:
        out.parent.mkdir(parents=True, exist_ok=True)
        region.to_mesh().export(out)
        written.append(out)
    elif out is not None:
        click.echo(f"{out} was not written: there is nothing to put into it")
    if out is not None:
        written.append(write_evidence(out.with_suffix(".json"), scene, targets, region))
    if html is not None:
        written.append(write_html(html, preview))
    if png is not None:
        written.append(save_picture(png, preview, scene, targets[0], region))
    for path in written:
        click.echo(f"wrote {path}")
