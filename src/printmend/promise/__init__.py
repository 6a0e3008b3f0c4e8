"""The uncertainty of a model: the machines that it may be, and their promise for a print.

`belief` is the section ``promise`` of the saved model: drawn machines, part by part. `predict` turns them into the
expected error of a file with a 90 % range.
"""
