"""Requirements: one file each, all returning the same record."""
