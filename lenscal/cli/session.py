"""``lenscal session``: record what a rig sees at every setting of a plan."""

from __future__ import annotations

from pathlib import Path

import click


@click.group()
def session() -> None:
    """Record calibration sessions."""


@session.command()
@click.argument("plan", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--simulate",
    "preset",
    metavar="PRESET",
    default="vicon-1990",
    show_default=True,
    help="Which simulated rig to use.",
)
@click.option("--seed", default=0, show_default=True, help="Seed of its noise.")
@click.option(
    "-o",
    "--out",
    required=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder to record to; it must not hold a session yet.",
)
def run(plan: Path, preset: str, seed: int, out: Path) -> None:
    """Carry out PLAN and record it.

    \b
    Example:
      lenscal session run data/first-session.toml -o first-session
    """
    from lenscal.progress import progress_bar
    from lenscal.rig.simulated import SimulatedRig
    from lenscal.session.plan import SessionPlan
    from lenscal.session.runner import run_session

    loaded = SessionPlan.load(plan)
    rig = SimulatedRig.preset(preset, seed=seed)
    with progress_bar("recording") as progress:
        recording = run_session(loaded, rig, out, progress=progress)
    views = sum(len(record.views) for record in recording.settings)
    click.echo(f"{len(recording.settings)} settings, {views} views recorded in {out}")
    for record in recording.settings:
        for note in record.notes:
            click.echo(f"  {record.setting}: {note}")
    click.echo(f"next: lenscal calibrate {out} -o table.csv")
