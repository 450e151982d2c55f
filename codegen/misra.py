"""The wrappers of exported functions against the rules of MISRA C:2012 that cppcheck knows."""

from __future__ import annotations

import re
from pathlib import Path

from codegen import toolchain

CPPCHECK = "cppcheck"
PACKAGES = {CPPCHECK: "cppcheck"}
#: Rules that the wrappers do not follow, and why. All are advisory.
DEVIATIONS = {
    "2.5": "sizes are macros for callers; the wrappers do not use them",
    "8.7": "both forms of a call are for callers; the file itself uses one",
    "8.9": "bounds of weights stand beside each other, before the functions that check them",
    "15.5": "a check that fails returns at once, with its status",
    "19.2": "shared buffers are a union: their calls exclude each other, as the header says",
}
_FOUND = re.compile(r"misra-c2012-([\d.]+)\]")


def violations(folder: Path) -> list[str]:
    """What cppcheck says of curv.c in `folder`, the deviations left out.

    Raises
    ------
    RuntimeError
        If cppcheck fails.
    """
    command = [
        CPPCHECK,
        "--addon=misra",
        "--std=c99",
        "--quiet",
        "--template={file}:{line}: [{id}]",
    ]
    said = toolchain.run([*command, str(folder / "curv.c")], errors=True)
    return [
        line
        for line in said.splitlines()
        if (rule := _FOUND.search(line)) and rule[1] not in DEVIATIONS and "curv." in line
    ]
