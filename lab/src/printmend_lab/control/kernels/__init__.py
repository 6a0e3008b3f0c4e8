"""Compiled loops of the controllers."""
