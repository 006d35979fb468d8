"""Stage 3: calibration. Reads: Recording. Gives: CalibrationTable."""
