"""Stage 2: a session. Reads: plan and Rig. Gives: Recording."""
