"""Benchmarks over real bodies: the paper's Table I, and the demonstration."""
