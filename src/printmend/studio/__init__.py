"""printmend in the browser: a server on this computer, its page, and the jobs that it runs in processes of their own.

`app.create_app` is the server; every route is a few lines over the functions that the command line calls. `work` runs
in the worker processes, `scene` makes the pictures in three dimensions, `play` breaks a printer that exists only here.
`printmend.client` talks to it from Python.
"""
