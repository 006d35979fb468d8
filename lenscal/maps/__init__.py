"""Stage 4: lens maps. Reads: CalibrationTable. Gives: LensMap."""
