"""What an image of the feature must satisfy: one file and one record per requirement."""
