"""printmend in the browser: a server on this computer, its page, and its jobs in worker processes.

`app.create_app` is the server; every route is a few lines over the functions that the command line calls. `work` runs
in the worker processes, `scene` makes the three-dimensional pictures, `play` breaks a virtual printer.
`printmend.client` talks to the server from Python.
"""
