"""cortet: from cortical surfaces to certified simulation meshes (method: CORTET, arXiv:2607.12157)."""

import os
import sys

# Numba's first choice, TBB, warns in many environments that theirs is too old, and is not used anyway
os.environ.setdefault("NUMBA_THREADING_LAYER_PRIORITY", "omp workqueue tbb")
# threads that wait must not take a core from other work; read when OpenMP is loaded
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
# compiled kernels: NUMBA_CACHE_DIR where the user names one, else `geometry.kernel_cache`; the others are for functions
# that are not ours
os.environ.setdefault(
    "NUMBA_CACHE_LOCATOR_CLASSES",
    "UserProvidedCacheLocator,cortet.geometry.kernel_cache.KernelCacheLocator,InTreeCacheLocator,UserWideCacheLocator",
)
if "numba" in sys.modules:  # it has read its environment already
    sys.modules["numba"].config.reload_config()

__version__ = "0.2.0"
