"""What the linker kept of an object file, from the map file of GNU ld."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

#: Kinds of sections by the beginning of their names; what is none of them takes no memory.
KINDS = {".text": "code", ".rodata": "tables", ".data": "ram", ".bss": "ram", "COMMON": "ram"}

_SECTION = re.compile(
    r"^ (?P<section>\.\w[\w.$]*|COMMON)\s+0x[0-9a-f]+\s+0x(?P<size>[0-9a-f]+)\s+(?P<file>\S+)$",
    re.M,
)
_MAP = "Linker script and memory map"


def sizes(text: str, objects: Iterable[str]) -> Counter[str]:
    """Bytes of "code", "tables" (constants) and "ram" (static) that `objects` have in an image.

    Parameters
    ----------
    text : of a file written by `ld -Map`; sections that it discarded stand above the memory map
    objects : ends of file names, such as "curv.o" or "libm.a"
    """
    _, found, kept = text.partition(_MAP)
    if not found:
        raise ValueError(f"text: expected a map file of GNU ld, found none of its {_MAP!r}")
    ends = tuple(f"/{name}" for name in objects)
    total: Counter[str] = Counter()
    for match in _SECTION.finditer(kept):
        file = "/" + re.sub(r"\(.*\)$", "", match["file"])
        if file.endswith(ends):
            total[_kind(match["section"])] += int(match["size"], 16)
    return total


def _kind(section: str) -> str:
    return next((kind for name, kind in KINDS.items() if section.startswith(name)), "none")
