"""The one place that knows numba: how functions of a point and kernels are written, compiled and cached."""

from fvswell.compiled.dispatch import anywhere, generic, law_at, point
from fvswell.compiled.kernels import Kernel, compiled_type, kernel, law_kernel

__all__ = ["Kernel", "anywhere", "compiled_type", "generic", "kernel", "law_at", "law_kernel", "point"]
