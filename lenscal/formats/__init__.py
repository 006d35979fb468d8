"""Other people's files, one file per format."""
