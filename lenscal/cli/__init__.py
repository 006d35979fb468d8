"""One file per command; main.py assembles them."""
