"""Exact visibility regions."""
