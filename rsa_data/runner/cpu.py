"""The type of this machine's CPU, as far as the arithmetic of models depends on it."""

import platform
from collections import Counter
from functools import cache
from pathlib import Path

# Instruction sets for which the libraries have kernels of their own, so that sums are added up in
# another order or kept more exactly (benchmarks/cpu_types.py). Names as Linux has them.
_X86 = ("avx", "avx2", "fma", "avx_vnni", "avx512f", "avx512_vnni", "avx512_bf16", "amx_int8")
_ARM = ("asimddp", "i8mm", "bf16", "sve", "sve2")


@cache
def cpu_type() -> str:
    """Such as `x86_64 avx avx2 fma`: what the last digits of a model's outputs depend on."""
    try:
        text = Path("/proc/cpuinfo").read_text("utf-8", "replace")
    except OSError:
        text = ""
    lines = (line.partition(":") for line in text.split("\n"))
    flags = next((v.split() for k, _, v in lines if k.strip() in ("flags", "Features")), [])
    return " ".join([platform.machine(), *(name for name in (*_X86, *_ARM) if name in flags)])


def mixed(types: Counter[str]) -> str:
    """What to say of a table whose parts were made on CPUs of these types; "" when they are one."""
    known = {name: count for name, count in types.items() if name}
    if len(known) < 2:
        return ""
    which = "; ".join(f"{count} on {name}" for name, count in sorted(known.items()))
    return (
        f"its parts were made on {len(known)} types of CPU, so the last digits of their numbers "
        f"may differ: {which}"
    )
