"""printmend: print straight on a broken 3-D printer."""

import os
import tempfile
from pathlib import Path

from printmend.cache import kernel_folder, user_cache

__version__ = "0.1.0"

if os.name == "posix" and "NUMBA_CACHE_DIR" not in os.environ:  # numba reads it once, when it is imported
    _kernels = kernel_folder(Path(__file__).parent, user_cache(), Path(tempfile.gettempdir()))
    if _kernels is not None:
        os.environ["NUMBA_CACHE_DIR"] = str(_kernels)
