"""Compiled loops of the world models."""
