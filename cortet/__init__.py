"""cortet: from cortical surfaces to certified simulation meshes (method: CORTET, arXiv:2607.12157).

import cortet
made = cortet.mesh("sub-01_hemi-L_white.surf.gii", cell_size=1.0, ga=28)
made.save("sub-01.inp")
"""

import os
import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from cortet.version import __version__ as __version__

if TYPE_CHECKING:
    from cortet.api import Mesh, certify, convert, improve, mesh, read, repair, surface
    from cortet.api.folding import Folded, fold, growth
    from cortet.errors import CortetError, InputError
    from cortet.phantoms import phantom

if sys.platform == "win32":
    raise ImportError("cortet runs on Linux, not on Windows: use the Windows Subsystem for Linux")

# Numba's first choice, TBB, warns in many environments that theirs is too old, and is not used anyway
os.environ.setdefault("NUMBA_THREADING_LAYER_PRIORITY", "omp workqueue tbb")
# threads that wait must not take a core from other work; read when OpenMP is loaded
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
# our compiled kernels are kept by `geometry.kernel_cache`; the others are for functions that are not ours
os.environ.setdefault(
    "NUMBA_CACHE_LOCATOR_CLASSES",
    "cortet.geometry.kernel_cache.KernelCacheLocator,UserProvidedCacheLocator,InTreeCacheLocator,UserWideCacheLocator",
)
if "numba" in sys.modules:  # it has read its environment already
    sys.modules["numba"].config.reload_config()

#: call or error -> its module, loaded when it is first asked for: jobs of the workflow do not need it
_MODULES = {
    **dict.fromkeys(("CortetError", "InputError"), "cortet.errors"),
    **dict.fromkeys(("Mesh", "certify", "convert", "improve", "mesh", "read", "repair", "surface"), "cortet.api"),
    "phantom": "cortet.phantoms",
    **dict.fromkeys(("Folded", "fold", "growth"), "cortet.api.folding"),
}
#: everything else is for those who build on the parts
__all__ = ["CortetError", "Folded", "InputError", "Mesh"]
__all__ += [
    "certify",
    "convert",
    "fold",
    "growth",
    "improve",
    "mesh",
    "phantom",
    "read",
    "repair",
    "surface",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(_MODULES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
