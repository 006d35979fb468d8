"""A simulated rig that obeys the physics: behind the interfaces of a real one, with a truth to ask.

Stage 1, without hardware. Reads: commands. Gives: Frame, and the truth behind it.
"""

from lenscal.rig.simulated.body import LensBody
from lenscal.rig.simulated.lens_truth import LensTruth
from lenscal.rig.simulated.motor_faults import LensFaults, MotorFaults
from lenscal.rig.simulated.presets import PRESETS
from lenscal.rig.simulated.simulated_rig import SimulatedRig

__all__ = ["PRESETS", "LensBody", "LensFaults", "LensTruth", "MotorFaults", "SimulatedRig"]
