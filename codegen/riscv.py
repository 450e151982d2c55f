"""Self-tests of exported functions on an emulated RISC-V core with single precision in hardware."""

from __future__ import annotations

import re
from pathlib import Path

from codegen import toolchain

GCC, NM, SIZE = (f"riscv64-unknown-elf-{tool}" for tool in ("gcc", "nm", "size"))
QEMU = "qemu-system-riscv32"
PACKAGES = {
    GCC: "gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf",
    QEMU: "qemu-system-misc",
}
ARCHITECTURE = "rv32imafc"
FLAGS = (
    *(f"-march={ARCHITECTURE}", "-mabi=ilp32f", "--specs=picolibc.specs", "-Os", "-std=c99"),
    *("-ffunction-sections", "-fdata-sections"),
)
#: Memory of qemu's machine `virt`.
MEMORY = {
    "__flash": 0x80000000,
    "__flash_size": 1 << 21,
    "__ram": 0x80200000,
    "__ram_size": 1 << 21,
}
#: gcc's helpers for double without hardware.
DOUBLE = re.compile(r"__(\w+df\w*|\w*df\d|fixdf\w+|float\w+df)")


def self_test(folder: Path) -> int:
    """Run the self-test of the export in `folder`; returns the bytes of code and tables.

    Raises
    ------
    RuntimeError
        If the compiler or a comparison fails, or if single precision calls double.
    """
    build = folder / "riscv"
    build.mkdir(parents=True, exist_ok=True)
    sources = {name: folder / f"{name}.c" for name in ("curv", "curv_functions", "check")}
    objects = {}
    for name, source in sources.items():
        objects[name] = build / f"{name}.o"
        warnings = () if name == "check" else (*toolchain.WARNINGS, *toolchain.FLOAT_WARNINGS)
        command = [GCC, *FLAGS, *warnings, "-c", str(source), "-o", str(objects[name])]
        toolchain.run(command)
    own = [str(objects[name]) for name in ("curv", "curv_functions")]
    undefined = toolchain.run([NM, "--undefined-only", "--format=just-symbols", *own]).split()
    doubles = sorted({name for name in undefined if DOUBLE.fullmatch(name)})
    if doubles:
        raise RuntimeError(f"{folder.name}: single precision calls {', '.join(doubles)}")
    program = build / "check.elf"
    places = [f"-Wl,--defsym={name}={value:#x}" for name, value in MEMORY.items()]
    link = ["--oslib=semihost", "--crt0=hosted", "-Wl,--gc-sections", *places, "-Tpicolibc.ld"]
    toolchain.run([GCC, *FLAGS, *link, *map(str, objects.values()), "-o", str(program), "-lm"])
    toolchain.run(
        [
            *(QEMU, "-M", "virt", "-bios", "none", "-nographic"),
            *("-semihosting-config", "enable=on,target=native", "-kernel", str(program)),
        ]
    )
    lines = toolchain.run([SIZE, *own]).splitlines()[1:]
    return sum(int(line.split()[0]) for line in lines)
