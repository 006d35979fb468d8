"""A simulated rig that obeys the physics: behind the interfaces of a real one, with a truth to ask.

Stage 1, without hardware. Reads: commands. Gives: Frame, and the truth behind it.
"""

from lenscal.rig.simulated.simulated_rig import PRESETS, SimulatedRig
from lenscal.rig.simulated.zoom_lens import LensTruth

__all__ = ["PRESETS", "LensTruth", "SimulatedRig"]
