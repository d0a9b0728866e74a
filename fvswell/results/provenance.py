"""Where a file comes from: the global attributes that every result carries."""

from __future__ import annotations

import datetime
import platform
from functools import cache
from importlib import metadata

from fvswell.version import __version__

__all__ = ["REFERENCE", "provenance"]

REFERENCE = (
    "Wilson W, van Donkelaar CC, Huyghe JM (2005) A comparison between mechano-electrochemical and biphasic swelling "
    "theories for soft hydrated tissues. J Biomech Eng 127, 158-165, doi:10.1115/1.1835361"
)

_PACKAGES = ("numba", "numpy", "scipy", "xarray", "netCDF4", "fipy")


@cache
def _package_versions() -> str:
    packages = [f"python {platform.python_version()}", *(f"{name} {metadata.version(name)}" for name in _PACKAGES)]
    return ", ".join(packages)


def provenance(title: str, source: str, comment: str, conventions: str = "CF-1.11") -> dict[str, str]:
    """Attributes by the CF conventions.

    Parameters
    ----------
    title
        What was simulated.
    source
        What made the data, besides the program: its model.
    comment
        What else a reader should know.
    conventions
        That the file follows.
    """
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    return {
        "Conventions": conventions,
        "title": title,
        "institution": "fvswell",
        "source": f"fvswell {__version__}, {source}",
        "history": f"{now} computed by fvswell {__version__}",
        "references": REFERENCE,
        "comment": comment,
        "package_versions": _package_versions(),
    }
