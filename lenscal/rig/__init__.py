"""Stage 1: the rig. Reads: commands. Gives: Frame."""
