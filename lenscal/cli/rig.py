"""``lenscal rig``: use a rig by hand."""

from __future__ import annotations

from pathlib import Path

import click


@click.group()
def rig() -> None:
    """Use a rig by hand."""


@rig.command()
@click.option("--zoom", required=True, type=float, help="Zoom setting.")
@click.option("--focus", required=True, type=float, help="Focus setting.")
@click.option("--iris", type=float, help="Iris setting; as it stands if not given.")
@click.option(
    "--distance",
    required=True,
    metavar="LENGTH",
    help="From the reference projection centre to the target along the axis, such as '370 mm'.",
)
@click.option(
    "--tilt-deg",
    default=0.0,
    show_default=True,
    help="Tilt of the target about the image's x axis.",
)
@click.option("--disk", is_flag=True, help="Look at the disk instead of the board.")
@click.option(
    "--preset", default="vicon-1990", show_default=True, help="Which simulated rig to use."
)
@click.option("--seed", default=0, show_default=True, help="Seed of its noise.")
@click.option(
    "-o",
    "--out",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="The picture (.png), 16 bits deep where the camera gives more than 8.",
)
def look(
    zoom: float,
    focus: float,
    iris: float | None,
    distance: str,
    tilt_deg: float,
    disk: bool,
    preset: str,
    seed: int,
    out: Path,
) -> None:
    """Move a simulated rig somewhere, set the exposure, and save what it sees.

    \b
    Example:
      lenscal rig look --zoom 98 --focus 100 --distance "370 mm" -o frame.png
    """
    import cv2
    import numpy as np

    from lenscal.errors import FileError, InputError
    from lenscal.pose import Pose
    from lenscal.rig.simulated import SimulatedRig
    from lenscal.session.aim import hand_pose
    from lenscal.session.exposure import expose
    from lenscal.session.runner import points_of_interest
    from lenscal.setting import LensSetting
    from lenscal.units import parse_length_mm

    standoff_mm = parse_length_mm(distance)
    if not standoff_mm > 0:
        raise InputError(f"the distance must be positive, but is {distance!r}")
    if out.suffix.lower() != ".png":
        raise InputError(f"cannot write a frame to {out.name}; end it in .png")
    simulated = SimulatedRig.preset(preset, seed=seed)
    stands = simulated.lens.move_to(LensSetting(zoom, focus, iris))
    disk_mm, board_mm = points_of_interest(simulated.target)
    turn = Pose.from_rotation_vector([np.radians(tilt_deg), 0.0, 0.0])
    aim = hand_pose(simulated, standoff_mm, disk_mm if disk else board_mm, turn)
    simulated.positioner.move_to(aim)
    exposure_s = expose(simulated.camera)
    frame = simulated.camera.grab()
    scale = 65535 / frame.saturation if frame.bit_depth > 8 else 1
    try:
        written = cv2.imwrite(str(out), np.rint(frame.image * scale).astype(frame.image.dtype))
    except cv2.error:
        written = False
    if not written:
        raise FileError(f"cannot write the frame to {out}; does the folder exist?")
    click.echo(
        f"{stands} at {standoff_mm:g} mm, exposed for {1000 * exposure_s:.3g} ms, saved in {out}"
    )


@rig.command()
@click.argument("sequence", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--rig",
    "rig_file",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="The rig (.toml): its devices, and for a simulated one the part on its bench.",
)
@click.option(
    "-o",
    "--out",
    required=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for the pictures; one that this sequence was broken off in is gone on with.",
)
def run(sequence: Path, rig_file: Path, out: Path) -> None:
    """Carry out SEQUENCE, which `lenscal plan` wrote: go there, set the lens, take the picture.

    Every setting is approached from the side that the lens was calibrated from. Before anything
    moves, all settings and poses are held against travel and reach. Pictures are PNG with all bits
    of the camera; journal.jsonl says of each where the robot and the lens stood.

    \b
    Example:
      lenscal rig run sequence.json --rig data/rig.toml -o pictures
    """
    from contextlib import closing

    from lenscal.progress import progress_bar
    from lenscal.rig.description import load_rig
    from lenscal.sequence import Sequence
    from lenscal.session.sequence_run import run_sequence

    loaded = Sequence.load(sequence)
    with closing(load_rig(rig_file)) as described, progress_bar("pictures") as progress:
        done = run_sequence(loaded, described, out, progress=progress)
    for picture in done.pictures:
        click.echo(f"{picture.frame}: {picture.name}, {picture.setting}")
    click.echo(f"pictures of {done.stations} viewpoints and their record are in {out}")
