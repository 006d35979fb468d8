"""Exact visibility regions. Reads: Scene, Target, workspace. Gives: Region with its audit."""
