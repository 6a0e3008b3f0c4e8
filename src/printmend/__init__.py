"""printmend: print straight on a broken 3-D printer.

Most users need only the commands (`printmend --help`). This does the same from Python, with a simulated printer:

    import printmend

    printer = printmend.read_printer("ender3")
    broken = printmend.Twin.of(printmend.read_corruption("broken.toml"), printer)  # no broken printer at hand?
    plan = printmend.design_probe(printer)
    printmend.write_probe("probe.gcode", plan)
    trace = printmend.print_gcode("probe.gcode", broken, noise_mm=0.05)  # or measure_scans(["scan.png"], plan).trace
    model = printmend.learn_model(trace, printer)
    printmend.mend_gcode("part.gcode", model, "part.mended.gcode")
    print(model.findings[0])
    print(printmend.judge_gcode("part.gcode", "part.mended.gcode", broken).summary())

The names are imported when they are first used. `learn.registry` knows the learners. The package printmend-lab has the
planners, and judges your own learners: anything with a name and a `fit` (`protocols`).
"""

# Here and in __main__ only what is needed at once is imported: until then Ctrl-C ends in a traceback.
import os

import lazy_loader

__version__ = "0.1.0"
_import_name, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    try:
        return _import_name(name)
    except ImportError as error:
        from printmend.extras import missing_extra

        if (missing := missing_extra(error)) is not None:
            raise missing from None
        raise


# numba marks up, in colours, texts of errors that it raises and catches by the thousand: a tenth of a compilation
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
if os.name == "posix" and "NUMBA_CACHE_DIR" not in os.environ and not os.access(os.path.dirname(__file__), os.W_OK):
    import tempfile
    from pathlib import Path

    from printmend.cache import kernel_folder, user_cache

    _kernels = kernel_folder(Path(__file__).parent, user_cache(), Path(tempfile.gettempdir()))
    if _kernels is not None:
        os.environ["NUMBA_CACHE_DIR"] = str(_kernels)  # numba reads it once, when it is imported
