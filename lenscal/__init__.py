"""lenscal."""
