"""Measured data: sets that nobody here simulated, each with a licence, a fixed split, and a row for every learner."""
