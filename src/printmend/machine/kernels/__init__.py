"""The forward laws of a machine as scalar functions that every other kernel calls: each effect is written here once."""
