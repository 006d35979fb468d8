"""The file ``rig.toml`` that a person writes: which devices make up a rig.

So far it knows simulated rigs, with a part on their bench where there shall be one::

    [simulated]
    preset = "vicon-1990"
    seed = 0

    [part]                                # left out: the calibration target
    file = "part.stl"
    unit = "mm"                           # of the numbers in the part's file
    base_from_part = { rotation_vector_deg = [0, 0, -8], translation = ["60 cm", "10 cm", "20 cm"] }

    [[part.rulers]]
    start = ["-0.5 in", "0 in", "0 in"]   # the middle of its first tick
    towards = ["0.5 in", "0 in", "0 in"]
    length = "1 in"
    step = "0.02 in"
    normal = [0, 0, 1]                    # the direction that its print faces
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lenscal.errors import FileError
from lenscal.handwritten import Handwritten, PointMm, PoseSpec, PositiveLengthMm, load_toml
from lenscal.pose import Pose
from lenscal.units import unit_in_mm

if TYPE_CHECKING:
    from lenscal.imaging.decal import Decal
    from lenscal.rig.interfaces import Rig


class SimulatedSpec(Handwritten):
    """A simulated rig as it is written.

    Parameters
    ----------
    preset
        Its name.
    seed
        Of everything random in it.
    """

    preset: str
    seed: int = 0


class RulerSpec(Handwritten):
    """A ruler that lies on the part.

    Parameters
    ----------
    start
        The middle of its first tick, in the part's frame.
    towards
        Any point in the direction of the last one.
    length
        Between the first and the last tick.
    step
        Between neighbouring ticks.
    normal
        The direction that its print faces.
    """

    start: PointMm
    towards: PointMm
    length: PositiveLengthMm
    step: PositiveLengthMm
    normal: tuple[float, float, float]

    def decal(self) -> Decal:
        """Print it.

        Returns
        -------
        Decal
            In the frame of the part.
        """
        from lenscal.imaging.ruler import Ruler

        return Ruler(self.length, self.step).decal(self.start, self.towards, self.normal)


class PartSpec(Handwritten):
    """A part on the bench.

    Parameters
    ----------
    file
        Its CAD file, beside the rig's file.
    unit
        Unit of the numbers in it.
    base_from_part
        Where it lies.
    rulers
        Rulers that lie on it.
    """

    file: Path
    unit: str
    base_from_part: PoseSpec
    rulers: tuple[RulerSpec, ...] = ()


class RigFile(Handwritten):
    """What ``rig.toml`` may say.

    Parameters
    ----------
    simulated
        The simulated rig.
    part
        What lies on its bench instead of the target.
    """

    simulated: SimulatedSpec
    part: PartSpec | None = None


def load_rig(path: Path | str) -> Rig:
    """Switch on the rig that a file describes.

    Parameters
    ----------
    path
        The TOML file. Names of files in it are relative to its folder.

    Returns
    -------
    Rig
        Ready to be used; close it when done.

    Raises
    ------
    FileError
        When a file is missing or cannot be read.
    InputError
        When it says something that is not understood.
    """
    # Only who asks for the simulation loads it.
    from lenscal.rig.simulated import SimulatedRig
    from lenscal.rig.simulated.workpiece import bodies_of_file

    path = Path(path)
    spec = load_toml(path, RigFile, "rig")
    rig = SimulatedRig.preset(spec.simulated.preset, seed=spec.simulated.seed)
    if spec.part is not None:
        file = path.parent / spec.part.file
        if not file.is_file():
            raise FileError(f"the rig {path} names the part {file}, which is not there")
        place = spec.part.base_from_part
        rig.lay_down(
            bodies_of_file(file, unit_in_mm(spec.part.unit)),
            Pose.from_rotation_vector(place.rotation_vector_rad, place.translation),
            [ruler.decal() for ruler in spec.part.rulers],
        )
    return rig
