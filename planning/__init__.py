"""Sensor planning."""
